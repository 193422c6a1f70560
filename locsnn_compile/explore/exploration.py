"""The result of an exploration: its points, which of them are on the front, which is recommended, and their commands.

A point is a setting of the compiler with its figures. One point *beats* another if it is at least as good in every
objective and better in one; the *front* holds the points that none beats. The cheapest point on the front that keeps a
budget, bounds on what the chip may lose, is recommended.
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
PointWithFigures = tuple[Point, Figures]
"""A point that the chip did not refuse, and its figures."""


def beats(left: Figures, right: Figures) -> bool:
    """Return whether ``left`` is at least as good in every objective and better in one."""
    pairs = list(zip(_objectives(left), _objectives(right), strict=True))
    is_never_worse = all(left_value <= right_value for left_value, right_value in pairs)
    is_better_once = any(left_value < right_value for left_value, right_value in pairs)
    return is_never_worse and is_better_once


def on_front(figures: Sequence[Figures | None]) -> list[bool]:
    """Return for each point whether none beats it; one without figures is not on the front and beats none."""
    rivals = [rival for rival in figures if rival is not None]
    marks: list[bool] = []
    for candidate in figures:
        is_beaten = candidate is None or any(beats(rival, candidate) for rival in rivals)
        marks.append(not is_beaten)
    return marks


def _objectives(figures: Figures) -> list[float]:
    """Return the figures to minimise.

    An error is 0 if nothing was compared, because then both sides did nothing. Points of one chip all have an energy or
    all have none, so that 0 for an unknown energy decides nothing.
    """
    return [float(getattr(figures, name) or 0.0) for name in OBJECTIVES]


class Recommendation(Frozen):
    """The point to take, None if no setting keeps the budget; ``why`` is a sentence without its full stop."""

    taken: Point | None
    why: str


def recommend(
    points: Sequence[Point], budget: ErrorBudget, *, by_default: bool = False
) -> Recommendation:
    """Return the cheapest point on the front that keeps the budget, and why. At least one point has figures.

    ``by_default``: the user gave no bounds, and the budget is that of ``auto``, which also weighs spike errors against
    the cost.
    """
    front = _front_with_figures(points)
    if not budget.given:
        why = "nothing was compared: no neuron spikes on these recordings, and all class scores tie"
        return Recommendation(taken=None, why=why)
    within_budget = [(point, figures) for point, figures in front if figures.keeps(budget)]
    bounds = f"{'what auto keeps by default, ' if by_default else ''}{budget.words()}"
    if not within_budget:
        return Recommendation(taken=None, why=f"no setting keeps {bounds}; {_nearest_words(front)}")
    point, figures = _cheapest(within_budget, SPIKE_WORTH if by_default else 0.0)
    cost = "time," if figures.energy_pj is None else f"energy, {energy(figures.energy_pj)} and"
    if by_default:
        bounds = f"{bounds}, with a percent of spikes worth {SPIKE_WORTH:g} % of the cost"
        superlative = "best weighed"
    else:
        superlative = "least"
    why = (
        f"the {superlative} {cost} {time(figures.chip_time_ns)} per recording, of "
        f"{plural(len(within_budget), 'setting')} on the front within {bounds}"
    )
    return Recommendation(point, why)


def _front_with_figures(points: Sequence[Point]) -> list[PointWithFigures]:
    """Return the points on the front with their figures."""
    marks = on_front([point.figures for point in points])
    front: list[PointWithFigures] = []
    for point, is_on_front in zip(points, marks, strict=True):
        if is_on_front and point.figures is not None:
            front.append((point, point.figures))
    return front


def _cheapest(points: Sequence[PointWithFigures], spike_worth: float) -> PointWithFigures:
    """Return the point of the least cost, with its errors weighed in by ``spike_worth``.

    Of equal ones, the quickest is taken, and then the one that loses least.
    """
    least_cost = min(figures.cost for _, figures in points)

    def rank(pair: PointWithFigures) -> tuple[float, ...]:
        _, figures = pair
        return (figures.weighed(least_cost, spike_worth), figures.chip_time_ns, *figures.losses)

    return min(points, key=rank)


def _nearest_words(front: Sequence[PointWithFigures]) -> str:
    """Return in words which point comes nearest to a budget that none keeps: the least spike error."""
    point, figures = min(front, key=lambda pair: (pair[1].spike_error or 0.0, *pair[1].losses))
    if figures.spike_error is None and figures.score_error is None:
        return "no neuron spikes on these recordings"
    least = f"the least spike error is {known(figures.spike_error, share)}"
    if figures.spike_error is None:
        error = known(figures.score_error, share)
        least = f"the least error of class scores is {error} of their spread"
    changed = known(figures.prediction_error, share, "none")
    return f"{least}, with {changed} of the predictions changed, by {point.setting}"


class Exploration(Frozen, eq=False):
    """Points in the order of the grid, what they were measured on, and the budget of the recommended one.

    - ``model``, ``target`` and ``calibration``: as given; ``calibration`` is None if it is the file of ``events``
    - ``by_default``: no bound was given, so the ``budget`` is that of ``auto``
    - ``reported``: the points on the front, measured on the recordings ``reported_on``, on which nothing was chosen
    - ``reading_arguments``: the options that say how recordings are read
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
        """The settings on the front."""
        marked = zip(self.points, self.on_front, strict=True)
        return tuple(point.setting for point, is_on_front in marked if is_on_front)

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
        """Return the command for a point on the recordings of ``--report-on``; None if it was not measured there."""
        is_reported = any(point.setting == setting for point in self.reported)
        if not is_reported or self.reported_on is None:
            return None
        return self._command(setting, self.reported_on)

    def report_on(
        self, events: Chosen, store: Store[Point], spread: Spread, progress: Progress | None
    ) -> "Exploration":
        """Return the exploration with the settings on its front also measured on other recordings."""
        # Engines have been timed on the first recordings.
        study = replace(self.study, recordings=events.recordings, engines=())
        reported = sweep(study, self.front, store, spread, progress)
        return replace(self, reported=reported, reported_on=events)

    def _command(self, setting: Setting, events: Chosen) -> str:
        network = self.study.network
        calibration = self.calibration or self.events.file
        # Recordings without a file have been written to a copy before any command is made.
        assert events.file is not None
        assert calibration is not None
        # locsnn-compile refuses the option if no weight is rounded for recordings.
        calibration_arguments = ["--calibration", calibration] if network.by_strategy else []
        return shlex.join(
            [
                "locsnn-compile",
                *self.model.arguments(),
                "--target",
                self.target,
                *setting.arguments(network),
                *calibration_arguments,
                "--events",
                events.file,
                *self.reading_arguments,
            ]
        )
