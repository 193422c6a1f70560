"""What every memory of the core is made of: the search for the cheapest plan of macros and latches, and its check."""

from collections.abc import Mapping, Sequence

import arrays
import latches
import liberty
import memories
import numpy as np
import runs
import traffic
from latches import Latches
from plan_check import check
from runs import OURS, SIZES, Core, Library

from hw_model.description import chip as description
from hw_model.errors import InputError
from hw_model.rtl.images import Sizes, layouts
from hw_model.rtl.memory_plan import PRICE, Array, Piece

MOST_AREA = 2.69e6
"""Square micrometres that the memories of our core may take, so that it takes no more than 3 mm2."""
OF_COMPARTMENTS = ("states", "rests", "charges", "leaks", "fires")
"""Memories with as many words for each compartment, by how their names begin; charges have a part for each slot."""
MOST_LATCHES = 9_000
"""Bits above which no latches are taken: with the states in latches the core would miss 100 MHz."""


def plan(
    files: Library,
    price: float = PRICE,
    core: Core = OURS,
    done: Mapping[str, traffic.Memory] | None = None,
    most: float = float("inf"),
) -> list[memories.Choice | Latches]:
    """Return what every memory is made of: the least picojoules per recording plus ``price`` for a square micrometre.

    ``done``: what a recording does to memories, else what one of Objects does to those of our core. Where the plan takes
    ``most`` square micrometres and more, one memory gets smaller, that which costs the least for it. A plan that does not
    hold every bit once, or not make a word that something is read from, is refused.
    """
    done = done or runs.traffic_of()
    chosen = [
        min(
            options(files, memory, core),
            key=lambda one: cost(files, one, memory) + price * area(files, one),
        )
        for memory in done.values()
    ]
    over = sum(area(files, one) for one in chosen) - most
    if over > 0:
        smaller = [
            (
                cost(files, other, done[one.shape.name]) - cost(files, one, done[one.shape.name]),
                at,
                other,
            )
            for at, one in enumerate(chosen)
            for other in options(files, done[one.shape.name], core)
            if area(files, one) - area(files, other) > over
        ]
        _, at, chosen[at] = min(smaller, key=lambda found: found[0])
    for one in chosen:
        refuse_too_few(one.shape, done[one.shape.name])
    check(pieces_of(chosen), *checked_by(files, chosen))
    return chosen


def refuse_too_few(shape: memories.Shape, memory: traffic.Memory) -> None:
    """Refuse a memory that does not make a word that something is read from."""
    spans = zip(memory.seen[::2], memory.seen[1::2], strict=True)
    lost = set().union(*(range(*span) for span in spans)) - set(shape.held)
    if lost:
        where, measured = f"memory {shape.name!r}", f"word {min(lost)} of {len(shape.held)}"
        raise InputError(
            where,
            "the plan does not make a word that something is read from",
            measured=measured,
            fix="Hold more words.",
        )


def pieces_of(chosen: Sequence[memories.Choice | Latches]) -> list[Piece]:
    """Return the macros and banks of latches of a plan."""
    of = {memories.Choice: memories.pieces_of, Latches: latches.pieces_of}
    return [piece for one in chosen for piece in of[type(one)](one)]


def checked_by(
    files: Library, chosen: Sequence[memories.Choice | Latches]
) -> tuple[list[Array], dict[str, liberty.Macro | description.Macro]]:
    """Return the memories of a plan, and what its pieces are, as the check of plans takes them."""
    arrays = [
        latches.array_of(one) if isinstance(one, Latches) else memories.array_of(one.shape)
        for one in chosen
    ]
    banks = {
        one.module: description.Macro(one.rows, one.shape.bits, 1.0, 0.0, 0.0, 2)
        for one in chosen
        if isinstance(one, Latches)
    }
    return arrays, {**files.macros, **banks}


def options(
    files: Library, memory: traffic.Memory, core: Core = OURS
) -> list[memories.Choice | Latches]:
    """Return what a memory may be made of."""
    held, period = core.held.get(memory.name, memory.words), 0
    if memory.name.startswith(OF_COMPARTMENTS):
        period = memory.words // (core.sizes.slots if memory.name == "charges" else 1)
        held = -(-period * core.compartments // core.sizes.compartments)
    shape = memories.Shape(
        memory.name,
        memory.words,
        memory.bits,
        2 if memory.name in memories.HALVES else memory.ports,
        memory.copies,
        held,
        period,
        zero(memory.name, core.sizes),
        memory.single,
        memory.at_once,
    )
    depths = {min(depth, 1 << (len(shape.held) - 1).bit_length()) for depth in (8, 16)}
    arrays = (
        [Latches(shape, depth) for depth in sorted(depths)]
        if len(shape.held) * shape.bits <= MOST_LATCHES
        else []
    )
    return [
        *([] if shape.at_once else memories.choices(shape, list(files.macros.values()))),
        *arrays,
    ]


def zero(name: str, sizes: Sizes) -> tuple[int, ...]:
    """Return the bits of a memory's word that are always 0: with two slots no synapse has a delay."""
    if name != "synapses" or sizes.slots > 2:
        return ()
    fields = layouts(sizes)[name].fields
    ends = np.cumsum([0, *(field.width for field in fields)])
    return tuple(int(ends[k]) for k, field in enumerate(fields) if field.name.startswith("delay"))


def capacity(chosen: Sequence[memories.Choice | Latches]) -> dict[str, int]:
    """Return the sizes of the core that a plan holds: parameters, where memories do not hold less."""
    words = {
        one.shape.name: one.banks * one.rows * one.pack
        if isinstance(one, memories.Choice)
        else len(one.shape.held)
        for one in chosen
    }
    words |= {
        "synapses": 2 * words["synapses"],
        "compartments": OURS.compartments,
        "places": SIZES["places"],
    }
    names = {"visits": "visit_list", "entries": "tallies"}
    return {
        name: min(value, words.get(names.get(name, name), value)) for name, value in SIZES.items()
    }


def memory_words(chosen: Sequence[memories.Choice | Latches]) -> dict[str, int]:
    """Return the words of memories that a program may need more of, whatever the parameters of the core."""
    shapes = {one.shape.name: one.shape for one in chosen}
    return {name: len(shapes[name].held) for name in ("weights", "phases")} | {
        "states": len(shapes["states"].held)
    }


def area(files: Library, made: memories.Choice | Latches) -> float:
    """Return square micrometres of all copies."""
    return (
        made.area
        if isinstance(made, memories.Choice)
        else made.shape.copies * arrays.measure(files, made).area
    )


def cost(files: Library, made: memories.Choice | Latches, memory: traffic.Memory) -> float:
    """Return picojoules per recording of a memory made like this.

    With several words a row, reads of words that follow each other are answered from the row read last.
    """
    if isinstance(made, memories.Choice):
        reads = memory.rows[made.pack] if made.pack > 1 else memory.reads
        return reads * made.read_pj + memory.writes * made.write_pj
    costs = arrays.measure(files, made)
    return memory.reads * costs.read_pj + memory.writes * costs.write_pj
