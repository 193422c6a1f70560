"""Choose the macros that each memory of the core is made of, in a process that offers them.

A macro is a small memory of fixed size, with one port or two. Macros side by side make a row, which
is as wide as one word of the core's memory or several; copies of the row, called banks, make the
memory deep enough. Of all ways to make a memory, the one with the least energy and area is taken.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations_with_replacement

from hw_model.description.open_core import Macro
from hw_model.errors import InputError
from hw_model.values import Frozen

WIDEST = 4
"""The most macros side by side. Chosen by hand."""
PACKS = (1, 2, 4)
"""How many words a row may hold."""
PRICE = 2.0
"""Picojoules per recording that a square micrometre is worth. Chosen by hand: it weighs area
against energy."""


class Array(Frozen):
    """A memory as the core sees it, and its accesses in a recording.

    - ``words``, ``bits``: its size
    - ``ports``: the ports that it needs; 1 where it is written only between recordings
    - ``rows[k]``: reads, where a row holds ``k`` words
    - ``writes``: writes; like the reads, of all copies together
    - ``copies``: how many memories like this the core has
    - ``halves``: into how many groups of banks it may be split so that macros of one port do, since
      a write may wait for a read; 2 where words are read and later written in order, with even and
      odd words apart; 0 where macros of one port do not do
    """

    name: str
    words: int
    bits: int
    ports: int
    rows: Mapping[int, float]
    writes: float = 0.0
    copies: int = 1
    halves: int = 0


class Made(Frozen):
    """A way to make an array.

    - ``row``, ``macros``: the macros of a row, side by side: their names, and what they are
    - ``banks``: rows, one below the other
    - ``pack``: words of the array in a row of a bank
    - ``parts``: 2 where even words lie in even banks and odd words in odd banks, else 1
    """

    array: Array
    row: tuple[str, ...]
    macros: tuple[Macro, ...]
    banks: int
    pack: int
    parts: int

    @property
    def area_um2(self) -> float:
        """The area of all copies, in square micrometres."""
        return self.array.copies * self.banks * math.fsum(macro.area for macro in self.macros)

    @property
    def energy_pj(self) -> float:
        """The energy of a recording's accesses to all copies together, in picojoules."""
        reads = self.array.rows.get(self.pack, self.array.rows[1])
        return math.fsum(
            reads * macro.read_pj + self.array.writes * macro.write_pj for macro in self.macros
        )

    def pieces(self) -> "Iterator[Piece]":
        """Yield the macros of one copy, with the words and bits that each of them holds."""
        array = self.array
        words_of_row = self.pack * self.parts  # of even and odd banks together
        for bank in range(self.banks):
            rows_before = bank // self.parts * self.macros[0].words
            first = rows_before * words_of_row + bank % self.parts
            bit = 0
            for name, macro in zip(self.row, self.macros, strict=True):
                yield Piece(
                    memory=array.name,
                    copies=array.copies,
                    macro=name,
                    first=first,
                    every=words_of_row,
                    rows=macro.words,
                    pack=self.pack,
                    bit=bit,
                    bits=macro.bits,
                )
                bit += macro.bits


class Piece(Frozen):
    """A macro of a plan, and the part of a memory that it holds.

    Its row 0 holds word ``first`` of the memory, and each further row the word ``every`` words on,
    with ``pack`` words in a row. Of a row's bits it holds ``bits``, from ``bit`` on.
    """

    memory: str
    copies: int
    macro: str
    first: int
    every: int
    rows: int
    pack: int
    bit: int
    bits: int


def ways(array: Array, macros: Mapping[str, Macro]) -> Iterator[Made]:
    """Yield all ways in which an array may be made of macros."""
    # Macros have one port or two. With fewer ports than the array needs, its words are split into
    # parts.
    for ports in (1, 2) if array.halves else range(array.ports, 3):
        parts = 1 if ports >= array.ports else array.halves
        for depth in sorted({macro.words for macro in macros.values() if macro.ports == ports}):
            of_kind = [
                (name, macro)
                for name, macro in macros.items()
                if (macro.ports, macro.words) == (ports, depth)
            ]
            of_kind.sort(key=lambda pair: -pair[1].bits)  # wide macros first
            # A word that is written during a recording must not share its row.
            for pack in PACKS if array.ports == 1 else (1,):
                banks = parts * -(-array.words // (parts * pack * depth))
                usable = [(name, macro) for name, macro in of_kind if banks <= macro.banks]
                for row in _rows(usable, pack * array.bits):
                    names, kinds = zip(*row, strict=True)
                    yield Made(array, names, kinds, banks, pack, parts)


def _rows(
    macros: Sequence[tuple[str, Macro]], bits: int
) -> Iterator[tuple[tuple[str, Macro], ...]]:
    """Yield rows of macros that hold ``bits`` bits, without a macro that is not needed."""
    for side_by_side in range(1, WIDEST + 1):
        for row in combinations_with_replacement(macros, side_by_side):
            # The last macro is the narrowest: without it, the row must be too narrow.
            _, last = row[-1]
            bits_before_last = sum(macro.bits for _, macro in row[:-1])
            if bits_before_last < bits <= bits_before_last + last.bits:
                yield row


def plan(arrays: Iterable[Array], macros: Mapping[str, Macro], price: float = PRICE) -> list[Made]:
    """Return the cheapest way to make each array; raise an ``InputError`` if no macros hold one.

    ``price``: picojoules that a square micrometre is worth.
    """
    chosen = []
    for array in arrays:
        options = list(ways(array, macros))
        if not options:
            raise InputError(
                f"memory {array.name!r}",
                "no macros hold it",
                fix="Give wider macros or more ports.",
            )
        chosen.append(min(options, key=lambda made: made.energy_pj + price * made.area_um2))
    return chosen


def as_csv(pieces: Iterable[Piece]) -> bytes:
    """Return a plan as a CSV table, with a row per macro."""
    head = "memory,copies,macro,first word,words to the next row,rows,words in a row,first bit,bits"
    rows = [",".join(map(str, vars(piece).values())) for piece in pieces]
    return "\n".join([head, *rows, ""]).encode()
