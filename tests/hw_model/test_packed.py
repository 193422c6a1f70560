"""Compiled loops read from a packed record what Python put into it: every kind of field, by a loop of the test."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from hw_model.engine import compiled
from hw_model.engine.packed import Packed, pack


class Pair(NamedTuple):
    """A tuple of integers, which is a field like an integer."""

    first: int
    last: int


class Part(NamedTuple):
    """A record that is a field of another one."""

    bytes_of_rows: Any
    many: int


class Whole(NamedTuple):
    """A record with a field of every kind.

    A named tuple within it (``inline``) is laid out in its memory; for a packed one (``elsewhere``) it holds an address.
    """

    line: Any
    square: Any
    block: Any
    marks: Any
    count: Any
    is_set: Any
    pair: Pair
    inline: Part
    elsewhere: Packed[Part]


def whole(dtype: str = "int32") -> Whole:
    """Return a record; ``dtype`` is the type of one of its arrays."""
    return Whole(
        line=np.arange(5, dtype=np.int64) - 2,
        square=np.arange(12, dtype=dtype).reshape(3, 4) * -7,
        block=np.arange(24, dtype=np.int16).reshape(2, 3, 4),
        marks=np.array([False, True, False]),
        count=-(1 << 40),
        is_set=True,
        pair=Pair(-3, 1 << 35),
        inline=Part(np.arange(6, dtype=np.uint8).reshape(2, 3) + 200, 6),
        elsewhere=pack(Part(np.zeros((0, 4), np.uint8), -1)),
    )


@compiled.compiled
def _read(record, numbers):  # type: ignore[no-untyped-def]
    """Read every field of a :class:`Whole`, and write to one of its arrays."""
    numbers[0] = record.line[1]
    numbers[1] = record.square[2, 3]
    numbers[2] = record.block[1, 2, 3]
    numbers[3] = record.marks[0] + 10 * record.marks[1]
    numbers[4] = record.count
    numbers[5] = 1 if record.is_set else 0
    numbers[6] = record.pair.first
    numbers[7] = record.pair.last
    numbers[8] = record.inline.bytes_of_rows[1, 2] + record.inline.many
    numbers[9] = record.elsewhere.bytes_of_rows.shape[1] * record.elsewhere.many
    numbers[10] = record.block.strides[0] + record.block.size
    record.line[0] = 99


@pytest.mark.parametrize("dtype", ["int32", "int64"])
def test_a_loop_reads_every_field_and_writes_into_arrays(dtype):
    record = whole(dtype)
    numbers = np.zeros(11, np.int64)
    _read(pack(record), numbers)
    assert numbers.tolist() == [
        1 - 2,  # line[1]
        -7 * 11,  # square[2, 3] is entry 11 of 12
        23,  # block[1, 2, 3] is the last entry of 24
        0 + 10 * 1,  # of three marks only the second is set
        -(1 << 40),
        1,
        -3,
        1 << 35,
        (200 + 5) + 6,  # bytes_of_rows[1, 2] is entry 5 of 6
        4 * -1,
        3 * 4 * 2 + 2 * 3 * 4,  # bytes from block[0] to block[1], and its entries
    ]
    assert record.line[0] == 99


def test_records_of_one_name_differ_by_the_types_of_their_fields():
    narrow, wide = (numba.typeof(pack(whole(dtype))) for dtype in ("int32", "int64"))
    assert narrow != wide
    # The name that numba gives to the code of a function contains these: equal ones would call the wrong code.
    assert narrow.mangling_args != wide.mangling_args
    assert narrow == numba.typeof(pack(whole()))


def test_a_record_has_no_other_fields():
    @numba.njit
    def read(record):  # type: ignore[no-untyped-def]
        return record.nothing

    with pytest.raises(numba.TypingError, match="Unknown attribute 'nothing' of type Whole"):
        read(pack(whole()))


def test_an_array_that_is_not_in_c_order_is_not_packed():
    with pytest.raises(AssertionError):
        pack(Part(np.zeros((3, 4), np.uint8).T, 0))
