"""What a program needs of each memory of the core: words, bits and ports, and what a recording does to it.

Words that compartments share are kept apart, in an even half and an odd one that show what was read last: what equals
the last but one is not read again.
"""

from itertools import chain

import numpy as np

from hw_model.description.counts import Counts
from hw_model.description.open_core import Sizes
from hw_model.rtl.images import CoreProgram, held, layouts
from hw_model.rtl.memory_plan import PACKS, Array

OWN: dict[str, tuple[str, ...]] = {"leaks": (), "fires": ("parent", "entry")}
"""Memories of constants, and their fields that compartments of a kind do not have in common."""
FLAGGED, RESTING = 32, 8
"""Words of constants in a word of flags, whose first two are always read; compartments in one that says who rests."""


def arrays_of(core: CoreProgram, sizes: Sizes, counts: Counts) -> list[Array]:
    """Return the memories that a program needs on a core of these sizes; ``counts``: what a recording does.

    Accesses are those that counts and program tell. They do not tell words of lists with one synapse or none, which are
    read, nor states of active compartments that the next step does not depend on, which are not.
    """
    needs = core.needs
    words = core.words
    widths = {name: layout.width for name, layout in layouts(sizes).items()}
    updates = counts.neuron_updates
    active = counts.neuron_updates_active
    spikes = counts.spikes
    lists = counts.input_events + counts.transpose_events + spikes
    source = (sizes.axons - 1).bit_length()
    # With two slots no synapse has a delay.
    synapse = widths["synapses"] - (2 if sizes.slots == 2 else 0)
    charges = sizes.slots << (words.states - 1).bit_length() - 1
    parents, read_out = (_updates_of(core, name) for name in ("has_children", "read_out"))
    scanned = needs.visits * (core.row_words + 1)

    def one(
        name: str, words: int, bits: int, reads: float, writes: float = 0.0, **more: bool | int
    ) -> Array:
        in_order = more.pop("in_order", False)
        rows = {pack: reads / pack if in_order else reads for pack in PACKS}
        return Array(name, words, bits, 2 if writes else 1, rows, writes, **more)

    constants = []
    for name in OWN:
        own = len(own_bits(name, sizes))
        reads = sum(repeats(core, sizes, name, phase) for phase in range(len(core.phases)))
        constants.append(
            one(f"{name}_same", -(-needs.compartments // 2), widths[name] - own, reads, copies=2)
        )
        if own:
            constants.append(one(f"{name}_own", needs.compartments, own, updates, in_order=True))
        flags = -(-needs.compartments // FLAGGED)
        constants.append(one(f"{name}_flags", flags, FLAGGED, updates * 2 / FLAGGED))
    return [
        one("axons", needs.axons, widths["axons"], lists),
        one("synapses", needs.synapses // 2, synapse, counts.synaptic_ops / 2, in_order=True),
        one(
            "charges",
            charges,
            sizes.charge,
            counts.synaptic_ops + updates,
            counts.synaptic_ops + active,
            copies=2,
        ),
        one("states", words.states, 48, active, active, halves=2),
        one(
            "rests", -(-words.states // RESTING), 2 * RESTING, updates / RESTING, updates / RESTING
        ),
        *constants,
        one("sums", words.sums, sizes.join, parents, parents),
        one("places", held(sizes), source, spikes, spikes),
        one("tallies", needs.entries, 24, read_out, spikes),
        one(
            "bitmap",
            needs.bitmap,
            sizes.word,
            counts.input_events + scanned,
            counts.input_events,
            halves=1,
        ),
        one("visit_list", needs.visits, widths["visits"], needs.visits),
        one("weights", words.weights, widths["weights"], 0.0),
        one("phases", words.phases, widths["phases"], words.phases),
    ]


def _updates_of(core: CoreProgram, kind: str) -> int:
    """Return how often compartments of a kind, a flag of their constants, are updated in a recording."""
    flags = core.tables["compartments"][kind]
    return sum(int(flags[core.numbers[phase.name]].sum()) * phase.steps for phase in core.phases)


def own_bits(name: str, sizes: Sizes) -> list[int]:
    """Return the bits of a word of constants that belong to :data:`OWN` fields."""
    fields = layouts(sizes)[name].fields
    return [
        bit
        for bit, field in enumerate(chain(*([f.name] * f.width for f in fields)))
        if field in OWN[name]
    ]


def repeats(core: CoreProgram, sizes: Sizes, name: str, phase: int) -> float:
    """Return how many shared words of constants a phase reads, those that repeat left out."""
    layout = layouts(sizes)[name]
    words = layout.pack(
        {field.name: core.tables["compartments"][field.name] for field in layout.fields}
    )
    words = np.delete(words, own_bits(name, sizes), axis=1)
    begin = core.ends[phase - 1] if phase else 0
    end = core.ends[phase]
    differs = (words[begin + 2 : end] != words[begin : max(end - 2, begin)]).any(axis=1)
    differs = np.r_[[True, True], differs][: end - begin]
    return (
        float(np.count_nonzero(differs | (np.arange(begin, end) % FLAGGED < 2)))
        * core.phases[phase].steps
    )
