"""The result of an exploration: points, the front, the recommended point, and the command that reproduces each."""

import shlex
from dataclasses import replace
from functools import cached_property

from hw_model.values import Frozen
from locsnn_compile.cluster.spread import Spread
from locsnn_compile.explore.events import Chosen
from locsnn_compile.explore.front import Recommendation, on_front, recommend
from locsnn_compile.explore.point import ModelFile, Point, Study
from locsnn_compile.explore.sweep import Store, sweep
from locsnn_compile.settings import Setting
from locsnn_compile.verification.error_bounds import ErrorBudget
from locsnn_compile.verification.matching import Progress


class Exploration(Frozen, eq=False):
    """Points in the order of the grid, what they were measured on, and the budget of the recommended one.

    ``model``, ``target`` and ``calibration`` are as given; ``calibration`` is None if it is the file of ``events``.
    ``by_default``: no bound was given, so the ``budget`` is that of ``auto``. ``reported``: the points on the front,
    measured on the recordings ``reported_on``, on which nothing was chosen.
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

    @property
    def profile(self) -> str | None:
        """The energy profile of all figures; None for a chip without one."""
        return next(point.figures.energy_profile for point in self.points if point.figures)

    @cached_property
    def recommendation(self) -> Recommendation:
        """The setting to take, and why."""
        return recommend(self.points, self.budget, by_default=self.by_default)

    def command(self, setting: Setting) -> str:
        """Return the command that reproduces a point."""
        return self._command(setting, self.events)

    def report_command(self, setting: Setting) -> str | None:
        """Return the command that reproduces a point on the recordings reported on; None if it was not reported."""
        reported = any(point.setting == setting for point in self.reported)
        return self._command(setting, self.reported_on) if reported and self.reported_on else None

    def report_on(self, events: Chosen, store: Store, spread: Spread, progress: Progress | None) -> "Exploration":
        """Return the exploration with the settings on its front also measured on other recordings."""
        study = replace(self.study, recordings=events.recordings, engines=())
        return replace(self, reported=sweep(study, self.front, store, spread, progress), reported_on=events)

    def _command(self, setting: Setting, events: Chosen) -> str:
        network = self.study.network
        calibration = self.calibration or self.events.file
        assert events.file is not None
        assert calibration is not None
        given = [*self.model.arguments(), "--target", self.target]
        rounded_for = ["--calibration", calibration] if network.by_strategy else []
        return shlex.join(
            ["locsnn-compile", *given, *setting.arguments(network), *rounded_for, "--events", events.file]
        )
