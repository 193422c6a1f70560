"""How full a program makes each memory of the open core, in words and bits, for the report."""

from hw_model.description.open_core import MemoryUse
from hw_model.rtl.images import CoreProgram, layouts, resident_compartments

_STATE_BITS = 48
"""A current and a voltage, of 24 bits each."""
_TALLY_BITS = 24
"""Bits of a tally: ``tallies`` in readout.sv."""


def memory_uses(core: CoreProgram) -> dict[str, MemoryUse]:
    """Return how many words of each memory of its core a program fills, by the name of the memory.

    A word of synapses holds two of them, and charges wait in a slot for each step of delay. The
    sums of joined voltages are left out: whether they become memory or logic is up to the tools.
    """
    sizes = core.sizes
    needs = core.needs
    widths = {name: layout.width for name, layout in layouts(sizes).items()}
    places = resident_compartments(sizes)  # compartments that the core has room for at a time
    states = core.words.states
    return {
        "source_lists": MemoryUse(needs.axons, sizes.axons, widths["axons"]),
        "synapse_pairs": MemoryUse(needs.synapses // 2, sizes.synapses // 2, widths["synapses"]),
        "neuron_constants": MemoryUse(
            needs.compartments, sizes.compartments, widths["leaks"] + widths["fires"]
        ),
        "neuron_states": MemoryUse(states, places, _STATE_BITS),
        "waiting_charges": MemoryUse(needs.slots * states, sizes.slots * places, sizes.charge),
        "event_buffer": MemoryUse(needs.bitmap, sizes.bitmap, sizes.word),
        "channel_visits": MemoryUse(needs.visits, sizes.visits, widths["visits"]),
        "class_tallies": MemoryUse(needs.entries, sizes.entries, _TALLY_BITS),
        "phase_settings": MemoryUse(core.words.phases, sizes.phase_words, widths["phases"]),
    }
