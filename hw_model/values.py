"""Base classes of immutable types, and names of array types, for the whole package.

Derive from :class:`Frozen` for a frozen dataclass, from :class:`Sums` if two values can be added,
and from :class:`Shown` if the type may hold large arrays and its ``repr`` must stay short.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Self, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import ArrayLike as ArrayLike
from numpy.typing import NDArray

from hw_model.errors import counted

AnyArray = NDArray[Any]
BoolArray = NDArray[np.bool_]
ByteArray = NDArray[np.uint8]
Float32Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
Int32Array = NDArray[np.int32]
IntArray = NDArray[np.int64]
T = TypeVar("T", bound=np.generic)


def sealed(array: NDArray[T]) -> NDArray[T]:
    """Make an array read-only and return it: a frozen dataclass does not protect the contents of its arrays."""
    array.setflags(write=False)
    return array


def joined(parts: Sequence[NDArray[T]]) -> NDArray[T]:
    """Return the parts of a batch as one array; a single part is returned as it is, without a copy."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def picked(record: object, *names: str) -> dict[str, Any]:
    """Return the named attributes of an object as a dictionary."""
    return {name: getattr(record, name) for name in names}


_PLAIN = (str, int, float, type(None))
"""Types whose default values a ``repr`` leaves out."""
# Limits of a repr, chosen by hand: in a terminal it takes about five lines.
_LONGEST = 400
"""Characters."""
_LONGEST_TEXT = 40
"""Characters of one field."""
_MOST_ITEMS = 4
"""Items of a collection that are listed; of a longer one, only their number is shown."""


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
class Frozen:
    """Makes every class that derives from it a frozen dataclass.

    ``class Name(Frozen, eq=False)`` passes options to :func:`dataclasses.dataclass`. Classes with
    array fields pass ``eq=False`` and are compared by identity: ``==`` of arrays has no single answer.
    """

    def __init_subclass__(cls, **options: bool) -> None:
        dataclass(frozen=True, **options)(cls)


class Sums(Frozen, eq=False):
    """A value of which two can be added: ``+`` adds them field by field, as :func:`added` does."""

    def __add__(self, other: Self) -> Self:
        sums = {}
        for item in fields(self):
            sums[item.name] = added(getattr(self, item.name), getattr(other, item.name))
        return type(self)(**sums)


def added(left: Any, right: Any) -> Any:
    """Return the sum of two values.

    Dictionaries are added key by key; a key that only one of them has keeps its value. Everything
    else is added with ``+``.
    """
    if not isinstance(left, dict):
        return left + right
    sums = dict(left)
    for key, value in right.items():
        sums[key] = added(left[key], value) if key in left else value
    return sums


class Shown(Frozen, eq=False):
    """A value with a short ``repr``; compared by identity.

    The ``repr`` leaves out fields that have their default value, shows arrays by type and shape,
    and is cut after 400 characters.
    """

    def __init_subclass__(cls, **options: bool) -> None:
        super().__init_subclass__(**{"eq": False, "repr": False, **options})

    def __repr__(self) -> str:
        shown = []
        for item in fields(self):
            value = getattr(self, item.name)
            is_default = isinstance(value, _PLAIN) and value == item.default
            if item.repr and not is_default:
                shown.append(f"{item.name}={_short(value)}")
        text = f"{type(self).__name__}({', '.join(shown)}"
        return f"{_cut(text, _LONGEST)})"


def _short(value: Any) -> str:
    """Return the ``repr`` of a field's value or, if that is long, its type and size."""
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return str(value) if value.shape == () else f"<{value.dtype} {value.shape}>"
    if is_dataclass(value):
        name = getattr(value, "name", None)
        label = f" {_short(name)}" if isinstance(name, str) else ""
        return f"<{type(value).__name__}{label}>"
    if isinstance(value, str | bytes):
        return repr(value) if len(value) <= _LONGEST_TEXT else f"{value[:_LONGEST_TEXT]!r}..."
    if isinstance(value, Mapping):
        return f"<{counted(len(value), 'entry', 'entries')}>"
    if isinstance(value, Collection) and not isinstance(value, range):
        if len(value) > _MOST_ITEMS:
            return f"<{len(value)} items>"
        return f"({', '.join(map(_short, value))})"
    return _cut(repr(value), _LONGEST_TEXT)


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[:most]}..."


def ranges(first: IntArray, length: IntArray) -> IntArray:
    """Return the integers of many ranges, one range after the other.

    Range k holds ``length[k]`` integers from ``first[k]`` on: first (5, 2) and length (2, 1) give 5, 6, 2.
    """
    begin = np.cumsum(length) - length  # where each range begins in the result
    return np.asarray(np.arange(length.sum()) + np.repeat(first - begin, length))
