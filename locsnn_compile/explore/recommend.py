"""The recommended setting: always one of the front, by the error budget that was given, else the knee."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from locsnn_compile.choose_strategy import ErrorBudget
from locsnn_compile.explore.front import OBJECTIVES, on_front
from locsnn_compile.explore.point import Figures, Point
from locsnn_compile.report.format import energy, plural, share, time

KNEE_TOLERANCE = 0.01
"""So many more of the predictions may change at the knee than in the best setting of the front. Settings that are cheap
because they do something else are on every front, and would stretch every scale.
"""
KNEE_RULE = (
    "the knee of the front: of its settings that change at most 1 % more of the predictions than the best, the one "
    "with the smallest sum of squares of spike error, changed predictions, energy and chip time, each from 0, the best "
    "of these settings, to 1, the worst"
)


@dataclass(frozen=True)
class Recommendation:
    """The point to take, None where no setting keeps the budget; ``why`` is a sentence without its end."""

    taken: Point | None
    why: str


def recommend(points: Sequence[Point], budget: ErrorBudget) -> Recommendation:
    """Take the cheapest of the front that keeps the budget; without a budget, the knee. Some point has figures."""
    marks = on_front([point.figures for point in points])
    front = [(point, point.figures) for point, mark in zip(points, marks, strict=True) if mark and point.figures]
    if budget == ErrorBudget():
        return Recommendation(_knee(front), KNEE_RULE)
    kept = [pair for pair in front if keeps(pair[1], budget)]
    bounds = _words(budget)
    if not kept:
        return Recommendation(None, f"no setting keeps {bounds}; {_nearest(front)}")
    taken, figures = min(kept, key=lambda pair: (pair[1].energy_pj, pair[1].chip_time_ns, pair[1].spike_error))
    of = plural(len(kept), "setting")
    spent = f"{energy(figures.energy_pj)} and {time(figures.chip_time_ns)} a recording"
    return Recommendation(taken, f"the least energy, {spent}, of {of} on the front within {bounds}")


def keeps(figures: Figures, budget: ErrorBudget) -> bool:
    """Tell whether a setting keeps an error budget."""
    agreement, error = budget.min_agreement, budget.max_spike_error
    return (agreement is None or figures.prediction_agreement >= agreement) and (
        error is None or figures.spike_error <= error
    )


def _knee(front: Sequence[tuple[Point, Figures]]) -> Point:
    most = max(figures.prediction_agreement for _, figures in front) - KNEE_TOLERANCE
    near = [pair for pair in front if pair[1].prediction_agreement >= most]
    columns = [[objective.of(figures) for _, figures in near] for objective in OBJECTIVES]
    scaled = [_scaled(column) for column in columns]
    distances = [sum(value * value for value in row) for row in zip(*scaled, strict=True)]
    return near[distances.index(min(distances))][0]


def _scaled(values: Sequence[float]) -> list[float]:
    """Return values from 0, the best, to 1, the worst; 0 where all are equal."""
    low, span = min(values), max(values) - min(values)
    return [(value - low) / span if span else 0.0 for value in values]


def _words(budget: ErrorBudget) -> str:
    parts = []
    if budget.min_agreement is not None:
        parts.append(f"--min-agreement {budget.min_agreement:g}")
    if budget.max_spike_error is not None:
        parts.append(f"--max-spike-error {budget.max_spike_error:g}")
    return " and ".join(parts)


def _nearest(front: Sequence[tuple[Point, Figures]]) -> str:
    point, figures = min(front, key=lambda pair: (pair[1].spike_error, pair[1].prediction_error))
    return (
        f"the least spike error is {share(figures.spike_error)}, with {share(figures.prediction_error)} of the "
        f"predictions changed, by {point.setting}"
    )
