"""Turn neurons into compartments that the chip has.

Before: a QuantizedNetwork.
After:  a CompartmentGraph with the phases of the network. Each population becomes one or more groups of compartments;
        the group that has the population's name holds the somas, which send its spikes.

    dendrite     a memoryless soma, to which an alpha dendrite ``name/dendrite`` and a refractory dendrite
                 ``name/refractory``, driven by the neuron's own spikes, add their voltages; if there are two of
                 each, the second ones are ``name/dendrite_2`` and ``name/refractory_2``
    delay-line   a memoryless soma and an alpha dendrite ``name/dendrite``, which own spikes reach by delayed synapses
    reset        one compartment with the chip's own reset, like every leaky integrate-and-fire neuron (``native``)
"""

from dataclasses import replace
from typing import Any

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import WEIGHT_BITS, SignMode, weight_grid
from hw_model.description.chip import Chip
from hw_model.mapping.check_graph import check_graph
from hw_model.mapping.graph import CompartmentGraph, Compartments, Input, Phase, Synapses
from hw_model.values import BoolArray, IntArray
from locsnn_compile.network.chip_neurons import Refractory
from locsnn_compile.network.network import Network
from locsnn_compile.network.projections import ChipProjection, connections, values_of
from locsnn_compile.network.quantized import QuantizedNetwork, QuantizedPopulation

RECORDING = "touch"
"""The name of the stream of events that all inputs of a network read; programs and their users know it."""


def lower_neurons(quantized: QuantizedNetwork, chip: Chip) -> CompartmentGraph:
    """Lower every population by its strategy; weights of 0 make no synapse."""
    network = quantized.network
    groups: list[Compartments] = []
    synapses: list[Synapses] = []
    for population in quantized.populations:
        groups += _compartments(population, chip)
        synapses += _self_synapses(population, chip)
    for projection in quantized.projections:
        target = quantized.population(projection.target)
        synapses += _by_sign(projection, _input_group(target, projection.dendrite))
    graph = CompartmentGraph(
        name=network.name,
        phases=_phases(network),
        inputs=tuple(
            Input(
                name=view.name,
                size=view.lines,
                phase=view.phase,
                stream=RECORDING,
                positions=view.positions,
                first_lines=view.first_lines,
            )
            for view in network.views
        ),
        groups=tuple(groups),
        synapses=tuple(synapses),
        readout=quantized.readout,
        synapses_pruned=quantized.weights_pruned,
        provenance={
            "model": network.name,
            "model_sha256": network.sha256,
            "strategy": quantized.strategy,
        },
        apart=tuple(member.name for member in network.members),
    )
    check_graph(graph, chip)
    return graph


def _phases(network: Network) -> tuple[Phase, ...]:
    """Return the phases; if recordings have any length, time phases end with the recording.

    A location phase keeps its steps, since the length of a walk over the channels does not depend on the recording.
    """
    if not network.any_length:
        return network.phases
    return tuple(
        replace(phase, steps=None) if phase.axis == "time" else phase for phase in network.phases
    )


def _input_group(q: QuantizedPopulation, dendrite: int) -> str:
    """Return the name of the group that a population's inputs reach: a dendrite of the first kind, or the soma."""
    kind = next(iter(q.neuron.parts), None)
    return dendrite_name(q.population.name, kind, dendrite) if kind else q.population.name


def dendrite_name(population: str, kind: str, number: int) -> str:
    """Return the name of the group with a population's dendrites of a kind, counted from 0."""
    return f"{population}/{kind}" if number == 0 else f"{population}/{kind}_{number + 1}"


