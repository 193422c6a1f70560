"""The front of the points that no other point beats, and the one on it to recommend: the cheapest within a budget."""

from collections.abc import Sequence

from hw_model.values import Frozen
from locsnn_compile.explore.point import Figures, Point
from locsnn_compile.report.format import energy
from locsnn_compile.report.words import sentence
from locsnn_compile.verification.error_bounds import ErrorBudget

FRONT_RULE = (
    "A setting is on the front if no other is at least as good in spike error, changed predictions, error of class "
    "scores, energy and chip time, and better in one of them."
)
OBJECTIVES = ("spike_error", "prediction_error", "score_error", "energy_pj", "chip_time_ns")
"""The figures to minimise."""


def beats(one: Figures, other: Figures) -> bool:
    """Tell whether one is at least as good in every objective and better in one."""
    pairs = list(zip(_objectives(one), _objectives(other), strict=True))
    return all(mine <= its for mine, its in pairs) and any(mine < its for mine, its in pairs)


def on_front(figures: Sequence[Figures | None]) -> list[bool]:
    """Mark the figures that no others beat; a setting without figures is not on the front and beats none."""
    return [
        mine is not None and not any(other is not None and beats(other, mine) for other in figures) for mine in figures
    ]


def _objectives(figures: Figures) -> list[float]:
    """Return the objectives; 0 if nothing was compared, because then both sides did nothing."""
    return [float(getattr(figures, name) or 0.0) for name in OBJECTIVES]


class Recommendation(Frozen):
    """The point to take, None if no setting keeps the budget; ``why`` is a sentence without its full stop."""

    taken: Point | None
    why: str


def recommend(points: Sequence[Point], budget: ErrorBudget, *, by_default: bool = False) -> Recommendation:
    """Take the cheapest point on the front that keeps the budget. At least one point has figures."""
    marks = on_front([point.figures for point in points])
    front = [(point, point.figures) for point, mark in zip(points, marks, strict=True) if mark and point.figures]
    if not budget.given:
        return Recommendation(None, sentence("nothing compared"))
    kept = [pair for pair in front if pair[1].keeps(budget)]
    bounds = f"{'what auto keeps by default, ' if by_default else ''}{budget.words()}"
    if not kept:
        return Recommendation(None, f"no setting keeps {bounds}; {_nearest(front)}")
    taken, figures = min(kept, key=lambda pair: (pair[1].cost, pair[1].chip_time_ns, *pair[1].losses))
    least = "time," if figures.energy_pj is None else f"energy, {energy(figures.energy_pj)} and"
    return Recommendation(taken, sentence("least", least=least, figures=figures, settings=len(kept), bounds=bounds))


def _nearest(front: Sequence[tuple[Point, Figures]]) -> str:
    point, figures = min(front, key=lambda pair: (pair[1].spike_error or 0.0, *pair[1].losses))
    if figures.spike_error is figures.score_error is None:
        return "no neuron spikes on these recordings"
    least = "nearest scores" if figures.spike_error is None else "nearest setting"
    return sentence(least, setting=point.setting, figures=figures)
