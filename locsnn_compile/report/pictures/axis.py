"""Axes of charts: where values lie between two ends, and round numbers to write there."""

import math
from collections.abc import Callable, Sequence

from hw_model.values import Frozen
from locsnn_compile.report.pictures.ticks import nice_step

_TICKS = 6
"""Most ticks of a linear axis, besides the one at 0."""


class Axis(Frozen):
    """Values between two ends on a linear or logarithmic scale; ``text`` writes the ``ticks``."""

    low: float
    high: float
    ticks: tuple[float, ...]
    text: Callable[[float], str]
    log: bool = False

    def place(self, value: float) -> float:
        """Return the place of a value, 0..1."""
        return ((math.log10(value) if self.log else value) - self.low) / (self.high - self.low)


def linear_axis(values: Sequence[float], text: Callable[[float], str]) -> Axis:
    """Return an axis from 0 to half a tick beyond the largest value."""
    largest = max(values, default=0.0)
    step = nice_step(largest / _TICKS) if largest > 0 else 1.0
    high = largest + 0.5 * step if largest > 0 else step
    return Axis(0.0, high, tuple(i * step for i in range(math.floor(high / step + 1e-9) + 1)), text)


def log_axis(values: Sequence[float], text: Callable[[float], str]) -> Axis:
    """Return an axis for values above 0, with a tick per decade or, for few decades, at 1, 2 and 5."""
    scaled = [math.log10(value) for value in values] or [0.0, 1.0]
    low, high = min(scaled), max(scaled)
    beyond = 0.04 * (high - low) or 0.5
    first, last = math.ceil(low - 1e-9), math.floor(high + 1e-9)
    if last - first < 2:
        tried = (m * 10.0**decade for decade in range(first - 1, last + 1) for m in (1, 2, 5))
        ticks = tuple(value for value in tried if low - 1e-9 <= math.log10(value) <= high + 1e-9)
    else:
        ticks = tuple(10.0**decade for decade in range(first, last + 1, max(1, math.ceil((last - first + 1) / 8))))
    return Axis(low - beyond, high + beyond, ticks, text, log=True)
