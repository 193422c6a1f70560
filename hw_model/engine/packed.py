"""Records of arrays, laid out in memory so that a compiled loop is given one address for all of them.

The loops read some seventy arrays. Were each an argument, every function that passes them on would
take hundreds of numbers, and would be compiled for seconds.
"""

from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from hw_model.values import AnyArray

R = TypeVar("R", bound=tuple[Any, ...])
INTEGERS = (int, np.integer)
Value = Any
"""What a record holds: arrays in C order, integers, truths, tuples of integers, and other records."""


class PackedField(NamedTuple):
    """A field of a record, and the number of the word of 64 bits at which it begins."""

    name: str
    word: int
    value: Value


class Packed(Generic[R]):
    """A record, and what it is in memory: words of 64 bits, field after field.

    An array is its address and its shape; a record within another lies where its field does; a
    packed one is an address. Loops take what stands in the words for constant. They may write to
    arrays, but no field may be given another array.
    """

    def __init__(self, record: R) -> None:
        self.record = record
        self.fields: list[PackedField] = []
        words: list[int] = []
        for name, value in _named(record):
            self.fields.append(PackedField(name, len(words), value))
            words.extend(_words_of(value))
        self._words = np.array(words, dtype=np.int64)
        self.address = self._words.ctypes.data


def pack(record: R) -> Packed[R]:
    """Lay a named tuple out for compiled loops. Its arrays live as long as what is returned."""
    return Packed(record)


def is_record(value: Value) -> bool:
    """Tell whether a value is a named tuple of more than integers, whose fields are read one by one."""
    return hasattr(value, "_fields") and not all(isinstance(part, INTEGERS) for part in value)


def _named(record: Any) -> list[tuple[str, Value]]:
    return list(zip(record._fields, record, strict=True))


def _words_of(value: Value) -> list[int]:
    if isinstance(value, Packed):
        return [value.address]
    if isinstance(value, np.ndarray):
        return _words_of_array(value)
    if isinstance(value, tuple):
        return [word for part in value for word in _words_of(part)]
    return [int(value)]


def _words_of_array(array: AnyArray) -> list[int]:
    assert array.flags.c_contiguous
    return [array.ctypes.data, *array.shape]
