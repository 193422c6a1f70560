"""Lay out every neuron model as compartments twice, as numbers of a twin: as the float neuron, and as the program.

Each layout (*form*) has exact and chip numbers side by side (``numbers.py``). The two forms are the same object if
lowering is exact apart from rounding. That is not so for two strategies: ``delay-line`` has a finite number of taps,
and ``reset`` is a different neuron. For these, the float neuron is laid out as strategy ``dendrite`` would lay it
out, with the chip's numbers wherever the program has a part for it.
"""

from dataclasses import replace
from functools import singledispatch

import numpy as np

from hw_model.mapping.graph import CompartmentGraph
from hw_model.values import FloatArray
from locsnn_compile.network.neurons import Cuba, Neuron, SoftCuba, SrmAlpha, alpha_recursion
from locsnn_compile.network.quantized import QuantizedPopulation
from locsnn_compile.passes.kernels import kernel, own_charges
from locsnn_compile.passes.lower_neurons import dendrite_name
from locsnn_compile.pipeline import Levels
from locsnn_compile.verification.error_budget import numbers
from locsnn_compile.verification.error_budget.numbers import GroupNumbers, Numbers, SynapseNumbers
from locsnn_compile.verification.error_budget.twin import TwinGroup, TwinSynapses

SLACK = 1e-14
"""Relative distance by which exact thresholds are moved, so that a potential that equals the threshold in the float
network is still on the same side of it after both have been scaled and rounded in float64."""


@singledispatch
def forms_of(neuron: Neuron, levels: Levels, q: QuantizedPopulation) -> tuple[Numbers, Numbers]:
    """Return the numbers of the float neuron and of the program's; the same object if they do not differ.

    For on-grid neurons, the reference uses the chip's own arithmetic, so both are the chip's numbers. So they are for a
    model that has registered no numbers: its differences stay unexplained.
    """
    graph = levels.compartments
    name = q.population.name
    # Dendrites before the soma: a twin has children before their parents.
    compartments = [g for g in graph.groups if g.joined_to == name] + [graph.group(name)]
    groups = []
    synapses = []
    for group in compartments:
        chip = numbers.chip_group(group)
        groups.append(GroupNumbers(exact=chip, chip=chip))
        for (source, delay), weights in numbers.chip_weights(graph, group.name).items():
            as_synapses = TwinSynapses(source, group.name, weights, delay)
            synapses.append(SynapseNumbers(as_synapses, weights, weights, weights))
    same = Numbers(tuple(groups), tuple(synapses))
    return same, same


@forms_of.register
def _(neuron: SrmAlpha, levels: Levels, q: QuantizedPopulation) -> tuple[Numbers, Numbers]:
    if q.strategy == "delay-line":
        return _delay_line(levels, q, neuron)
    if q.strategy == "reset":
        return _reset(levels, q, neuron)
    same = _dendrite(levels, q, neuron)
    return same, same


def _dendrite(levels: Levels, q: QuantizedPopulation, neuron: SrmAlpha) -> Numbers:
    """Lay out as many pairs of dendrites as the chip has, each with an equal share of the float weights."""
    graph = levels.compartments
    name = q.population.name
    count = q.neuron.dendrites
    soma = numbers.chip_group(graph.group(name))
    pairs = []
    for number in range(count):
        dendrite, own = (
            numbers.chip_group(graph.group(dendrite_name(name, kind, number)))
            for kind in ("dendrite", "refractory")
        )
        pairs.append(_srm(levels, q, neuron, dendrite, own, soma, share=1 / count))
    # The last group of each pair is the soma, which all pairs share.
    dendrites = [group for pair in pairs for group in pair.groups[:-1]]
    shared_soma = pairs[0].groups[-1]
    return Numbers((*dendrites, shared_soma), tuple(s for pair in pairs for s in pair.synapses))


def _delay_line(
    levels: Levels, q: QuantizedPopulation, neuron: SrmAlpha
) -> tuple[Numbers, Numbers]:
    """Lay out the program with taps onto the alpha dendrite, and the float neuron with a refractory dendrite.

    The float neuron also has the taps, but only with their rounding errors, which belong to the stage of weights.
    """
    graph = levels.compartments
    name = q.population.name
    dendrite = numbers.chip_group(graph.group(f"{name}/dendrite"))
    soma = numbers.chip_group(graph.group(name))
    with_refractory = _srm(levels, q, neuron, dendrite, None, soma)
    alpha, _, soma_numbers = with_refractory.groups
    taps = _taps(graph, q, neuron, alpha)
    zeros = np.zeros(q.population.size)
    rounding_errors = []
    for tap in taps:
        error = tap.chip - tap.exact_fitted
        no_tap = replace(tap.exact, weights=zeros)
        rounding_errors.append(SynapseNumbers(no_tap, zeros, error, error))
    float_neuron = replace(with_refractory, synapses=(*with_refractory.synapses, *rounding_errors))
    inputs = tuple(s for s in with_refractory.synapses if s.exact.target == alpha.exact.name)
    program = Numbers((alpha, soma_numbers), (*inputs, *taps))
    return float_neuron, program


