"""Checks of the plain values of a description, each a line that names the value."""

from __future__ import annotations

import math
from collections.abc import Sequence

from locsnn_compile.errors import InputError

_CORRECT = "Correct the description."


def is_whole(value: object) -> bool:
    """Tell whether a value is a whole number; True and False are not."""
    return isinstance(value, int) and not isinstance(value, bool)


def is_number(value: object) -> bool:
    """Tell whether a value is a number, which may be nan or infinite."""
    return is_whole(value) or isinstance(value, float)


def rises(values: Sequence[object], least: int, most: int) -> bool:
    """Tell whether values are whole numbers from ``least`` to ``most``, at least one, each above the one before."""
    whole = [value for value in values if isinstance(value, int) and is_whole(value) and least <= value <= most]
    return bool(values) and list(values) == sorted(set(whole)) and len(whole) == len(values)


def require_positive(where: str, value: float) -> None:
    """Raise ``InputError`` for what is not a finite number above 0."""
    if not (is_number(value) and math.isfinite(value) and value > 0):
        raise InputError(where, "it must be a finite number above 0", measured=f"got {value!r}", fix=_CORRECT)


def require_count(where: str, value: int, limit: int, least: int = 1) -> None:
    """Raise ``InputError`` for what is not a whole number from ``least`` to ``limit``."""
    if not (is_whole(value) and least <= value <= limit):
        measured = f"got {value!r} against {least}..{limit}"
        raise InputError(where, "it must be a whole number in range", measured=measured, fix=_CORRECT)
