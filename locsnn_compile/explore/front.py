"""The Pareto front: settings that no other beats."""

from __future__ import annotations

from collections.abc import Sequence

from locsnn_compile.explore.point import Figures

FRONT_RULE = (
    "A setting is on the front where no other is at least as good in spike error, changed predictions, energy and chip "
    "time, and better in one of them."
)


OBJECTIVES = ("spike_error", "prediction_error", "energy_pj", "chip_time_ns")
"""The figures that are to be small."""


def beats(one: Figures, other: Figures) -> bool:
    """Tell whether one is at least as good in every objective, and better in one."""
    pairs = list(zip(_objectives(one), _objectives(other), strict=True))
    return all(mine <= its for mine, its in pairs) and any(mine < its for mine, its in pairs)


def on_front(figures: Sequence[Figures | None]) -> list[bool]:
    """Mark those that no other beats; a setting without figures is not on the front, and beats none."""
    return [
        mine is not None and not any(other is not None and beats(other, mine) for other in figures) for mine in figures
    ]


def _objectives(figures: Figures) -> list[float]:
    """Return the figures; 0 where nothing was compared, as both sides did nothing."""
    return [float(getattr(figures, name) or 0.0) for name in OBJECTIVES]
