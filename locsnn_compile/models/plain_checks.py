"""Checks of plain values in descriptions and files; each error is a line that names the value."""

from collections.abc import Sequence
from typing import Annotated, TypeGuard

from hw_model.io.records import Must, between, check_value
from locsnn_compile.errors import InputError

_NAME = Must(lambda text: 0 < len(text) <= 200 and text.isprintable() and not {"/", "\\"} & {*text}, "that is a name")
PlainName = Annotated[str, _NAME]
"""Up to 200 printable characters without slashes."""
WRITE_AGAIN = "Write it again with 'locsnn train'."


def is_whole(value: object) -> TypeGuard[int]:
    """Tell whether a value is a whole number; True and False are not."""
    return isinstance(value, int) and not isinstance(value, bool)


def rises(values: Sequence[object], least: int, most: int) -> bool:
    """Tell whether values are one or more whole numbers from ``least`` to ``most``, each above the previous one."""
    whole = [value for value in values if is_whole(value) and least <= value <= most]
    return bool(values) and list(values) == sorted(set(whole)) and len(whole) == len(values)


def require_count(where: str, value: int, limit: int) -> None:
    """Raise ``InputError`` unless a value is a whole number from 1 to ``limit``."""
    check_value(where, value, (int,), (between(1, limit),))


def require_rising(where: str, values: Sequence[object], least: int, most: int, what: str, fix: str) -> None:
    """Raise ``InputError`` unless :func:`rises` holds; ``what`` names the numbers."""
    if not rises(values, least, most):
        measured = f"got {list(values)!r:.80} against {least}..{most}"
        raise InputError(where, f"they must be {what}, each larger than the one before", measured=measured, fix=fix)


def file_fault(where: str, what: str, measured: str = "") -> InputError:
    """Return the error for a checkpoint that ``locsnn train`` would not have written."""
    return InputError(where, what, measured=measured, fix=WRITE_AGAIN)
