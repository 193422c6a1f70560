"""Lay out records of arrays in memory, so that a compiled loop gets one address instead of many arrays.

The loops of the fast engine read some seventy arrays. If each were an argument, every function that
passes them on would take hundreds of numbers, and compiling would take about twice as long
(``docs/research/special-paths.md``). :mod:`hw_model.engine.private_numba` teaches numba to read
these records.
"""

from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from hw_model.values import AnyArray

R = TypeVar("R", bound=tuple[Any, ...])
INTEGERS = (int, np.integer)
Value = Any
"""What a field of a record can be: an array in C order, an integer, a bool, a tuple of integers, or a record."""


class PackedField(NamedTuple):
    """A field of a record, and the number of the 64-bit word at which it begins."""

    name: str
    word: int
    value: Value


class Packed(Generic[R]):
    """A record, a named tuple, and its layout in memory: words of 64 bits, field after field.

    An array takes a word for its address and one for each axis of its shape. A record within the
    record takes the words of its fields, and a :class:`Packed` one takes a word for its address.
    Loops may write to the arrays. But they rely on the words being constant, so a field can never
    be replaced by another array.
    """

    def __init__(self, record: R) -> None:
        self.record = record
        self.fields: list[PackedField] = []
        words: list[int] = []
        for name, value in zip(record._fields, record, strict=True):  # type: ignore[attr-defined]
            self.fields.append(PackedField(name, len(words), value))
            words.extend(_words_of(value))
        self._words = np.array(words, dtype=np.int64)
        self.address = self._words.ctypes.data


def pack(record: R) -> Packed[R]:
    """Lay out a named tuple for compiled loops. The result keeps its arrays alive: do not drop it while loops run."""
    return Packed(record)


def is_record(value: Value) -> bool:
    """Return whether a value is a named tuple of more than integers, which loops read field by field."""
    return hasattr(value, "_fields") and not all(isinstance(part, INTEGERS) for part in value)


def _words_of(value: Value) -> list[int]:
    """Return the words of a field; see :class:`Packed`."""
    if isinstance(value, Packed):
        return [value.address]
    if isinstance(value, np.ndarray):
        return _words_of_array(value)
    if isinstance(value, tuple):
        return [word for part in value for word in _words_of(part)]
    return [int(value)]


def _words_of_array(array: AnyArray) -> list[int]:
    # Loops compute addresses from the shape alone, which would be wrong for another order in memory.
    assert array.flags.c_contiguous
    return [array.ctypes.data, *array.shape]
