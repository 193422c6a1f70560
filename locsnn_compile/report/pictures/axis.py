"""Axes of charts: where values lie between two ends, and round numbers to write there."""

import math
from collections.abc import Callable, Sequence

from hw_model.values import Frozen

_TICKS = 6
"""Most ticks of a linear axis, besides the one at 0."""
_LOG_TICKS = 8
"""Most ticks of a logarithmic axis of several decades."""
_ROUNDING = 1e-9
"""By how much of a tick a value may miss it and still stand on it."""


class Axis(Frozen):
    """Values between two ends on a scale that is linear or, where the ends are powers of ten, logarithmic.

    ``text`` writes the ``ticks``.
    """

    low: float
    high: float
    ticks: tuple[float, ...]
    text: Callable[[float], str]
    log: bool = False

    def place(self, value: float) -> float:
        """Return the place of a value, 0..1."""
        scaled = math.log10(value) if self.log else value
        return (scaled - self.low) / (self.high - self.low)

    @property
    def places(self) -> list[tuple[float, str]]:
        """The place and the text of each tick."""
        return [(self.place(value), self.text(value)) for value in self.ticks]


def linear_axis(values: Sequence[float], text: Callable[[float], str]) -> Axis:
    """Return an axis from 0 to half a tick beyond the largest value."""
    largest = max(values, default=0.0)
    if largest <= 0:
        return Axis(0.0, 1.0, (0.0, 1.0), text)
    step = nice_step(largest / _TICKS)
    high = largest + 0.5 * step
    last_tick = math.floor(high / step + _ROUNDING)
    return Axis(0.0, high, tuple(i * step for i in range(last_tick + 1)), text)


def log_axis(values: Sequence[float], text: Callable[[float], str]) -> Axis:
    """Return an axis for values above 0, with a tick per decade or, for few decades, at 1, 2 and 5."""
    exponents = [math.log10(value) for value in values] or [0.0, 1.0]
    low = min(exponents)
    high = max(exponents)
    room = 0.04 * (high - low) or 0.5  # of a single value
    return Axis(low - room, high + room, _log_ticks(low, high), text, log=True)


def _log_ticks(low: float, high: float) -> tuple[float, ...]:
    """Return round numbers between two powers of ten, given by their exponents."""
    first = math.ceil(low - _ROUNDING)
    last = math.floor(high + _ROUNDING)
    if last - first >= 2:
        decades_apart = math.ceil((last - first + 1) / _LOG_TICKS)
        return tuple(10.0**decade for decade in range(first, last + 1, decades_apart))
    candidates = (m * 10.0**decade for decade in range(first - 1, last + 1) for m in (1, 2, 5))
    return tuple(
        value for value in candidates if low - _ROUNDING <= math.log10(value) <= high + _ROUNDING
    )


def nice_step(least: float) -> float:
    """Return the smallest of 1, 2 or 5 times a power of ten that is at least this, apart from rounding."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= least * 0.999)


def round_numbers(low: float, high: float, about: int) -> list[float]:
    """Return about as many round numbers as asked between the ends; none for an empty range."""
    if not high > low:
        return []
    step = nice_step((high - low) / about)
    first = math.ceil(low / step - _ROUNDING)
    last = math.floor(high / step + _ROUNDING)
    return [i * step for i in range(first, last + 1)]


def step_axis(steps: range, *, centred: bool) -> Axis:
    """Return an axis of steps with round numbers on it; ``centred`` if a step is as wide as its column."""
    first = steps[0]
    last = steps[-1]
    room = 0.5 if centred or first == last else 0.0
    ticks = [number for number in round_numbers(first, last, _TICKS) if number == int(number)]
    return Axis(first - room, last + room, tuple(ticks or [float(first)]), "{:,.0f}".format)


def value_axis(values: Sequence[float], unit: str = "") -> Axis:
    """Return an axis that holds the values with some room, and round numbers on it."""
    least = min(values)
    largest = max(values)
    room = 0.06 * (largest - least) or abs(largest) or 1.0
    low = least - room
    high = largest + room
    return Axis(low, high, tuple(round_numbers(low, high, 4)), lambda value: f"{value:.6g}{unit}")
