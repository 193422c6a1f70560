"""Kinds of values that options take: what reads their text, and refuses it in a line."""

import math
from collections.abc import Callable
from typing import Any

from locsnn_compile.errors import InputError, did_you_mean


def start(text: str) -> float | str:
    """Read the start of recordings: ``first``, or seconds."""
    return text if text == "first" else float(text)


def numbers(text: str) -> tuple[float, ...]:
    """Read numbers separated by commas."""
    return tuple(map(float, text.split(",")))


def number(
    option: str,
    read: Callable[[str], Any],
    low: float | None = None,
    high: float | None = None,
    above: float | None = None,
) -> Callable[[str], Any]:
    """Return what reads the finite number of an option.

    A number that is not from ``low`` to ``high``, or not ``above`` a bound, is an ``InputError``.
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

    # argparse shows this name if the text is not a number.
    checked.__name__ = read.__name__
    return checked


def _range_in_words(low: float | None, high: float | None, above: float | None) -> str:
    if above is not None:
        return f"a number above {above:g}"
    if low is None:
        return "a finite number"
    if high is None:
        return f"a number from {low:g} up"
    return f"a number from {low:g} to {high:g}"


def choice(option: str, known: tuple[str, ...], read: Callable[[str], Any] = str) -> dict[str, Any]:
    """Return the arguments of argparse for an option that takes some values, given as texts.

    Other values are an ``InputError``. argcomplete completes ``choices``.
    """

    def checked(text: str) -> Any:
        value = read(text)
        if str(value) not in known:
            is_name = read is str
            fix = did_you_mean(text, known) if is_name else f"Choose from {', '.join(known)}."
            raise InputError(f"{option} {text}", "it is not known", fix=fix)
        return value

    checked.__name__ = read.__name__
    return {"type": checked, "choices": [read(text) for text in known]}
