"""Round numbers for the axes of pictures."""

import math
from collections.abc import Sequence


def nice_step(least: float) -> float:
    """Return the smallest of 1, 2 or 5 times a power of ten that is at least this, apart from rounding."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= least * 0.999)


def round_numbers(low: float, high: float, about: int) -> list[float]:
    """Return about so many round numbers between the ends; none for an empty range."""
    if not high > low:
        return []
    step = nice_step((high - low) / about)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [i * step for i in range(first, last + 1)]


def step_ticks(steps: range, *, centred: bool) -> tuple[tuple[float, str], ...]:
    """Return round step numbers with their places; ``centred`` if a step is as wide as its column."""
    if len(steps) == 1:
        return ((0.5, f"{steps.start:,}"),)
    shift, length = (0.5, len(steps)) if centred else (0.0, len(steps) - 1)
    whole = [number for number in round_numbers(steps[0], steps[-1], 6) if number == int(number)]
    return tuple(((number - steps.start + shift) / length, f"{int(number):,}") for number in whole)


def value_axis(values: Sequence[float]) -> tuple[float, float, list[float]]:
    """Return the ends of an axis that holds the values with some room, and round numbers on it."""
    low, high = min(values), max(values)
    room = 0.06 * (high - low) or abs(high) or 1.0
    low, high = low - room, high + room
    return low, high, round_numbers(low, high, 4)
