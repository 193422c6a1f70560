"""The check of a plan of memories: every bit of every array has one place, in a macro that is large enough."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from hw_model.description.open_core import Macro
from hw_model.errors import InputError
from hw_model.rtl.memory_plan import Array, Piece


def check(pieces: Sequence[Piece], arrays: Iterable[Array], macros: Mapping[str, Macro]) -> None:
    """Raise InputError if a plan does not hold every bit of every array exactly once, or asks for more than a macro has.

    A piece is a part of a memory in one macro: ``rows`` rows from word ``first`` on, a row for every ``every``-th word, with
    ``bits`` bits from ``bit`` on. Each piece counts up the bits that it holds; in the end every count must be 1.
    """
    counts_of_memory = {
        array.name: np.zeros((array.words, array.bits), dtype=np.int8) for array in arrays
    }
    for piece in pieces:
        where, macro = f"memory {piece.memory!r}", macros.get(piece.macro)
        if piece.memory not in counts_of_memory:
            raise InputError(where, "the core has no such memory", fix="Leave it out.")
        if macro is None or piece.rows > macro.words or piece.bits > macro.bits:
            measured_text = f"{piece.rows} rows of {piece.bits} bits"
            raise InputError(
                where,
                f"no macro {piece.macro!r} holds its part",
                measured=measured_text,
                fix="Name another.",
            )
        holders = counts_of_memory[piece.memory]
        words, bits = holders.shape
        # Bits beyond the packed words are spare bits of the macro, and rows beyond the last word are spare rows.
        row, bit = np.arange(piece.rows)[:, None], piece.bit + np.arange(piece.bits)
        bit = bit[bit < piece.pack * bits]
        word, bit = np.broadcast_arrays(piece.first + piece.every * row + bit // bits, bit % bits)
        np.add.at(holders, (word[word < words], bit[word < words]), 1)
    for name, holders in counts_of_memory.items():
        for word, bit in [*np.argwhere(holders == 0), *np.argwhere(holders > 1)]:
            measured_text = f"{holders[word, bit]} hold bit {bit} of word {word}"
            if holders[word, bit]:
                problem, fix = "macros of the plan overlap", "Give every bit one place."
            else:
                problem, fix = "the plan is too small", "Add macros."
            raise InputError(f"memory {name!r}", problem, measured=measured_text, fix=fix)
