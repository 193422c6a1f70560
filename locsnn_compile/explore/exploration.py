"""What an exploration finds: its points, the front that no other point beats, the one to take, and commands for each.

The cheapest point on the front within a budget is recommended.
"""

import shlex
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

from hw_model.values import Frozen
from locsnn_compile.cluster.spread import Spread
from locsnn_compile.explore.events import Chosen
from locsnn_compile.explore.point import Figures, ModelFile, Point, Study
from locsnn_compile.explore.sweep import Store, sweep
from locsnn_compile.report.format import energy, known, plural, share, time
from locsnn_compile.settings import SPIKE_WORTH, Setting
from locsnn_compile.verification.error_bounds import ErrorBudget
from locsnn_compile.verification.matching import Progress

FRONT_RULE = (
    "A setting is on the front if no other is at least as good in spike error, changed predictions, error of class "
    "scores, energy and chip time, and better in one of them."
)
OBJECTIVES = ("spike_error", "prediction_error", "score_error", "energy_pj", "chip_time_ns")
"""The figures to minimise."""


def beats(one: Figures, other: Figures) -> bool:
    """Tell whether one is at least as good in every objective and better in one."""
    pairs = list(zip(_objectives(one), _objectives(other), strict=True))
    is_never_worse = all(mine <= theirs for mine, theirs in pairs)
    return is_never_worse and any(mine < theirs for mine, theirs in pairs)


def on_front(figures: Sequence[Figures | None]) -> list[bool]:
    """Mark the figures that no others beat; a setting without figures is not on the front and beats none."""
    return [
        mine is not None and not any(other is not None and beats(other, mine) for other in figures)
        for mine in figures
    ]


def _objectives(figures: Figures) -> list[float]:
    """Return the objectives; 0 if nothing was compared, because then both sides did nothing."""
    return [float(getattr(figures, name) or 0.0) for name in OBJECTIVES]


class Recommendation(Frozen):
    """The point to take, None if no setting keeps the budget; ``why`` is a sentence without its full stop."""

    taken: Point | None
    why: str


def recommend(
    points: Sequence[Point], budget: ErrorBudget, *, by_default: bool = False
) -> Recommendation:
    """Take the cheapest point on the front that keeps the budget. At least one point has figures.

    ``by_default``: the budget is that of ``auto``, which weighs errors against the cost as well.
    """
    marks = on_front([point.figures for point in points])
    front = [
        (point, point.figures)
        for point, mark in zip(points, marks, strict=True)
        if mark and point.figures
    ]
    if not budget.given:
        why = "nothing was compared: no neuron spikes on these recordings, and all class scores tie"
        return Recommendation(None, why)
    kept = [pair for pair in front if pair[1].keeps(budget)]
    bounds = f"{'what auto keeps by default, ' if by_default else ''}{budget.words()}"
    if not kept:
        return Recommendation(None, f"no setting keeps {bounds}; {_nearest(front)}")
    spike_worth = SPIKE_WORTH if by_default else 0.0
    least_cost = min(figures.cost for _, figures in kept)
    taken, figures = min(
        kept,
        key=lambda pair: (
            pair[1].weighed(least_cost, spike_worth),
            pair[1].chip_time_ns,
            *pair[1].losses,
        ),
    )
    least = "time," if figures.energy_pj is None else f"energy, {energy(figures.energy_pj)} and"
    if by_default:
        bounds = f"{bounds}, with a percent of spikes worth {SPIKE_WORTH:g} % of the cost"
        least = f"best weighed {least}"
    else:
        least = f"least {least}"
    why = (
        f"the {least} {time(figures.chip_time_ns)} per recording, of "
        f"{plural(len(kept), 'setting')} on the front within {bounds}"
    )
    return Recommendation(taken, why)


def _nearest(front: Sequence[tuple[Point, Figures]]) -> str:
    point, figures = min(front, key=lambda pair: (pair[1].spike_error or 0.0, *pair[1].losses))
    if figures.spike_error is figures.score_error is None:
        return "no neuron spikes on these recordings"
    least = f"the least spike error is {known(figures.spike_error, share)}"
    if figures.spike_error is None:
        error = known(figures.score_error, share)
        least = f"the least error of class scores is {error} of their spread"
    changed = known(figures.prediction_error, share, "none")
    return f"{least}, with {changed} of the predictions changed, by {point.setting}"


class Exploration(Frozen, eq=False):
    """Points in the order of the grid, what they were measured on, and the budget of the recommended one.

    ``model``, ``target`` and ``calibration`` are as given; ``calibration`` is None if it is the file of ``events``.
    ``by_default``: no bound was given, so the ``budget`` is that of ``auto``. ``reported``: the points on the front,
    measured on the recordings ``reported_on``, on which nothing was chosen. ``reading_arguments`` are the options that
    say how recordings are read.
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
    reading_arguments: tuple[str, ...] = ()

    @cached_property
    def on_front(self) -> tuple[bool, ...]:
        """Which points are on the front."""
        return tuple(on_front([point.figures for point in self.points]))

    @property
    def front(self) -> tuple[Setting, ...]:
        """Settings on the front."""
        return tuple(
            point.setting for point, mark in zip(self.points, self.on_front, strict=True) if mark
        )

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

    def report_on(
        self, events: Chosen, store: Store[Point], spread: Spread, progress: Progress | None
    ) -> "Exploration":
        """Return the exploration with the settings on its front also measured on other recordings."""
        study = replace(self.study, recordings=events.recordings, engines=())
        return replace(
            self, reported=sweep(study, self.front, store, spread, progress), reported_on=events
        )

    def _command(self, setting: Setting, events: Chosen) -> str:
        network = self.study.network
        calibration = self.calibration or self.events.file
        assert events.file is not None
        assert calibration is not None
        model_arguments = [*self.model.arguments(), "--target", self.target]
        rounded_for = ["--calibration", calibration] if network.by_strategy else []
        return shlex.join(
            [
                "locsnn-compile",
                *model_arguments,
                *setting.arguments(network),
                *rounded_for,
                "--events",
                events.file,
                *self.reading_arguments,
            ]
        )
