"""What a program needs of each memory of a core on a chip: size, ports and accesses.

:mod:`.memory_plan` chooses macros for these needs, and the study of energy in
docs/research/energy-130nm prices them.

Many compartments have the same constants. On a chip, the fields that they share lie in a memory of
their own, in two halves for even and odd compartments. A half keeps showing its last word, so the
constants of a compartment are not read again if they equal those of the compartment two before it.
Memories of flags say where this is so.
"""

from itertools import chain

import numpy as np

from hw_model.description.counts import Counts
from hw_model.description.open_core import Sizes
from hw_model.rtl.images import CoreProgram, layouts, resident_compartments
from hw_model.rtl.memory_plan import PACKS, Array

NOT_SHARED: dict[str, tuple[str, ...]] = {"leaks": (), "fires": ("parent", "entry")}
"""The memories of constants, and their fields that differ between compartments of one kind, which
are stored apart."""
WORDS_PER_FLAGS = 32
"""Compartments in a word of flags, one bit each: whether the constants equal those of the
compartment two before. The first two of a word are always read."""
COMPARTMENTS_PER_REST = 8
"""Compartments in a word of at_rest.sv, two bits for each."""
STATE_BITS = 48
"""A current and a voltage, of 24 bits each. The time for which a compartment stays blocked is
stored in place of its voltage."""
TALLY_BITS = 24
"""Bits of a tally: ``tallies`` in readout.sv."""


def arrays_of(core: CoreProgram, sizes: Sizes, counts: Counts) -> list[Array]:
    """Return the memories of a program on a core of these sizes, with a recording's accesses.

    Accesses are estimated from ``counts``, the counts of a recording, and from the program. Two
    things are unknown then: words of lists that hold one synapse or none, which are read all the
    same (so too few reads are counted), and states of active compartments that do not matter to the
    next step, which are not accessed (so too many are).
    """
    needs = core.needs
    words = core.words
    widths = {name: layout.width for name, layout in layouts(sizes).items()}
    updates = counts.neuron_updates
    active = counts.neuron_updates_active
    spikes = counts.spikes
    lists = counts.input_events + counts.transpose_events + spikes  # each delivers a list
    source_bits = (sizes.axons - 1).bit_length()
    # With two slots no synapse has a delay: its bit is left out, in both synapses of a word.
    synapse = widths["synapses"] - (2 if sizes.slots == 2 else 0)
    # Words of a bank: half of the states, as a power of two, in every slot.
    charges = sizes.slots << (words.states - 1).bit_length() - 1
    parents = _updates_of(core, "has_children")
    read_out = _updates_of(core, "read_out")
    scanned = needs.visits * (core.row_words + 1)  # a visit reads one word behind its channel

    def array(
        name: str, words: int, bits: int, reads: float, writes: float = 0.0, **more: bool | int
    ) -> Array:
        # Words that are read in order: a row that holds several of them is read once for all.
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
        constants.append(array(f"{name}_same", words_of_half, bits_shared, reads, copies=2))
        if bits_not_shared:
            constants.append(
                array(f"{name}_own", needs.compartments, bits_not_shared, updates, in_order=True)
            )
        # A word of flags is read for each half.
        flags = -(-needs.compartments // WORDS_PER_FLAGS)
        flag_reads = updates * 2 / WORDS_PER_FLAGS
        constants.append(array(f"{name}_flags", flags, WORDS_PER_FLAGS, flag_reads))
    # at_rest.sv reads and writes a word for each group of compartments.
    rest_words = -(-words.states // COMPARTMENTS_PER_REST)
    rest_accesses = updates / COMPARTMENTS_PER_REST
    return [
        array("axons", needs.axons, widths["axons"], lists),
        array("synapses", needs.synapses // 2, synapse, counts.synaptic_ops / 2, in_order=True),
        # Every synaptic operation adds and every update takes a charge; a charge of 0 need not be
        # written back.
        array(
            "charges",
            charges,
            sizes.charge,
            reads=counts.synaptic_ops + updates,
            writes=counts.synaptic_ops + active,
            copies=2,
        ),
        array("states", words.states, STATE_BITS, active, active, halves=2),
        array("rests", rest_words, 2 * COMPARTMENTS_PER_REST, rest_accesses, rest_accesses),
        *constants,
        array("sums", words.sums, sizes.join, parents, parents),
        array("places", resident_compartments(sizes), source_bits, spikes, spikes),
        array("tallies", needs.entries, TALLY_BITS, read_out, spikes),
        array(
            "bitmap",
            needs.bitmap,
            sizes.word,
            counts.input_events + scanned,
            counts.input_events,
            halves=1,
        ),
        array("visit_list", needs.visits, widths["visits"], needs.visits),
        array("weights", words.weights, widths["weights"], 0.0),
        array("phases", words.phases, widths["phases"], words.phases),
    ]


def _updates_of(core: CoreProgram, kind: str) -> int:
    """Return how many updates of a recording are of compartments whose flag ``kind`` is set."""
    flags = core.tables["compartments"][kind]
    return sum(int(flags[core.numbers[phase.name]].sum()) * phase.steps for phase in core.phases)


def own_bits(name: str, sizes: Sizes) -> list[int]:
    """Return which bits of a word of constants belong to :data:`NOT_SHARED` fields."""
    fields = layouts(sizes)[name].fields
    field_of_bit = chain.from_iterable([field.name] * field.width for field in fields)
    return [bit for bit, field in enumerate(field_of_bit) if field in NOT_SHARED[name]]


def reads_without_repeats(core: CoreProgram, sizes: Sizes, name: str, phase: int) -> float:
    """Return how many words of shared constants a phase reads, without those that repeat."""
    layout = layouts(sizes)[name]
    words = layout.pack(
        {field.name: core.tables["compartments"][field.name] for field in layout.fields}
    )
    words = np.delete(words, own_bits(name, sizes), axis=1)
    begin = core.ends[phase - 1] if phase else 0
    end = core.ends[phase]
    # Whether each compartment of the phase differs from the one two before; the first two have
    # none.
    differs = (words[begin + 2 : end] != words[begin : max(end - 2, begin)]).any(axis=1)
    differs = np.r_[[True, True], differs][: end - begin]
    always_read = np.arange(begin, end) % WORDS_PER_FLAGS < 2
    reads_of_step = np.count_nonzero(differs | always_read)
    return float(reads_of_step) * core.phases[phase].steps
