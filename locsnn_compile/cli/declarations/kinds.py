"""Kinds of values that options take: functions for argparse that parse a text or refuse it in a line.

argparse words its own errors: for a range or a choice, these functions raise ``InputError`` instead,
which says what would be accepted.
"""

import math
from collections.abc import Callable
from typing import Any

from locsnn_compile.errors import InputError, did_you_mean

# argparse shows the names of the next two functions if they raise ValueError: "invalid start value".


def start(text: str) -> float | str:
    """Parse the start of recordings: ``first``, or seconds."""
    return text if text == "first" else float(text)


def numbers(text: str) -> tuple[float, ...]:
    """Parse numbers separated by commas."""
    return tuple(map(float, text.split(",")))


def number(
    option: str,
    read: Callable[[str], Any],
    low: float | None = None,
    high: float | None = None,
    above: float | None = None,
) -> Callable[[str], Any]:
    """Return a function that parses the finite number of an option by ``read``: ``int`` or ``float``.

    The function raises ``InputError`` for a number that is not between ``low`` and ``high``, both
    included, or not larger than ``above``.
    """
    accepted = _range_in_words(low, high, above)

    def checked(text: str) -> Any:
        value = read(text)
        is_high_enough = low is None or value >= low
        is_low_enough = high is None or value <= high
        is_above = above is None or value > above
        is_in_range = is_high_enough and is_low_enough and is_above
        if not (math.isfinite(value) and is_in_range):
            raise InputError(f"{option} {text}", "it is out of range", fix=f"Give {accepted}.")
        return value

    # argparse shows this name if the text is not a number: "invalid int value".
    checked.__name__ = read.__name__
    return checked


def _range_in_words(low: float | None, high: float | None, above: float | None) -> str:
    """Return the numbers that are accepted, in words; no option has ``above`` with another bound."""
    if above is not None:
        return f"a number above {above:g}"
    if low is None:
        return "a finite number"
    if high is None:
        return f"a number from {low:g} up"
    return f"a number from {low:g} to {high:g}"


def choice(option: str, known: tuple[str, ...], read: Callable[[str], Any] = str) -> dict[str, Any]:
    """Return keyword arguments of ``add_argument`` for an option that takes only the ``known`` values.

    ``known`` are texts, which ``read`` turns into values. Any other value is an ``InputError``, raised
    by ``type``; ``choices`` are for argcomplete, which completes them.
    """

    def checked(text: str) -> Any:
        value = read(text)
        # Compared as text after reading, so that "08" is the number 8.
        if str(value) not in known:
            # A number has no misspelling to correct.
            is_name = read is str
            fix = did_you_mean(text, known) if is_name else f"Choose from {', '.join(known)}."
            raise InputError(f"{option} {text}", "it is not known", fix=fix)
        return value

    # argparse shows this name if ``read`` raises ValueError.
    checked.__name__ = read.__name__
    return {"type": checked, "choices": [read(text) for text in known]}
