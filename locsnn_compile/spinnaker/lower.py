"""Lower a graph of compartments to a network of IF_curr_exp.

Before: a ``CompartmentGraph`` of single compartments, in the integers of ``loihi``.
After:  ``LoweredSpinnaker``: populations with their scales, and projections by receptor.

Scales are chosen population by population, for the largest sums that a step can bring to any of its
neurons: :mod:`hw_model.arithmetic.spinnaker_inverse` says how. Then nothing wraps or saturates.
"""

from collections.abc import Iterator

import numpy as np

from hw_model.arithmetic import loihi, spinnaker
from hw_model.arithmetic import spinnaker_inverse as inverse
from hw_model.arithmetic.spinnaker_inverse import IfCurrExp, LeakyNeuron, Scales, Sums
from hw_model.mapping.graph import CompartmentGraph, Compartments
from hw_model.spinnaker.chips import SpinnakerChip
from hw_model.spinnaker.network import (
    RECEPTORS,
    SpinnakerNetwork,
    SpinnakerPopulation,
    SpinnakerProjection,
)
from hw_model.values import FloatArray, IntArray, Shown
from locsnn_compile.spinnaker.fits import check_compartments
from locsnn_compile.spinnaker.synapses import (
    SignedSynapses,
    arriving,
    joined_synapses,
    largest_sums,
)

SLOTS_MIN = 2


class ScaledPopulation(Shown):
    """How the numbers of a population were chosen.

    - ``sums``: the largest that weights of each sign bring to a neuron in a step, in weights of 1
    - ``gain``: mV by which a weight of 1 lifts V at once, as rounded, the mean of its neurons
    - ``current_decay_error``: the largest difference of what a step keeps of a current, as a share
    - ``weights_rounded``: weights that lost bits when they were stored
    """

    name: str
    scales: Scales
    sums: Sums
    gain: float
    current_decay_error: float
    weights_rounded: int


class LoweredSpinnaker(Shown):
    """A network for SpiNNaker, and how its numbers were chosen, population by population."""

    network: SpinnakerNetwork
    scaled: tuple[ScaledPopulation, ...]


def lower_to_spinnaker(graph: CompartmentGraph, chip: SpinnakerChip) -> LoweredSpinnaker:
    """Lower a graph; ``TargetError`` for what SpiNNaker does not have."""
    synapses = joined_synapses(graph)
    arrivals = {group.name: arriving(synapses, group.name, group.size) for group in graph.groups}
    check_compartments(graph, {name: _charges(sums) for name, sums in arrivals.items()})
    read = set() if graph.readout is None else set(graph.readout.from_step)
    populations = []
    projections: list[SpinnakerProjection] = []
    scaled = []
    for group in graph.groups:
        incoming = [part for part in synapses if part.target == group.name]
        sums = largest_sums(arrivals[group.name])
        scales = scales_of(group, sums)
        shifts = tuple(inverse.shift_for(each * scales.weight_unit) for each in sums)
        neurons = _neurons(group, scales)
        gain = _gain(group, neurons, scales)
        slots = slots_for(incoming)
        populations.append(
            SpinnakerPopulation(
                name=group.name,
                phase=group.phase,
                parameters=_parameters(group, neurons, silent=group.name in read),
                shifts=(shifts[0], shifts[1]),
                slots=slots,
                neurons_per_core=neurons_per_core(group.size, slots, incoming, chip),
                weight_unit=scales.weight_unit,
                potential_unit=gain,
            )
        )
        rounded = 0
        for part in incoming:
            for projection, lost in _by_receptor(part, shifts, scales.weight_unit):
                projections.append(projection)
                rounded += lost
        scaled.append(
            ScaledPopulation(
                name=group.name,
                scales=scales,
                sums=sums,
                gain=gain,
                current_decay_error=_current_decay_error(group),
                weights_rounded=rounded,
            )
        )
    network = SpinnakerNetwork(graph.phases, graph.inputs, tuple(populations), tuple(projections))
    return LoweredSpinnaker(network, tuple(scaled))


def _charges(sums: IntArray) -> FloatArray:
    """Return the lowest and the highest charge of a step, (2, n), of sums of each sign."""
    signed = np.stack([-sums[1], sums[0]])
    charges: FloatArray = loihi.in_registers(signed).astype(np.float64)
    return charges


def scales_of(group: Compartments, sums: Sums) -> Scales:
    """Return the largest scales at which no neuron of a group can wrap."""
    bias = loihi.bias_of(group.bias_mantissa, group.bias_exponent)
    different = np.unique(np.stack([group.decay_u, group.decay_v, np.abs(bias)]), axis=1)
    neurons = [
        LeakyNeuron(decay_u, decay_v, threshold=0, bias=strongest, refractory=1)
        for decay_u, decay_v, strongest in different.T.tolist()
    ]
    weight = max(
        inverse.weight_scale(inverse.membrane_of(neuron.decay_u, neuron.decay_v), sums)
        for neuron in neurons
    )
    potential = max(inverse.potential_scale(neuron, sums, weight) for neuron in neurons)
    return Scales(weight, potential)


