"""Decide how many neurons of a population a core holds, and how many slots its ring buffer has.

A core's ring buffer holds the weights that are due in later steps: an entry per neuron, receptor and *slot*, which is a
step. The synapses of one source on a core are a *row*. Both are limited, see
:class:`hw_model.spinnaker.chips.SpinnakerChip`.
"""

import numpy as np

from hw_model.arithmetic import spinnaker
from hw_model.spinnaker.chips import SpinnakerChip
from locsnn_compile.spinnaker.synapses import SignedSynapses

SLOTS_MIN = 2
"""The fewest slots that a population of SpiNNaker can have."""


def slots_for(incoming: list[SignedSynapses]) -> int:
    """Return the number of slots of a ring buffer: the smallest power of two that is at least every delay."""
    longest_delay = max((int(part.delay.max(initial=0)) for part in incoming), default=0)
    slots = SLOTS_MIN
    while slots < longest_delay:
        slots *= 2
    return slots


def neurons_per_core(
    size: int, slots: int, incoming: list[SignedSynapses], chip: SpinnakerChip
) -> int:
    """Return the largest power of two of a population's ``size`` neurons that a core has room for.

    If not even one neuron fits, the result is 1, and the check of the whole network reports the limit.
    """
    neurons = chip.neurons_per_core
    while neurons > 1:
        fits_ring = _ring_bits(min(size, neurons), slots) <= chip.ring_bits
        if fits_ring and _fit_rows(incoming, neurons, chip):
            return neurons
        neurons //= 2
    return neurons


def _ring_bits(neurons: int, slots: int) -> int:
    """Return the bits of an index into a ring buffer: those for the neuron, the slot and the receptor."""
    neuron_bits = (neurons - 1).bit_length()
    slot_bits = (slots - 1).bit_length()
    receptor_bits = (spinnaker.RECEPTOR_COUNT - 1).bit_length()
    return neuron_bits + slot_bits + receptor_bits


def _fit_rows(incoming: list[SignedSynapses], neurons: int, chip: SpinnakerChip) -> bool:
    return all(longest_row(part, neurons) <= chip.synapses_per_row for part in incoming)


def longest_row(synapses: SignedSynapses, neurons: int) -> int:
    """Return the most synapses that one source has on a core, if a core has this many ``neurons``."""
    core = synapses.target_index // neurons
    rows = np.stack([synapses.source_index, core])
    _, synapse_counts = np.unique(rows, axis=1, return_counts=True)
    return int(synapse_counts.max(initial=0))