def _taps(
    graph: CompartmentGraph, q: QuantizedPopulation, neuron: SrmAlpha, alpha: GroupNumbers
) -> list[SynapseNumbers]:
    """Return the self-synapses whose response is the refractory kernel, up to the last tap of the chip."""
    name = q.population.name
    n = q.population.size
    weight_of_delay = {
        delay: m.diagonal()
        for (source, delay), m in numbers.chip_weights(graph, alpha.chip.name).items()
        if source == name
    }
    # A tap of delay d acts k = d + 1 steps after the spike. Without taps, there are no lags.
    last_lag = max(weight_of_delay, default=-1) + 1
    k = np.arange(1, last_lag + 1, dtype=np.float64)[:, None]
    response = -neuron.scale_ref * neuron.theta * kernel(neuron.tau_ref, k) * q.scale
    # The charges with this response, for exact decays and for the chip's.
    exact, fitted = (own_charges(response, group.keep_u) for group in (alpha.exact, alpha.chip))
    taps = []
    for delay in range(len(k)):
        chip = weight_of_delay.get(delay, np.zeros(n))
        tap = TwinSynapses(name, alpha.exact.name, exact[delay], delay)
        rounding_error = chip - fitted[delay]
        taps.append(
            SynapseNumbers(
                exact=tap,
                exact_fitted=fitted[delay],
                chip=chip,
                chip_fitted=exact[delay] + rounding_error,
            )
        )
    return taps


def _reset(levels: Levels, q: QuantizedPopulation, neuron: SrmAlpha) -> tuple[Numbers, Numbers]:
    """Lay out the program as one compartment with the chip's reset, and the float neuron with dendrites."""
    name = q.population.name
    chip = numbers.chip_group(levels.compartments.group(name))
    # The program has no dendrites: make the chip's numbers for them from its compartment, and a soma that keeps
    # nothing.
    zeros = np.zeros(q.population.size)
    no_refractory_steps = np.ones(q.population.size, dtype=np.int64)
    dendrite = replace(chip, name=f"{name}/dendrite", joined_to=name)
    soma = replace(chip, keep_u=zeros, keep_v=zeros, refractory=no_refractory_steps)
    float_neuron = _srm(levels, q, neuron, dendrite, None, soma)
    alpha, _, soma_numbers = float_neuron.groups
    exact = _exactly(chip, alpha.exact.keep_u, alpha.exact.keep_v, soma_numbers.exact.threshold)
    # The same inputs, onto the compartment itself.
    inputs = [
        replace(s, exact=replace(s.exact, target=name))
        for s in float_neuron.synapses
        if s.exact.target == alpha.exact.name
    ]
    return float_neuron, Numbers((GroupNumbers(exact, chip),), tuple(inputs))