def _neurons(group: Compartments, scales: Scales) -> list[tuple[LeakyNeuron, IfCurrExp]]:
    """Return each neuron of a group with the parameters that depend on its scales."""
    bias = loihi.bias_of(group.bias_mantissa, group.bias_exponent)
    columns = np.stack([group.decay_u, group.decay_v, group.threshold, bias, group.refractory])
    different, place = np.unique(columns, axis=1, return_inverse=True)
    neurons = [LeakyNeuron(*column) for column in different.T.tolist()]
    fitted = [(neuron, inverse.fitted(neuron, scales)) for neuron in neurons]
    return [fitted[number] for number in place.ravel().tolist()]


def _parameters(
    group: Compartments, neurons: list[tuple[LeakyNeuron, IfCurrExp]], *, silent: bool
) -> spinnaker.Parameters:
    """Return the parameters of a group; ``silent`` neurons are read out and never spike."""
    membranes = [inverse.membrane_of(neuron.decay_u, neuron.decay_v) for neuron, _ in neurons]
    tau_syn = np.array([membrane.tau_syn for membrane in membranes])
    v_thresh = np.array([fitted.v_thresh for _, fitted in neurons])
    zero = np.zeros(group.size, dtype=np.int64)
    return spinnaker.Parameters(
        tau_m=np.array([membrane.tau_m for membrane in membranes]),
        c_m=np.array([fitted.c_m for _, fitted in neurons]),
        tau_syn=np.stack([tau_syn] * spinnaker.RECEPTORS, axis=1),
        v_rest=zero,
        v_reset=zero,
        v_thresh=np.full(group.size, inverse.UNREACHABLE) if silent else v_thresh,
        v_init=zero,
        i_offset=np.array([fitted.i_offset for _, fitted in neurons]),
        tau_refrac=inverse.refractory_time(group.refractory),
    )


def _gain(
    group: Compartments, neurons: list[tuple[LeakyNeuron, IfCurrExp]], scales: Scales
) -> float:
    total = 0.0
    for neuron, fitted in neurons:
        membrane = inverse.membrane_of(neuron.decay_u, neuron.decay_v)
        total += float(inverse.gain_of(fitted.c_m, membrane, scales))
    return total / group.size


def _current_decay_error(group: Compartments) -> float:
    """Return the largest difference of what a step keeps of a current, as a share."""
    return max(inverse.current_decay_error(decay) for decay in set(group.decay_u.tolist()))


def slots_for(incoming: list[SignedSynapses]) -> int:
    """Return how many slots a ring buffer has: the least power of two that holds every delay."""
    longest = max((int(part.delay.max(initial=0)) for part in incoming), default=0)
    slots = SLOTS_MIN
    while slots < longest:
        slots *= 2
    return slots


def neurons_per_core(
    size: int, slots: int, incoming: list[SignedSynapses], chip: SpinnakerChip
) -> int:
    """Return the most neurons of a population, a power of two, that a core has room for.

    Where not even one fits, that is 1, and the check of the whole network says what is too much.
    """
    most = chip.neurons_per_core
    while most > 1:
        index_bits = (min(size, most) - 1).bit_length()
        slot_bits = (slots - 1).bit_length()
        receptor_bits = (spinnaker.RECEPTORS - 1).bit_length()
        fits_ring = index_bits + slot_bits + receptor_bits <= chip.ring_bits
        if fits_ring and all(longest_row(part, most) <= chip.synapses_per_row for part in incoming):
            return most
        most //= 2
    return most


def longest_row(synapses: SignedSynapses, per_core: int) -> int:
    """Return the most synapses of one source on a core of so many neurons."""
    rows = np.stack([synapses.source_index, synapses.target_index // per_core])
    _, counts = np.unique(rows, axis=1, return_counts=True)
    return int(counts.max(initial=0))


def _by_receptor(
    synapses: SignedSynapses, shifts: tuple[int, ...], weight_unit: float
) -> Iterator[tuple[SpinnakerProjection, int]]:
    """Yield the projections that synapses become, and how many of their weights are rounded."""
    signs = (synapses.weight > 0, synapses.weight < 0)
    for receptor, shift, acts in zip(RECEPTORS, shifts, signs, strict=True):
        if not acts.any():
            continue
        currents = np.abs(synapses.weight[acts]) * weight_unit
        projection = SpinnakerProjection(
            source=synapses.source,
            target=synapses.target,
            receptor=receptor,
            source_index=synapses.source_index[acts],
            target_index=synapses.target_index[acts],
            weight=inverse.stored_weights(currents, shift),
            delay=synapses.delay[acts],
        )
        yield projection, inverse.loses_bits(currents, shift)
