"""Memory words as bits: named fields from bit 0 on, and hexadecimal text for ``$readmemh``."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from hw_model.values import ByteArray, Frozen, IntArray

BitArray = ByteArray


class Field(Frozen):
    """``width`` bits of a word; a signed field is two's complement."""

    name: str
    width: int
    signed: bool = False

    def holds(self, values: IntArray) -> bool:
        """Whether every value fits."""
        if values.size == 0:
            return True
        low = 0
        high = (1 << self.width) - 1
        if self.signed:
            half = 1 << self.width - 1
            low = -half
            high = half - 1
        return bool(low <= values.min() and values.max() <= high)


class Layout(Frozen):
    """A word: its fields, the first at bit 0, each next one above it."""

    fields: tuple[Field, ...]

    @property
    def width(self) -> int:
        """Bits of the word."""
        return sum(field.width for field in self.fields)

    @classmethod
    def of(cls, *signed: str, **widths: int) -> "Layout":
        """Return a layout, given each field's width by name, and the names of signed fields."""
        return cls(tuple(Field(name, width, name in signed) for name, width in widths.items()))

    def pack(self, columns: Mapping[str, IntArray]) -> BitArray:
        """Return words as bits (words, width), bit 0 first, given ``columns[name]`` (words,)."""
        assert list(columns) == [field.name for field in self.fields]
        return np.concatenate(
            [bits_of(columns[field.name], field) for field in self.fields], axis=1
        )

    def pack_rows(self, rows: Sequence[Mapping[str, int]]) -> BitArray:
        """Return words as bits, as :meth:`pack` does, given the values of each word by field."""
        names = [field.name for field in self.fields]
        columns = {name: np.array([row[name] for row in rows], dtype=np.int64) for name in names}
        return self.pack(columns)

    def describe(self) -> dict[str, object]:
        """Return the description of the word that goes into a manifest."""
        low = 0
        fields = []
        for field in self.fields:
            fields.append(
                {"name": field.name, "low": low, "width": field.width, "signed": field.signed}
            )
            low += field.width
        return {"width": self.width, "fields": fields}


def bits_for(largest: int) -> int:
    """Return how many bits hold the numbers 0 to ``largest``, at least one."""
    return max(1, int(largest).bit_length())


def bits_of(values: IntArray, field: Field) -> BitArray:
    """Return values (n,) as bits (n, width), bit 0 first; every value fits its field."""
    assert field.holds(values), field.name
    shifts = np.arange(field.width)
    return ((values[:, None] >> shifts) & 1).astype(np.uint8)


def hex_words(bits: BitArray) -> bytes:
    """Return words (words, width), bit 0 first, as lines of hexadecimal digits, highest first.

    Words of no bits are written as 0.
    """
    if bits.shape[1] == 0:
        bits = np.zeros((len(bits), 1), dtype=np.uint8)
    digits = math.ceil(bits.shape[1] / 4)
    # Whole bytes, the highest first; a leading digit too many is cut off below.
    words = np.packbits(bits, axis=1, bitorder="little")[:, ::-1]
    text = np.frombuffer(words.tobytes().hex().encode(), dtype=np.uint8)
    lines = text.reshape(len(bits), 2 * words.shape[1])[:, -digits:]
    return np.pad(lines, ((0, 0), (0, 1)), constant_values=ord("\n")).tobytes()