def _compartments(q: QuantizedPopulation, chip: Chip) -> list[Compartments]:
    """Return a population's groups: its somas, then its dendrites.

    A soma with dendrites forgets its voltage in every step, so the chip's reset after a spike has nothing to erase.
    """
    population = q.population
    neuron = q.neuron
    voltage_max = chip.registers.voltage_max
    usual: dict[str, Any] = {
        "bias_mantissa": 0,
        "bias_exponent": 0,
        "refractory": 1,
        "vmin": -voltage_max,
        "vmax": voltage_max,
        **neuron.limits,
    }

    def group(name: str, decays: tuple[IntArray, IntArray], **unusual: Any) -> Compartments:
        return Compartments(
            name, population.phase, population.size, *decays, neuron.threshold, **usual | unusual
        )

    all_lost = np.full(population.size, loihi.FORGETS)
    soma = (all_lost, all_lost) if neuron.parts else (neuron.decay_u, neuron.decay_v)
    groups = [group(population.name, soma, **neuron.registers)]
    for number in range(neuron.dendrites):
        for kind, decays in neuron.parts.items():
            name = dendrite_name(population.name, kind, number)
            groups.append(group(name, decays, joined_to=population.name))
    return groups


def _self_synapses(q: QuantizedPopulation, chip: Chip) -> list[Synapses]:
    """Return the self-synapses (taps) of a population: one list per dendrite, exponent and sign.

    Taps with the same exponent and sign share a synapse format, in which each synapse has its own delay. They have the
    chip's widest weights, since fewer bits would save nothing for so few synapses per neuron.
    """
    name = q.population.name
    signs: tuple[tuple[SignMode, int], ...] = (("excitatory", 1), ("inhibitory", -1))
    return [
        _own_synapses(name, dendrite_name(name, kind, number), taps, is_marked, mode, chip)
        for kind, taps in q.neuron.own.items()
        for number in range(q.neuron.dendrites)
        for e in np.unique(taps.exponent)
        for mode, sign in signs
        if (is_marked := (taps.mantissa * sign > 0) & (taps.exponent == e)[:, None]).any()
    ]


def _own_synapses(
    name: str, target: str, taps: Refractory, is_marked: BoolArray, sign_mode: SignMode, chip: Chip
) -> Synapses:
    """Return the synapses of the marked taps, ``is_marked`` (taps, n), neuron by neuron."""
    neuron, tap = np.nonzero(is_marked.T)
    mantissa = taps.mantissa[tap, neuron]
    bits = chip.registers.weight_bits[-1]
    # Weights that came with a network may be finer than this chip's. They get the widest format that any chip has, so
    # that no mantissa changes, and check_graph then reports that this chip lacks the format.
    if weight_grid(bits, sign_mode).off_grid(mantissa).any():
        bits = WEIGHT_BITS[-1]
    exponent = int(taps.exponent[tap[0]])
    return Synapses(
        source=name,
        target=target,
        source_index=neuron,
        target_index=neuron,
        mantissa=mantissa,
        delay=taps.delay[tap],
        exponent=exponent,
        weight_bits=bits,
        sign_mode=sign_mode,
    )


def _by_sign(p: ChipProjection, target_group: str) -> list[Synapses]:
    """Return the synapses of a projection: one list each for positive and negative weights, or one if signs are mixed.

    Each list has its own synapse format. Lists without synapses are left out.
    """
    target, source, index = connections(p.mantissa)
    mantissa = values_of(p.mantissa).ravel()[index]
    delay = np.broadcast_to(p.delay, values_of(p.mantissa).shape).ravel()[index]
    kinds: dict[SignMode, BoolArray]
    if p.signs == "mixed":
        kinds = {"mixed": mantissa != 0}
    else:
        kinds = {"excitatory": mantissa > 0, "inhibitory": mantissa < 0}
    return [
        Synapses(
            source=p.source,
            target=target_group,
            source_index=source[is_of_sign],
            target_index=target[is_of_sign],
            mantissa=mantissa[is_of_sign],
            delay=delay[is_of_sign],
            exponent=p.exponent,
            weight_bits=p.weight_bits,
            sign_mode=mode,
        )
        for mode, is_of_sign in kinds.items()
        if is_of_sign.any()
    ]
