"""Lower a graph of compartments to a network of IF_curr_exp.

Before: a ``CompartmentGraph`` of single compartments, in the integers of ``loihi``.
After:  ``LoweredSpinnaker``: populations with their scales, and projections by receptor.

Scales are chosen population by population, for the largest sums that a step can bring to any of its
neurons: :mod:`hw_model.arithmetic.spinnaker_inverse` says how. Then nothing wraps or saturates.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import loihi, spinnaker
from hw_model.arithmetic import spinnaker_inverse as inverse
from hw_model.arithmetic.spinnaker_inverse import IfCurrExp, LeakyNeuron, Membrane, Scales, Sums
from hw_model.mapping.graph import CompartmentGraph, Compartments
from hw_model.spinnaker.chips import SpinnakerChip
from hw_model.spinnaker.network import (
    RECEPTORS,
    SpinnakerNetwork,
    SpinnakerPopulation,
    SpinnakerProjection,
)
from hw_model.values import FloatArray, IntArray, Shown
from locsnn_compile.spinnaker.core_room import neurons_per_core, slots_for
from locsnn_compile.spinnaker.fits import check_compartments
from locsnn_compile.spinnaker.synapses import (
    SignedSynapses,
    arriving,
    joined_synapses,
    largest_sums,
)


class ScaledPopulation(Shown):
    """How the numbers of a population were chosen.

    - ``sums``: the largest that weights of each sign bring to a neuron in a step, in units of the
      integer weights
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


class _LoweredGroup(NamedTuple):
    """What a group of compartments becomes, with the projections onto it."""

    population: SpinnakerPopulation
    projections: list[SpinnakerProjection]
    scaled: ScaledPopulation


class _FittedNeuron(NamedTuple):
    """A neuron in the numbers of SpiNNaker: its time constants, and what depends on its scales."""

    membrane: Membrane
    parameters: IfCurrExp


class _StoredProjection(NamedTuple):
    """A projection, and how many of its weights lost bits when they were stored."""

    projection: SpinnakerProjection
    weights_rounded: int


def lower_to_spinnaker(graph: CompartmentGraph, chip: SpinnakerChip) -> LoweredSpinnaker:
    """Lower a graph; ``TargetError`` for what SpiNNaker does not have."""
    synapses = joined_synapses(graph)
    arrivals = {group.name: arriving(synapses, group.name, group.size) for group in graph.groups}
    charges = {name: _charges(sums) for name, sums in arrivals.items()}
    check_compartments(graph, charges)
    populations_read = set() if graph.readout is None else set(graph.readout.from_step)
    populations: list[SpinnakerPopulation] = []
    projections: list[SpinnakerProjection] = []
    scaled: list[ScaledPopulation] = []
    for group in graph.groups:
        lowered = _lowered_group(
            group,
            incoming=[part for part in synapses if part.target == group.name],
            sums=largest_sums(arrivals[group.name]),
            is_read=group.name in populations_read,
            chip=chip,
        )
        populations.append(lowered.population)
        projections.extend(lowered.projections)
        scaled.append(lowered.scaled)
    network = SpinnakerNetwork(graph.phases, graph.inputs, tuple(populations), tuple(projections))
    return LoweredSpinnaker(network, tuple(scaled))


def _charges(sums: IntArray) -> FloatArray:
    """Return the lowest and the highest charge of a step, (2, n), in the unit of u.

    ``sums`` (2, n) are those of weights above and below 0, both without sign.
    """
    excitatory, inhibitory = sums
    lowest_and_highest = np.stack([-inhibitory, excitatory])
    charges: FloatArray = loihi.in_registers(lowest_and_highest).astype(np.float64)
    return charges


def _lowered_group(
    group: Compartments,
    *,
    incoming: list[SignedSynapses],
    sums: Sums,
    is_read: bool,
    chip: SpinnakerChip,
) -> _LoweredGroup:
    """Return what a group becomes, of synapses that bring at most ``sums`` to a neuron in a step."""
    scales = scales_of(group, sums)
    neurons = _fitted_neurons(group, scales)
    gain = _mean_gain(neurons, scales)
    excitatory_shift = inverse.shift_for(sums.excitatory * scales.weight_unit)
    inhibitory_shift = inverse.shift_for(sums.inhibitory * scales.weight_unit)
    shifts = (excitatory_shift, inhibitory_shift)
    slots = slots_for(incoming)
    population = SpinnakerPopulation(
        name=group.name,
        phase=group.phase,
        parameters=_parameters(group, neurons, is_read=is_read),
        shifts=shifts,
        slots=slots,
        neurons_per_core=neurons_per_core(group.size, slots, incoming, chip),
        weight_unit=scales.weight_unit,
        potential_unit=gain,
    )
    stored: list[_StoredProjection] = []
    for part in incoming:
        stored.extend(_by_receptor(part, shifts, scales.weight_unit))
    scaled = ScaledPopulation(
        name=group.name,
        scales=scales,
        sums=sums,
        gain=gain,
        current_decay_error=_current_decay_error(group),
        weights_rounded=sum(part.weights_rounded for part in stored),
    )
    return _LoweredGroup(population, [part.projection for part in stored], scaled)


