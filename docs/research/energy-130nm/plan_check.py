"""The check of a plan of memories: every bit of every array has one place, in a macro that is large enough."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from hw_model.description.open_core import Macro
from hw_model.errors import InputError
from hw_model.rtl.memory_plan import Array, Piece


def check(pieces: Sequence[Piece], arrays: Iterable[Array], macros: Mapping[str, Macro]) -> None:
    """Refuse a plan that does not hold every bit of every array once, or that asks for more than a macro has."""
    known = {array.name: np.zeros((array.words, array.bits), dtype=np.int8) for array in arrays}
    for piece in pieces:
        where, macro = f"memory {piece.memory!r}", macros.get(piece.macro)
        if piece.memory not in known:
            raise InputError(where, "the core has no such memory", fix="Leave it out.")
        if macro is None or piece.rows > macro.words or piece.bits > macro.bits:
            measured = f"{piece.rows} rows of {piece.bits} bits"
            raise InputError(
                where,
                f"no macro {piece.macro!r} holds its part",
                measured=measured,
                fix="Name another.",
            )
        held = known[piece.memory]
        words, bits = held.shape
        row, bit = np.arange(piece.rows)[:, None], piece.bit + np.arange(piece.bits)
        bit = bit[bit < piece.pack * bits]
        word, bit = np.broadcast_arrays(piece.first + piece.every * row + bit // bits, bit % bits)
        np.add.at(held, (word[word < words], bit[word < words]), 1)
    for name, held in known.items():
        for word, bit in [*np.argwhere(held == 0), *np.argwhere(held > 1)]:
            measured = f"{held[word, bit]} hold bit {bit} of word {word}"
            if held[word, bit]:
                what, fix = "macros of the plan overlap", "Give every bit one place."
            else:
                what, fix = "the plan is too small", "Add macros."
            raise InputError(f"memory {name!r}", what, measured=measured, fix=fix)
