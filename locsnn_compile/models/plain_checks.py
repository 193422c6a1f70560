"""Checks of the plain values of descriptions and files, each a line that names the value."""

from collections.abc import Sequence
from typing import TypeGuard

from hw_model.io.records import between, check_value
from locsnn_compile.errors import InputError

WRITE_AGAIN = "Write it again with 'locsnn train'."


def is_whole(value: object) -> TypeGuard[int]:
    """Tell whether a value is a whole number; True and False are not."""
    return isinstance(value, int) and not isinstance(value, bool)


def rises(values: Sequence[object], least: int, most: int) -> bool:
    """Tell whether values are whole numbers from ``least`` to ``most``, at least one, each above the one before."""
    whole = [value for value in values if is_whole(value) and least <= value <= most]
    return bool(values) and list(values) == sorted(set(whole)) and len(whole) == len(values)


def require_count(where: str, value: int, limit: int) -> None:
    """Raise ``InputError`` for what is not a whole number from 1 to ``limit``."""
    check_value(where, value, (int,), (between(1, limit),))


def require_rising(where: str, values: Sequence[object], least: int, most: int, what: str, fix: str) -> None:
    """Raise ``InputError`` for what are not numbers as by :func:`rises`; ``what``: numbers of what."""
    if not rises(values, least, most):
        measured = f"got {list(values)!r:.80} against {least}..{most}"
        raise InputError(where, f"they must be {what}, each larger than the one before", measured=measured, fix=fix)


def file_fault(where: str, what: str, measured: str = "") -> InputError:
    """Return the error of a checkpoint that no training wrote so."""
    return InputError(where, what, measured=measured, fix=WRITE_AGAIN)
