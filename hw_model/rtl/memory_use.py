"""How full a program makes each memory of the open core, in words and bits."""

from hw_model.description.open_core import MemoryUse
from hw_model.rtl.images import CoreProgram, held, layouts

_STATE_BITS = 48
"""A current and a voltage, of 24 bits each."""
_TALLY_BITS = 24


def memory_uses(core: CoreProgram) -> dict[str, MemoryUse]:
    """Return what a program fills of each memory of its core, by the name of the memory.

    Synapses lie in pairs, so a word of theirs is two, and charges wait in a slot for each step of
    delay. The sums of joined voltages are left out: the tools make them of logic or of memory.
    """
    sizes = core.sizes
    needs = core.needs
    widths = {name: layout.width for name, layout in layouts(sizes).items()}
    places = held(sizes)
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
