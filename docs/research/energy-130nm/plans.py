"""What every memory of the core is made of: the search for the cheapest plan of macros and latches, and its check.

Memories are chosen one by one: each option costs picojoules per recording, from the accesses that a recording needs
(:mod:`traffic`), and an area, which counts at a price. ``plan()`` gives the choices for all memories.
"""

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
    """Return what every memory is made of: the least picojoules per recording plus ``price`` per square micrometre.

    ``done``: the accesses of a recording to each memory; by default those of a recording of Objects on our core.
    ``most``: the area, in square micrometres, that the plan may take. If it takes more, one memory gets smaller: the one whose
    energy grows least by that. A plan that does not hold every bit once, or that leaves out a word that is read, is refused.
    """
    done = done or runs.traffic_of()
    chosen = [
        min(
            options(files, memory, core),
            key=lambda one: cost(files, one, memory) + price * area(files, one),
        )
        for memory in done.values()
    ]
    excess_um2 = sum(area(files, one) for one in chosen) - most
    if excess_um2 > 0:
        swaps = [
            (
                cost(files, option, done[one.shape.name]) - cost(files, one, done[one.shape.name]),
                index,
                option,
            )
            for index, one in enumerate(chosen)
            for option in options(files, done[one.shape.name], core)
            if area(files, one) - area(files, option) > excess_um2
        ]
        _, index, chosen[index] = min(swaps, key=lambda found: found[0])
    for one in chosen:
        refuse_too_few(one.shape, done[one.shape.name])
    check(pieces_of(chosen), *checked_by(files, chosen))
    return chosen


def refuse_too_few(shape: memories.Shape, memory: traffic.Memory) -> None:
    """Raise InputError if a memory leaves out a word from which something other than 0 is read."""
    # `seen` lists the first address of each span of such words and the address after it, in turn.
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
    """Return the memories of a plan, and the macros that its pieces may name, as the check of plans takes them."""
    arrays = [
        latches.array_of(one) if isinstance(one, Latches) else memories.array_of(one.shape)
        for one in chosen
    ]
    banks = {
        one.module: description.Macro(
            words=one.rows, bits=one.shape.bits, area=1.0, read_pj=0.0, write_pj=0.0, ports=2
        )
        for one in chosen
        if isinstance(one, Latches)
    }
    return arrays, {**files.macros, **banks}


def options(
    files: Library, memory: traffic.Memory, core: Core = OURS
) -> list[memories.Choice | Latches]:
    """Return the ways to make a memory: of macros, and of latches if it is small enough."""
    held_words, period = core.held.get(memory.name, memory.words), 0
    # Parameters of the core are powers of two; memories of compartments need only hold the compartments of this core.
    if memory.name.startswith(OF_COMPARTMENTS):
        period = memory.words // (core.sizes.slots if memory.name == "charges" else 1)
        held_words = -(-period * core.compartments // core.sizes.compartments)
    shape = memories.Shape(
        memory.name,
        memory.words,
        memory.bits,
        2 if memory.name in memories.HALVES else memory.ports,
        memory.copies,
        held_words,
        period,
        zero(memory.name, core.sizes),
        memory.single,
        memory.at_once,
    )
    # Banks of 8 or 16 rows, or of all words if there are fewer; macros do not show a word in the cycle in which it is read.
    depths = {min(depth, 1 << (len(shape.held) - 1).bit_length()) for depth in (8, 16)}
    latch_arrays = (
        [Latches(shape, depth) for depth in sorted(depths)]
        if len(shape.held) * shape.bits <= MOST_LATCHES
        else []
    )
    return [
        *([] if shape.at_once else memories.choices(shape, list(files.macros.values()))),
        *latch_arrays,
    ]


def zero(name: str, sizes: Sizes) -> tuple[int, ...]:
    """Return the bits of a memory's word that are always 0.

    With two slots of charges, one for this step and one for the next, no synapse has a delay.
    """
    if name != "synapses" or sizes.slots > 2:
        return ()
    fields = layouts(sizes)[name].fields
    ends = np.cumsum([0, *(field.width for field in fields)])
    return tuple(int(ends[k]) for k, field in enumerate(fields) if field.name.startswith("delay"))


def capacity(chosen: Sequence[memories.Choice | Latches]) -> dict[str, int]:
    """Return the sizes of programs that the core takes: its parameters, or less if the memory of a plan holds less."""
    words_of_memory = {
        one.shape.name: one.banks * one.rows * one.pack
        if isinstance(one, memories.Choice)
        else len(one.shape.held)
        for one in chosen
    }
    words_of_memory |= {
        "synapses": 2 * words_of_memory["synapses"],
        "compartments": OURS.compartments,
        "places": SIZES["places"],
    }
    memory_of_parameter = {"visits": "visit_list", "entries": "tallies"}
    return {
        name: min(value, words_of_memory.get(memory_of_parameter.get(name, name), value))
        for name, value in SIZES.items()
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
    """Return picojoules per recording of a memory that is made in this way.

    With several words in a row, reads of words that follow each other are answered from the row that was read last.
    """
    if isinstance(made, memories.Choice):
        reads = memory.rows[made.pack] if made.pack > 1 else memory.reads
        return reads * made.read_pj + memory.writes * made.write_pj
    costs = arrays.measure(files, made)
    return memory.reads * costs.read_pj + memory.writes * costs.write_pj
