"""How much of a population a core has room for: slots of its ring buffer, and neurons.

A ring buffer has an entry for each neuron, receptor and slot, and a spike's synapses on a core lie in
one row. Both have limits, which :class:`~hw_model.spinnaker.chips.SpinnakerChip` names.
"""

import numpy as np

from hw_model.arithmetic import spinnaker
from hw_model.spinnaker.chips import SpinnakerChip
from locsnn_compile.spinnaker.synapses import SignedSynapses

SLOTS_MIN = 2
"""The fewest slots that a population of SpiNNaker can have."""


def slots_for(incoming: list[SignedSynapses]) -> int:
    """Return how many slots a ring buffer has: the least power of two that holds every delay."""
    longest_delay = max((int(part.delay.max(initial=0)) for part in incoming), default=0)
    slots = SLOTS_MIN
    while slots < longest_delay:
        slots *= 2
    return slots


def neurons_per_core(
    size: int, slots: int, incoming: list[SignedSynapses], chip: SpinnakerChip
) -> int:
    """Return the most of a population's ``size`` neurons, a power of two, that a core has room for.

    Where not even one fits, that is 1, and the check of the whole network says what is too much.
    """
    neurons = chip.neurons_per_core
    while neurons > 1:
        fits_ring = _ring_bits(min(size, neurons), slots) <= chip.ring_bits
        if fits_ring and _fit_rows(incoming, neurons, chip):
            return neurons
        neurons //= 2
    return neurons


def _ring_bits(neurons: int, slots: int) -> int:
    """Return the bits that number the entries of a ring buffer."""
    neuron_bits = (neurons - 1).bit_length()
    slot_bits = (slots - 1).bit_length()
    receptor_bits = (spinnaker.RECEPTORS - 1).bit_length()
    return neuron_bits + slot_bits + receptor_bits


def _fit_rows(incoming: list[SignedSynapses], neurons: int, chip: SpinnakerChip) -> bool:
    return all(longest_row(part, neurons) <= chip.synapses_per_row for part in incoming)


def longest_row(synapses: SignedSynapses, neurons: int) -> int:
    """Return the most synapses that one source has on a core of so many neurons."""
    core = synapses.target_index // neurons
    rows = np.stack([synapses.source_index, core])
    _, synapse_counts = np.unique(rows, axis=1, return_counts=True)
    return int(synapse_counts.max(initial=0))
