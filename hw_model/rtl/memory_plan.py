"""What memories are made of in a process with macros: the search for the cheapest plan.

A row of macros side by side holds one word or several; banks of rows follow each other. The plan with the least energy
and area is taken.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations_with_replacement

from hw_model.description.open_core import Macro
from hw_model.errors import InputError
from hw_model.values import Frozen

WIDEST = 4
"""Macros side by side, at most."""
PACKS = (1, 2, 4)
"""Words that a row may hold."""
PRICE = 2.0
"""Picojoules per recording that a square micrometre is worth. Chosen, not measured: what the plan is told to prefer."""


class Array(Frozen):
    """A memory as the core sees it, and what a recording does to all ``copies`` of it.

    ``ports``: at least these, 1 where it is written only between recordings. ``halves``: groups of banks of one port
    that do as well, since a write may wait for a read (2: words are read and later written in order, even and odd ones
    lie apart); 0: none do. ``rows[k]``: reads of rows of ``k`` words.
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
    """An array of ``banks`` rows of macros, by name, ``pack`` words in each; ``parts``: 2 of even and odd banks."""

    array: Array
    row: tuple[str, ...]
    macros: tuple[Macro, ...]
    banks: int
    pack: int
    parts: int

    @property
    def area_um2(self) -> float:
        """Square micrometres of all copies."""
        return self.array.copies * self.banks * math.fsum(macro.area for macro in self.macros)

    @property
    def energy_pj(self) -> float:
        """Picojoules per recording, of all copies together."""
        reads = self.array.rows.get(self.pack, self.array.rows[1])
        return math.fsum(
            reads * macro.read_pj + self.array.writes * macro.write_pj for macro in self.macros
        )

    def pieces(self) -> "Iterator[Piece]":
        """Yield the macros of a copy."""
        array = self.array
        words_of_row = self.pack * self.parts
        for bank in range(self.banks):
            first = bank // self.parts * words_of_row * self.macros[0].words + bank % self.parts
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
    """A macro of a plan: rows of it for every ``every`` words, from word ``first`` on; bits of it from ``bit`` on."""

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
    """Yield what an array may be made of."""
    for ports in (1, 2) if array.halves else range(array.ports, 3):
        parts = 1 if ports >= array.ports else array.halves
        for depth in sorted({macro.words for macro in macros.values() if macro.ports == ports}):
            of_kind = [
                (name, macro)
                for name, macro in macros.items()
                if (macro.ports, macro.words) == (ports, depth)
            ]
            of_kind.sort(key=lambda pair: -pair[1].bits)
            for pack in PACKS if array.ports == 1 else (1,):
                banks = parts * -(-array.words // (parts * pack * depth))
                several = [(name, macro) for name, macro in of_kind if banks <= macro.banks]
                for row in _rows(several, pack * array.bits):
                    names, kinds = zip(*row, strict=True)
                    yield Made(array, names, kinds, banks, pack, parts)


def _rows(
    macros: Sequence[tuple[str, Macro]], bits: int
) -> Iterator[tuple[tuple[str, Macro], ...]]:
    """Yield rows of macros that hold ``bits`` bits and no macro too many."""
    for side_by_side in range(1, WIDEST + 1):
        for row in combinations_with_replacement(macros, side_by_side):
            before, (_, last) = sum(macro.bits for _, macro in row[:-1]), row[-1]
            if before < bits <= before + last.bits:
                yield row


def plan(arrays: Iterable[Array], macros: Mapping[str, Macro], price: float = PRICE) -> list[Made]:
    """Return what each array is made of; what no macro holds is an ``InputError``."""
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
    """Return a plan as a table, a macro a row."""
    head = "memory,copies,macro,first word,words to the next row,rows,words in a row,first bit,bits"
    return "\n".join(
        [head, *(",".join(map(str, vars(piece).values())) for piece in pieces), ""]
    ).encode()
