"""The Pareto front: settings that no other beats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from locsnn_compile.explore.point import Figures

FRONT_RULE = (
    "A setting is on the front where no other is at least as good in spike error, changed predictions, energy and chip "
    "time, and better in one of them."
)


@dataclass(frozen=True)
class Objective:
    """A figure that is to be small, and what it is called."""

    figure: str
    words: str

    def of(self, figures: Figures) -> float:
        """Return the figure; 0 where nothing was compared, as both sides did nothing."""
        return float(getattr(figures, self.figure) or 0.0)


OBJECTIVES = (
    Objective("spike_error", "spike error"),
    Objective("prediction_error", "changed predictions"),
    Objective("energy_pj", "energy"),
    Objective("chip_time_ns", "chip time"),
)


def beats(one: Figures, other: Figures) -> bool:
    """Tell whether one is at least as good in every objective, and better in one."""
    pairs = [(objective.of(one), objective.of(other)) for objective in OBJECTIVES]
    return all(mine <= its for mine, its in pairs) and any(mine < its for mine, its in pairs)


def on_front(figures: Sequence[Figures | None]) -> list[bool]:
    """Mark those that no other beats; a setting without figures is not on the front, and beats none."""
    return [
        mine is not None and not any(other is not None and beats(other, mine) for other in figures) for mine in figures
    ]
