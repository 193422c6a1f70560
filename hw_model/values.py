"""Values: frozen dataclasses by their base, arrays by what they hold; and what one is in a line."""

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
    """Return an array itself, which nobody can write to any more: frozen dataclasses do not freeze their arrays."""
    array.setflags(write=False)
    return array


def joined(parts: Sequence[NDArray[T]]) -> NDArray[T]:
    """Return the parts of a batch as one array."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def picked(record: object, *names: str) -> dict[str, Any]:
    """Return what a value holds under some names, by these names."""
    return {name: getattr(record, name) for name in names}


_PLAIN = (str, int, float, type(None))
_LONGEST, _LONGEST_TEXT, _MOST_ITEMS = 400, 40, 4


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
class Frozen:
    """Classes that derive from it are dataclasses that nobody changes; ``class Name(Frozen, eq=False)`` gives options.

    What holds arrays is compared by identity, with ``eq=False``: ``==`` of arrays has no single answer.
    """

    def __init_subclass__(cls, **options: bool) -> None:
        dataclass(frozen=True, **options)(cls)


class Sums(Frozen, eq=False):
    """A value that adds up field by field."""

    def __add__(self, other: Self) -> Self:
        return type(self)(
            *(added(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        )


def added(one: Any, other: Any) -> Any:
    """Add two values: dictionaries key by key, of which each may lack some; all else by ``+``."""
    if not isinstance(one, dict):
        return one + other
    return {
        **one,
        **{key: added(one[key], found) if key in one else found for key, found in other.items()},
    }


class Shown(Frozen, eq=False):
    """A value that says what it holds, except usual values, in at most 400 characters; compared by identity."""

    def __init_subclass__(cls, **options: bool) -> None:
        super().__init_subclass__(**{"eq": False, "repr": False, **options})

    def __repr__(self) -> str:
        parts = ((field, getattr(self, field.name)) for field in fields(self) if field.repr)
        said = (
            f"{f.name}={_part(part)}"
            for f, part in parts
            if not (isinstance(part, _PLAIN) and part == f.default)
        )
        text = f"{type(self).__name__}({', '.join(said)}"
        return f"{_cut(text, _LONGEST)})"


def _part(value: Any) -> str:
    """Return a field's value: itself where that is short, else what it is."""
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return str(value) if value.shape == () else f"<{value.dtype} {value.shape}>"
    if is_dataclass(value):
        name = getattr(value, "name", None)
        return f"<{type(value).__name__}{f' {_part(name)}' if isinstance(name, str) else ''}>"
    if isinstance(value, str | bytes):
        return repr(value) if len(value) <= _LONGEST_TEXT else f"{value[:_LONGEST_TEXT]!r}..."
    if isinstance(value, Mapping):
        return f"<{counted(len(value), 'entry', 'entries')}>"
    if isinstance(value, Collection) and not isinstance(value, range):
        few = len(value) <= _MOST_ITEMS
        return f"({', '.join(map(_part, value))})" if few else f"<{len(value)} items>"
    return _cut(repr(value), _LONGEST_TEXT)


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[:most]}..."


def ranges(first: IntArray, length: IntArray) -> IntArray:
    """Return the numbers of many ranges, one range after the other: 5, 6 and 2 for ranges from 5 and 2 of 2 and 1."""
    begin = np.cumsum(length) - length
    return np.asarray(np.arange(length.sum()) + np.repeat(first - begin, length))
