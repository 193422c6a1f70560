"""Lower a graph of compartments to a network of IF_curr_exp, the neuron model of SpiNNaker.

Before: a ``CompartmentGraph`` of single compartments, in the integers of ``loihi``.
After:  ``LoweredSpinnaker``: populations with their scales, and projections by receptor.

A *scale* says how many nA an integer weight of 1 becomes, or how many mV a potential of 1. The scales of a population
are as large as possible, so that rounding matters little, and small enough that nothing wraps or saturates even if all
sources spike at once: :mod:`hw_model.arithmetic.spinnaker_inverse` has the formulas. Synapses with positive weights
go to the excitatory receptor, those with negative weights to the inhibitory one.
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
    """The scales of a population, and what was lost by rounding.

    - ``sums``: the largest sum of weights of each sign that arrives at a neuron in a step, in integer weights
    - ``gain``: by how many mV a weight of 1 raises V at once, after rounding; the mean over the neurons
    - ``current_decay_error``: the largest relative error of the share of a current that is left after a step
    - ``weights_rounded``: the number of weights that lost bits when they were stored
    """

    name: str
    scales: Scales
    sums: Sums
    gain: float
    current_decay_error: float
    weights_rounded: int


class LoweredSpinnaker(Shown):
    """A network for SpiNNaker, with the scales of each population."""

    network: SpinnakerNetwork
    scaled: tuple[ScaledPopulation, ...]


class _LoweredGroup(NamedTuple):
    """What a group of compartments becomes, with the projections onto it."""

    population: SpinnakerPopulation
    projections: list[SpinnakerProjection]
    scaled: ScaledPopulation


class _FittedNeuron(NamedTuple):
    """A neuron in SpiNNaker's numbers: its time constants (``membrane``), and the parameters that depend on scales."""

    membrane: Membrane
    parameters: IfCurrExp


class _StoredProjection(NamedTuple):
    """A projection, and how many of its weights lost bits when they were stored."""

    projection: SpinnakerProjection
    weights_rounded: int


def lower_to_spinnaker(graph: CompartmentGraph, chip: SpinnakerChip) -> LoweredSpinnaker:
    """Lower a graph; raise ``TargetError`` if it has something that SpiNNaker does not have."""
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
    """Return the lowest and the highest charge of a step, (2, n), in units of the register u.

    ``sums`` (2, n) has the sums of positive and of negative weights, both without sign.
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
    """Return the population and projections that a group becomes.

    ``incoming`` is all synapses onto the group, which bring at most ``sums`` to a neuron in a step. ``is_read`` says
    whether the readout reads its potentials.
    """
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
    """Return the largest scales at which no neuron of a group can wrap.

    A scale is an exponent here: the unit is 2^-scale. So the neuron that needs the largest exponent decides.
    """
    neurons = _bounding_neurons(group)
    membranes = [inverse.membrane_of(neuron.decay_u, neuron.decay_v) for neuron in neurons]
    weight_scale = max(inverse.weight_scale(membrane, sums) for membrane in membranes)
    potential_scale = max(inverse.potential_scale(neuron, sums, weight_scale) for neuron in neurons)
    return Scales(weight_scale, potential_scale)


def _bounding_neurons(group: Compartments) -> list[LeakyNeuron]:
    """Return one neuron for each combination of decays and bias in a group, since scales depend only on these.

    A bias counts without its sign. Thresholds and refractory periods do not matter, so they get any value.
    """
    bias = loihi.bias_of(group.bias_mantissa, group.bias_exponent)
    settings = np.stack([group.decay_u, group.decay_v, np.abs(bias)])
    distinct = np.unique(settings, axis=1)
    return [
        LeakyNeuron(decay_u, decay_v, threshold=0, bias=bias_magnitude, refractory=1)
        for decay_u, decay_v, bias_magnitude in distinct.T.tolist()
    ]


def _fitted_neurons(group: Compartments, scales: Scales) -> list[_FittedNeuron]:
    """Return each neuron of a group in SpiNNaker's numbers; neurons with equal parameters are fitted only once."""
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
    """Return the parameters of a group. If its potentials are read out (``is_read``), its neurons never spike."""
    tau_syn = np.array([neuron.membrane.tau_syn for neuron in neurons])
    if is_read:
        v_thresh = np.full(group.size, inverse.UNREACHABLE)
    else:
        v_thresh = np.array([neuron.parameters.v_thresh for neuron in neurons])
    zero = np.zeros(group.size, dtype=np.int64)
    return spinnaker.Parameters(
        tau_m=np.array([neuron.membrane.tau_m for neuron in neurons]),
        c_m=np.array([neuron.parameters.c_m for neuron in neurons]),
        tau_syn=np.stack([tau_syn] * spinnaker.RECEPTOR_COUNT, axis=1),
        v_rest=zero,
        v_reset=zero,
        v_thresh=v_thresh,
        v_init=zero,
        i_offset=np.array([neuron.parameters.i_offset for neuron in neurons]),
        tau_refrac=inverse.refractory_time(group.refractory),
    )


def _mean_gain(neurons: list[_FittedNeuron], scales: Scales) -> float:
    """Return by how many mV a weight of 1 raises V at once, the mean over the neurons."""
    total = 0.0
    for neuron in neurons:
        total += float(inverse.gain_of(neuron.parameters.c_m, neuron.membrane, scales))
    return total / len(neurons)


def _current_decay_error(group: Compartments) -> float:
    """Return the largest relative error, over the neurons, of the share of a current that is left after a step."""
    decays = set(group.decay_u.tolist())
    return max(inverse.current_decay_error(decay) for decay in decays)


def _by_receptor(
    synapses: SignedSynapses, shifts: tuple[int, int], weight_unit: float
) -> Iterator[_StoredProjection]:
    """Yield the projections that synapses become: positive weights to the excitatory receptor, negative to the other.

    ``shifts`` has the shift of each receptor; ``weight_unit`` is the current in nA of an integer weight of 1.
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
