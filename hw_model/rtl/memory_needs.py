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

NOT_SHARED: dict[str, tuple[str, ...]] = {"leaks": (), "fires": ("parent", "entry")}
"""Memories of constants, and their fields that differ between compartments of one kind: they have own words."""
WORDS_PER_FLAGS = 32
"""Words of constants in a word of flags, which say what equals the last but one; the first two are always read."""
COMPARTMENTS_PER_REST = 8
"""Compartments in a word of at_rest.sv, two bits for each."""
STATE_BITS = 48
"""A current and a voltage, of 24 bits each; how long a compartment is blocked takes the place of its voltage."""
TALLY_BITS = 24
"""Of ``tallies`` in readout.sv."""


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
    source_bits = (sizes.axons - 1).bit_length()
    # With two slots no synapse has a delay.
    synapse = widths["synapses"] - (2 if sizes.slots == 2 else 0)
    charges = sizes.slots << (words.states - 1).bit_length() - 1
    parents, read_out = (_updates_of(core, name) for name in ("has_children", "read_out"))
    scanned = needs.visits * (core.row_words + 1)

    def one(
        name: str, words: int, bits: int, reads: float, writes: float = 0.0, **more: bool | int
    ) -> Array:
        # What is read in order reads a row of several words once for all of them.
        in_order = more.pop("in_order", False)
        rows = {pack: reads / pack if in_order else reads for pack in PACKS}
        ports = 2 if writes else 1
        return Array(name, words, bits, ports=ports, rows=rows, writes=writes, **more)

    constants = []
    for name in NOT_SHARED:
        bits_not_shared = len(own_bits(name, sizes))
        bits_shared = widths[name] - bits_not_shared
        reads = sum(
            reads_without_repeats(core, sizes, name, phase) for phase in range(len(core.phases))
        )
        # Two copies: an even half and an odd one.
        words_of_half = -(-needs.compartments // 2)
        constants.append(one(f"{name}_same", words_of_half, bits_shared, reads, copies=2))
        if bits_not_shared:
            constants.append(
                one(f"{name}_own", needs.compartments, bits_not_shared, updates, in_order=True)
            )
        # A word of flags is read for each half.
        flags = -(-needs.compartments // WORDS_PER_FLAGS)
        flag_reads = updates * 2 / WORDS_PER_FLAGS
        constants.append(one(f"{name}_flags", flags, WORDS_PER_FLAGS, flag_reads))
    rest_words = -(-words.states // COMPARTMENTS_PER_REST)
    rest_accesses = updates / COMPARTMENTS_PER_REST
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
        one("states", words.states, STATE_BITS, active, active, halves=2),
        one("rests", rest_words, 2 * COMPARTMENTS_PER_REST, rest_accesses, rest_accesses),
        *constants,
        one("sums", words.sums, sizes.join, parents, parents),
        one("places", held(sizes), source_bits, spikes, spikes),
        one("tallies", needs.entries, TALLY_BITS, read_out, spikes),
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
    """Return the bits of a word of constants that belong to :data:`NOT_SHARED` fields."""
    fields = layouts(sizes)[name].fields
    field_of_bit = chain.from_iterable([field.name] * field.width for field in fields)
    return [bit for bit, field in enumerate(field_of_bit) if field in NOT_SHARED[name]]


def reads_without_repeats(core: CoreProgram, sizes: Sizes, name: str, phase: int) -> float:
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
    always_read = np.arange(begin, end) % WORDS_PER_FLAGS < 2
    reads_of_step = np.count_nonzero(differs | always_read)
    return float(reads_of_step) * core.phases[phase].steps