def _srm(  # noqa: PLR0913 - what earlier steps made, each used once
    levels: Levels,
    q: QuantizedPopulation,
    neuron: SrmAlpha,
    dendrite: TwinGroup,
    refractory: TwinGroup | None,
    soma: TwinGroup,
    share: float = 1.0,
) -> Numbers:
    """Lay out an SRM neuron as an alpha dendrite, a refractory dendrite and a memoryless soma, in this order.

    ``dendrite``, ``refractory`` and ``soma`` are the chip's numbers; without a refractory dendrite on the chip, its
    numbers are exact ones. The dendrites get a ``share`` of the weights.
    """
    graph = levels.compartments
    name = q.population.name
    n = q.population.size
    # The float neuron spikes at its threshold: a tie must spike.
    threshold = neuron.theta * q.scale * (1 - SLACK)

    def exactly(chip: TwinGroup, keep: float) -> TwinGroup:
        return _exactly(chip, np.full(n, keep), np.full(n, keep), threshold)

    a, gain = alpha_recursion(neuron.tau_sr)
    refractory_a, refractory_gain = alpha_recursion(neuron.tau_ref)
    alpha_numbers = GroupNumbers(exactly(dendrite, a), dendrite)
    own_spikes = TwinSynapses(
        source=name,
        target=f"{name}/refractory" if refractory is None else refractory.name,
        weights=-neuron.scale_ref * neuron.theta * refractory_gain * share * q.scale,
    )
    if refractory is None:
        exact = exactly(replace(dendrite, name=own_spikes.target), refractory_a)
        refractory_numbers = GroupNumbers(exact, exact)
        weights = own_spikes.weights
        self_synapses: tuple[SynapseNumbers, ...] = (
            SynapseNumbers(own_spikes, weights, weights, weights),
        )
    else:
        refractory_numbers = GroupNumbers(exactly(refractory, refractory_a), refractory)
        self_synapses = numbers.beside_chip(
            graph, [own_spikes], refractory_numbers, refractory.name
        )
    inputs = numbers.exact_synapses(levels.network, name, dendrite.name, gain * share * q.scale)
    # A program without dendrites has the weights onto its only compartment.
    has_dendrite = any(group.name == dendrite.name for group in graph.groups)
    held_by = dendrite.name if has_dendrite else name
    return Numbers(
        groups=(alpha_numbers, refractory_numbers, GroupNumbers(exactly(soma, 0.0), soma)),
        synapses=(*numbers.beside_chip(graph, inputs, alpha_numbers, held_by), *self_synapses),
    )


@forms_of.register
def _(neuron: Cuba, levels: Levels, q: QuantizedPopulation) -> tuple[Numbers, Numbers]:
    """Lay out a leaky integrate-and-fire neuron in one compartment."""
    name = q.population.name
    chip = numbers.chip_group(levels.compartments.group(name))
    # A potential that equals the threshold spikes only with the rule ">=".
    slack = SLACK if neuron.rule == ">" else -SLACK
    threshold = neuron.threshold * q.scale * (1 + slack)
    exact = replace(
        _exactly(chip, 1.0 - neuron.decay_u, 1.0 - neuron.decay_v, threshold),
        bias=neuron.bias * q.scale,
        floor=_floor(neuron, q),
    )
    group = GroupNumbers(exact, chip)
    synapses = numbers.exact_synapses(levels.network, name, name, q.scale)
    same = Numbers((group,), numbers.beside_chip(levels.compartments, synapses, group, name))
    return same, same


@forms_of.register
def _(neuron: SoftCuba, levels: Levels, q: QuantizedPopulation) -> tuple[Numbers, Numbers]:
    """Lay out a dendrite that is never reset, from which own spikes take the drop, and a memoryless soma."""
    graph = levels.compartments
    name = q.population.name
    dendrite = numbers.chip_group(graph.group(f"{name}/dendrite"))
    soma = numbers.chip_group(graph.group(name))
    threshold = neuron.threshold * q.scale * (1 + SLACK)
    keep_u, keep_v = 1.0 - neuron.decay_u, 1.0 - neuron.decay_v
    exact = replace(_exactly(dendrite, keep_u, keep_v, threshold), floor=_floor(neuron, q))
    membrane = GroupNumbers(exact, dendrite)
    soma_numbers = GroupNumbers(_exactly(soma, soma.keep_u, soma.keep_v, threshold), soma)
    drop = neuron.drop * q.scale
    synapses = numbers.exact_synapses(levels.network, name, dendrite.name, q.scale)
    # The drop goes through the current, which keeps a share of it; that is cancelled one step later.
    for delay, own_weight in ((0, -drop), (1, drop * keep_u)):
        # The chip's weights are looked up by source and delay, so recurrent weights of the same delay are added.
        recurrent = next((s for s in synapses if (s.source, s.delay) == (name, delay)), None)
        weights = own_weight
        if recurrent is not None:
            weights = recurrent.weights + np.diag(own_weight)
        synapses = [s for s in synapses if s is not recurrent]
        synapses.append(TwinSynapses(name, dendrite.name, weights, delay))
    same = Numbers(
        (membrane, soma_numbers), numbers.beside_chip(graph, synapses, membrane, dendrite.name)
    )
    return same, same


def _floor(neuron: Cuba | SoftCuba, q: QuantizedPopulation) -> FloatArray | None:
    """Return the floors (n,) in units of the registers."""
    return None if neuron.floor is None else neuron.floor * q.scale


def _exactly(
    group: TwinGroup, keep_u: FloatArray, keep_v: FloatArray, threshold: FloatArray
) -> TwinGroup:
    """Return a group with these numbers, whose registers hold any real number."""
    return replace(
        group, keep_u=keep_u, keep_v=keep_v, threshold=threshold, truncates=False, limited=False
    )