def scales_of(group: Compartments, sums: Sums) -> Scales:
    """Return the largest scales at which no neuron of a group can wrap."""
    neurons = _bounding_neurons(group)
    weight = max(
        inverse.weight_scale(inverse.membrane_of(neuron.decay_u, neuron.decay_v), sums)
        for neuron in neurons
    )
    potential = max(inverse.potential_scale(neuron, sums, weight) for neuron in neurons)
    return Scales(weight, potential)


def _bounding_neurons(group: Compartments) -> list[LeakyNeuron]:
    """Return the neurons of a group that differ in what its scales depend on: decays and bias.

    A bias counts without its sign, and thresholds and refractory periods do not count.
    """
    bias = loihi.bias_of(group.bias_mantissa, group.bias_exponent)
    settings = np.stack([group.decay_u, group.decay_v, np.abs(bias)])
    distinct = np.unique(settings, axis=1)
    return [
        LeakyNeuron(decay_u, decay_v, threshold=0, bias=bias_magnitude, refractory=1)
        for decay_u, decay_v, bias_magnitude in distinct.T.tolist()
    ]


def _fitted_neurons(group: Compartments, scales: Scales) -> list[_FittedNeuron]:
    """Return each neuron of a group in the numbers of SpiNNaker; equal ones are fitted once."""
    bias = loihi.bias_of(group.bias_mantissa, group.bias_exponent)
    settings = np.stack([group.decay_u, group.decay_v, group.threshold, bias, group.refractory])
    distinct, index_of_neuron = np.unique(settings, axis=1, return_inverse=True)
    fitted = [_fitted(LeakyNeuron(*setting), scales) for setting in distinct.T.tolist()]
    return [fitted[index] for index in index_of_neuron.ravel().tolist()]


def _fitted(neuron: LeakyNeuron, scales: Scales) -> _FittedNeuron:
    membrane = inverse.membrane_of(neuron.decay_u, neuron.decay_v)
    return _FittedNeuron(membrane, inverse.fitted(neuron, scales))


def _parameters(
    group: Compartments, neurons: list[_FittedNeuron], *, is_read: bool
) -> spinnaker.Parameters:
    """Return the parameters of a group; neurons whose potentials are read out never spike."""
    tau_syn = np.array([neuron.membrane.tau_syn for neuron in neurons])
    if is_read:
        v_thresh = np.full(group.size, inverse.UNREACHABLE)
    else:
        v_thresh = np.array([neuron.parameters.v_thresh for neuron in neurons])
    zero = np.zeros(group.size, dtype=np.int64)
    return spinnaker.Parameters(
        tau_m=np.array([neuron.membrane.tau_m for neuron in neurons]),
        c_m=np.array([neuron.parameters.c_m for neuron in neurons]),
        tau_syn=np.stack([tau_syn] * spinnaker.RECEPTORS, axis=1),
        v_rest=zero,
        v_reset=zero,
        v_thresh=v_thresh,
        v_init=zero,
        i_offset=np.array([neuron.parameters.i_offset for neuron in neurons]),
        tau_refrac=inverse.refractory_time(group.refractory),
    )


def _mean_gain(neurons: list[_FittedNeuron], scales: Scales) -> float:
    """Return how far a weight of 1 lifts V at once, in mV, the mean of neurons."""
    total = 0.0
    for neuron in neurons:
        total += float(inverse.gain_of(neuron.parameters.c_m, neuron.membrane, scales))
    return total / len(neurons)


def _current_decay_error(group: Compartments) -> float:
    """Return the largest difference of what a step keeps of a current, as a share."""
    decays = set(group.decay_u.tolist())
    return max(inverse.current_decay_error(decay) for decay in decays)


def _by_receptor(
    synapses: SignedSynapses, shifts: tuple[int, int], weight_unit: float
) -> Iterator[_StoredProjection]:
    """Yield the projections that synapses become: weights above 0 excite, those below inhibit.

    ``shifts`` are those of the receptors, and ``weight_unit`` is the current, nA, of a weight of 1.
    """
    is_of_receptor = (synapses.weight > 0, synapses.weight < 0)
    for receptor, shift, acts in zip(RECEPTORS, shifts, is_of_receptor, strict=True):
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
        yield _StoredProjection(projection, inverse.loses_bits(currents, shift))
