"""Checks of the plain values of descriptions and files, each a line that names the value."""

import math
from collections.abc import Sequence
from functools import lru_cache
from types import NoneType, UnionType
from typing import TypeGuard, get_args, get_origin, get_type_hints

from locsnn_compile.errors import InputError

_CORRECT = "Correct the description."
KIND_WORDS = {
    str: "text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    dict: "a dict",
    list: "a list",
    NoneType: "None",
}
"""What messages call a type."""
WRITE_AGAIN = "Write it again with 'locsnn train'."
_HELD: dict[type, tuple[type, ...]] = {float: (float, int), tuple: (list, tuple)}
"""Type of a field -> those that a file may have for it, where they are others."""


@lru_cache
def field_kinds(record: type) -> dict[str, tuple[type, ...]]:
    """Return the types that a file may have for each field of a dataclass of plain values."""
    found = {}
    for name, hint in get_type_hints(record).items():
        parts = get_args(hint) if isinstance(hint, UnionType) else (hint,)
        plain = [get_origin(part) or part for part in parts]
        found[name] = tuple(kind for part in plain for kind in _HELD.get(part, (part,)))
    return found


def is_one_of(value: object, kinds: tuple[type, ...]) -> bool:
    """Tell whether a value is of one of the types; True and False are no numbers."""
    return isinstance(value, kinds) and (bool in kinds or not isinstance(value, bool))


def is_whole(value: object) -> TypeGuard[int]:
    """Tell whether a value is a whole number; True and False are not."""
    return isinstance(value, int) and not isinstance(value, bool)


def is_number(value: object) -> bool:
    """Tell whether a value is a number, which may be nan or infinite."""
    return is_whole(value) or isinstance(value, float)


def rises(values: Sequence[object], least: int, most: int) -> bool:
    """Tell whether values are whole numbers from ``least`` to ``most``, at least one, each above the one before."""
    whole = [value for value in values if is_whole(value) and least <= value <= most]
    return bool(values) and list(values) == sorted(set(whole)) and len(whole) == len(values)


def require(holds: bool, where: str, what: str, value: object, fix: str = _CORRECT) -> None:
    """Raise ``InputError`` for a value where ``what`` it must be does not hold."""
    if not holds:
        raise InputError(where, f"it must be {what}", measured=f"got {value!r}", fix=fix)


def require_positive(where: str, value: float) -> None:
    """Raise ``InputError`` for what is not a finite number above 0."""
    require(is_number(value) and 0 < value < math.inf, where, "a finite number above 0", value)


def require_count(where: str, value: int, limit: int, least: int = 1) -> None:
    """Raise ``InputError`` for what is not a whole number from ``least`` to ``limit``."""
    if not (is_whole(value) and least <= value <= limit):
        measured = f"got {value!r} against {least}..{limit}"
        raise InputError(where, "it must be a whole number in range", measured=measured, fix=_CORRECT)


def require_rising(where: str, values: Sequence[object], least: int, most: int, what: str, fix: str) -> None:
    """Raise ``InputError`` for what are not numbers as by :func:`rises`; ``what``: numbers of what."""
    if not rises(values, least, most):
        measured = f"got {list(values)!r:.80} against {least}..{most}"
        raise InputError(where, f"they must be {what}, each larger than the one before", measured=measured, fix=fix)


def file_fault(where: str, what: str, measured: str = "") -> InputError:
    """Return the error of a checkpoint that no training wrote so."""
    return InputError(where, what, measured=measured, fix=WRITE_AGAIN)
