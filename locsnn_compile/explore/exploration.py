"""What an exploration found: points, their front, and the recommendation."""

import shlex
from dataclasses import replace
from functools import cached_property

from hw_model.values import Frozen
from locsnn_compile.explore.events import Chosen
from locsnn_compile.explore.executors import Executor
from locsnn_compile.explore.point import Point
from locsnn_compile.explore.recommend import Recommendation, on_front, recommend
from locsnn_compile.explore.study import ModelFile, Study
from locsnn_compile.explore.sweep import Progress, Store, sweep
from locsnn_compile.settings import Setting, has_srm_neurons
from locsnn_compile.verification.error_bounds import ErrorBudget


class Exploration(Frozen, eq=False):
    """Points in the order of the grid, what they were measured on, and what the recommended one may lose.

    ``model``, ``target`` and ``calibration`` as they were given, the last None where it is the ``events``, in a file.
    ``by_default``: no bound was given, and the ``budget`` is that of ``auto``.
    ``reported``: points of the front on other recordings, ``reported_on``, on which nothing was chosen.
    """

    study: Study
    model: ModelFile
    target: str
    calibration: str | None
    events: Chosen
    budget: ErrorBudget
    by_default: bool
    points: tuple[Point, ...]
    reported: tuple[Point, ...] = ()
    reported_on: Chosen | None = None

    @cached_property
    def on_front(self) -> tuple[bool, ...]:
        """Which points are on the front."""
        return tuple(on_front([point.figures for point in self.points]))

    @property
    def front(self) -> tuple[Setting, ...]:
        """Settings on the front."""
        return tuple(point.setting for point, mark in zip(self.points, self.on_front, strict=True) if mark)

    @cached_property
    def recommendation(self) -> Recommendation:
        """The setting to take, and why."""
        return recommend(self.points, self.budget, by_default=self.by_default)

    def command(self, setting: Setting) -> str:
        """Return the command that makes a point again."""
        return self._command(setting, self.events)

    def report_command(self, setting: Setting) -> str | None:
        """Return the command that makes a point again on the recordings to report on; None for one that was not."""
        reported = any(point.setting == setting for point in self.reported)
        return self._command(setting, self.reported_on) if reported and self.reported_on else None

    def report_on(self, events: Chosen, store: Store, executor: Executor, progress: Progress | None) -> "Exploration":
        """Measure the settings of the front on other recordings too."""
        study = replace(self.study, recordings=events.recordings, engines=())
        return replace(self, reported=sweep(study, self.front, store, executor, progress), reported_on=events)

    def _command(self, setting: Setting, events: Chosen) -> str:
        network = self.study.network
        calibration = self.calibration or self.events.file
        assert events.file is not None
        assert calibration is not None
        given = [*self.model.arguments(), "--target", self.target]
        rounded_for = ["--calibration", calibration] if has_srm_neurons(network) else []
        return shlex.join(
            ["locsnn-compile", *given, *setting.arguments(network), *rounded_for, "--events", events.file]
        )
