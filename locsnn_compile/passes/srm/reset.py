"""Strategy ``reset``: one compartment, whose own reset and refractory count stand in for the refractory kernel."""

import math
from collections.abc import Iterable

from hw_model.arithmetic.fixed_point import DECAY_ONE
from hw_model.description.chip import Chip
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.neurons import SrmAlpha


def heaviest_charge(neuron: SrmAlpha, decay: int, chip: Chip, where: str) -> float:
    """Return 0: there are no self-synapses."""
    return 0.0


def lay_out(neuron: SrmAlpha, size: int, decay: int, thresholds: Iterable[int], chip: Chip, where: str) -> ChipCuba:
    """Return the neurons at the largest of the threshold mantissas."""
    count = min(chip.registers.refractory_max, refractory_count(neuron, decay))
    return ChipCuba.of(size, decay_u=decay, decay_v=decay, threshold=max(thresholds), refractory=count)


def refractory_count(neuron: SrmAlpha, decay: int) -> int:
    """Return the least count with which a spike takes as much from the potential, summed over steps, as nu does.

    A reset takes a threshold, which would have faded by ``decay``: ``4096 / decay`` thresholds over all steps; each
    blocked step one more. At the published time constants the reset alone takes twice what nu takes, and more blocked
    steps only make it worse: on training recordings of both example networks a count of 1 kept most predictions.
    """
    kept = math.exp(-1.0 / neuron.tau_ref)
    taken = neuron.scale_ref * math.e / neuron.tau_ref * kept / (1.0 - kept) ** 2
    return 1 + max(0, math.ceil(taken - DECAY_ONE / decay))
