"""Axes of charts: map values to places between the two ends of an axis, and choose round numbers as ticks.

Round numbers are 1, 2 or 5 times a power of ten, or multiples of such a number. All numbers of ticks and all room at
the ends are chosen by hand, so that the texts of ticks do not touch in a chart of about 340 pixels.
"""

import math
from collections.abc import Callable, Sequence

from hw_model.values import Frozen

_TICKS = 6
"""Most ticks of a linear axis in addition to the one at 0."""
_VALUE_TICKS = 4
"""About how many ticks an axis of potentials has; their texts may be long."""
_LOG_TICKS = 8
"""Most ticks of a logarithmic axis of several decades."""
_ROOM = 0.06
"""Room between the values and each end of a linear axis that does not begin at 0, as a share of their range."""
_LOG_ROOM = 0.04
"""The same for a logarithmic axis, as a share of the decades between the values."""
_ROUNDING = 1e-9
"""Errors of floats below this share of a step between ticks are ignored: 0.3 / 0.1 is slightly below 3."""


class Axis(Frozen):
    """An axis of a chart, on a linear or a logarithmic scale.

    - ``low``, ``high``: the values at the ends; with ``log``, their decimal logarithms
    - ``ticks``: the values that are marked, and ``text`` the function that writes them
    """

    low: float
    high: float
    ticks: tuple[float, ...]
    text: Callable[[float], str]
    log: bool = False

    def place(self, value: float) -> float:
        """Return where a value lies: 0 at the low end, 1 at the high end."""
        scaled = math.log10(value) if self.log else value
        return (scaled - self.low) / (self.high - self.low)

    @property
    def places(self) -> list[tuple[float, str]]:
        """The place and the text of each tick."""
        return [(self.place(value), self.text(value)) for value in self.ticks]


def linear_axis(values: Sequence[float], text: Callable[[float], str]) -> Axis:
    """Return an axis from 0 to half a step between ticks beyond the largest value."""
    largest = max(values, default=0.0)
    if largest <= 0:
        return Axis(low=0.0, high=1.0, ticks=(0.0, 1.0), text=text)
    step = nice_step(largest / _TICKS)
    # Half a step of room, so that a mark at the largest value is not cut by the edge.
    high = largest + 0.5 * step
    last_tick = math.floor(high / step + _ROUNDING)
    return Axis(0.0, high, tuple(i * step for i in range(last_tick + 1)), text)


def log_axis(values: Sequence[float], text: Callable[[float], str]) -> Axis:
    """Return an axis for values above 0, with a tick per decade or, for few decades, at 1, 2 and 5."""
    exponents = [math.log10(value) for value in values] or [0.0, 1.0]
    low = min(exponents)
    high = max(exponents)
    # A single value has no range; it gets half a decade on each side.
    room = _LOG_ROOM * (high - low) or 0.5
    return Axis(low - room, high + room, _log_ticks(low, high), text, log=True)


def _log_ticks(low: float, high: float) -> tuple[float, ...]:
    """Return round numbers between 10**low and 10**high."""
    first_decade = math.ceil(low - _ROUNDING)
    last_decade = math.floor(high + _ROUNDING)
    if last_decade - first_decade >= 2:
        decades_apart = math.ceil((last_decade - first_decade + 1) / _LOG_TICKS)
        return tuple(10.0**decade for decade in range(first_decade, last_decade + 1, decades_apart))
    # From one decade below, as 2 or 5 times that power of ten may still lie between the ends.
    candidates = [
        factor * 10.0**decade
        for decade in range(first_decade - 1, last_decade + 1)
        for factor in (1, 2, 5)
    ]
    return tuple(
        value for value in candidates if low - _ROUNDING <= math.log10(value) <= high + _ROUNDING
    )


def nice_step(least: float) -> float:
    """Return the smallest of 1, 2 or 5 times a power of ten that is at least ``least``, apart from rounding."""
    power = 10.0 ** math.floor(math.log10(least))
    # 0.1 % too small is near enough: floats round, and a slightly larger number of ticks does no harm.
    enough = least * 0.999
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= enough)


def round_numbers(low: float, high: float, about: int) -> list[float]:
    """Return round numbers between the ends, about as many as ``about``; none for an empty range."""
    if not high > low:
        return []
    step = nice_step((high - low) / about)
    first = math.ceil(low / step - _ROUNDING)
    last = math.floor(high / step + _ROUNDING)
    return [i * step for i in range(first, last + 1)]


def step_axis(steps: range, *, centred: bool) -> Axis:
    """Return an axis of time steps, with round numbers as ticks.

    ``centred``: a step is drawn as a column around its number, as in a raster. Otherwise it is a point, as in a
    curve, and the axis ends at the first and the last step.
    """
    first = steps[0]
    last = steps[-1]
    # A single step would give an axis without length.
    room = 0.5 if centred or first == last else 0.0
    # Few steps may give ticks of 0.5, but there is no half step.
    ticks = [number for number in round_numbers(first, last, _TICKS) if number == int(number)]
    return Axis(first - room, last + room, tuple(ticks or [float(first)]), "{:,.0f}".format)


def value_axis(values: Sequence[float], unit: str = "") -> Axis:
    """Return an axis that holds the values with some room, and round numbers as ticks."""
    least = min(values)
    largest = max(values)
    # Equal values have no range; then the axis reaches from 0 to twice the value, or from -1 to 1 around 0.
    room = _ROOM * (largest - least) or abs(largest) or 1.0
    low = least - room
    high = largest + room
    ticks = round_numbers(low, high, _VALUE_TICKS)
    return Axis(low, high, tuple(ticks), lambda value: f"{value:.6g}{unit}")
