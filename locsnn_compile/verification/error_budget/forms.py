"""The numbers of every neuron model side by side: those of the float neuron, and those of the program.

The two forms are the same if lowering is exact apart from rounding. Otherwise - ``delay-line`` has a finite number of
taps, ``reset`` is a different neuron - the float neuron is laid out as ``dendrite`` would lay it out, with the chip's
numbers wherever the program has any for it.
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
"""Relative: exact thresholds are moved this much to the safe side, so a tie is still a tie after scaling."""


@singledispatch
def forms_of(neuron: Neuron, levels: Levels, q: QuantizedPopulation) -> tuple[Numbers, Numbers]:
    """Return the numbers of the float neuron and of the program's; the same object if they do not differ.

    The reference of on-grid neurons is the chip's own arithmetic. So is that of a model that has registered no numbers:
    its differences stay unexplained.
    """
    graph, name = levels.compartments, q.population.name
    parts = [g for g in graph.groups if g.joined_to == name] + [graph.group(name)]
    groups, synapses = [], []
    for part in parts:
        held_by_chip = numbers.chip_group(part)
        groups.append(GroupNumbers(held_by_chip, held_by_chip))
        for (source, delay), weights in numbers.chip_weights(graph, part.name).items():
            synapses.append(
                SynapseNumbers(
                    TwinSynapses(source, part.name, weights, delay), weights, weights, weights
                )
            )
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
    graph, name, count = levels.compartments, q.population.name, q.neuron.dendrites
    soma = numbers.chip_group(graph.group(name))
    pairs = []
    for number in range(count):
        dendrite, own = (
            numbers.chip_group(graph.group(dendrite_name(name, kind, number)))
            for kind in ("dendrite", "refractory")
        )
        pairs.append(_srm(levels, q, neuron, dendrite, own, soma, share=1 / count))
    groups = [group for pair in pairs for group in pair.groups[:-1]]
    return Numbers(
        (*groups, pairs[0].groups[-1]), tuple(s for pair in pairs for s in pair.synapses)
    )


def _delay_line(
    levels: Levels, q: QuantizedPopulation, neuron: SrmAlpha
) -> tuple[Numbers, Numbers]:
    """Lay out taps onto the alpha dendrite; in the float neuron they are only the error of their rounding."""
    graph, name = levels.compartments, q.population.name
    dendrite, soma = (
        numbers.chip_group(graph.group(f"{name}/dendrite")),
        numbers.chip_group(graph.group(name)),
    )
    whole = _srm(levels, q, neuron, dendrite, None, soma)
    alpha, _, top = whole.groups
    taps = _taps(graph, q, neuron, alpha)
    nothing = np.zeros(q.population.size)
    errors = [
        SynapseNumbers(replace(tap.exact, weights=nothing), nothing, rounded, rounded)
        for tap in taps
        for rounded in [tap.chip - tap.exact_fitted]
    ]
    inputs = tuple(s for s in whole.synapses if s.exact.target == alpha.exact.name)
    return replace(whole, synapses=(*whole.synapses, *errors)), Numbers(
        (alpha, top), (*inputs, *taps)
    )


def _taps(
    graph: CompartmentGraph, q: QuantizedPopulation, neuron: SrmAlpha, alpha: GroupNumbers
) -> list[SynapseNumbers]:
    """Return the self-synapses whose response is the refractory kernel, up to the last tap of the chip."""
    name, n = q.population.name, q.population.size
    weight_of_delay = {
        delay: m.diagonal()
        for (source, delay), m in numbers.chip_weights(graph, alpha.chip.name).items()
        if source == name
    }
    k = np.arange(1, max(weight_of_delay, default=-1) + 2, dtype=np.float64)[:, None]
    response = -neuron.scale_ref * neuron.theta * kernel(neuron.tau_ref, k) * q.scale
    exact, fitted = (own_charges(response, group.keep_u) for group in (alpha.exact, alpha.chip))
    taps = []
    for delay in range(len(k)):
        chip = weight_of_delay.get(delay, np.zeros(n))
        tap = TwinSynapses(name, alpha.exact.name, exact[delay], delay)
        taps.append(SynapseNumbers(tap, fitted[delay], chip, exact[delay] + chip - fitted[delay]))
    return taps


def _reset(levels: Levels, q: QuantizedPopulation, neuron: SrmAlpha) -> tuple[Numbers, Numbers]:
    """Lay out one compartment with the chip's reset in place of the refractory kernel."""
    name, graph = q.population.name, levels.compartments
    chip = numbers.chip_group(graph.group(name))
    nothing, once = np.zeros(q.population.size), np.ones(q.population.size, dtype=np.int64)
    dendrite = replace(chip, name=f"{name}/dendrite", joined_to=name)
    soma = replace(chip, keep_u=nothing, keep_v=nothing, refractory=once)
    whole = _srm(levels, q, neuron, dendrite, None, soma)
    alpha, _, top = whole.groups
    exact = _exactly(chip, alpha.exact.keep_u, alpha.exact.keep_v, top.exact.threshold)
    inputs = [
        replace(s, exact=replace(s.exact, target=name))
        for s in whole.synapses
        if s.exact.target == alpha.exact.name
    ]
    return whole, Numbers((GroupNumbers(exact, chip),), tuple(inputs))


def _srm(  # noqa: PLR0913 - what earlier steps made, each used once
    levels: Levels,
    q: QuantizedPopulation,
    neuron: SrmAlpha,
    dendrite: TwinGroup,
    refractory: TwinGroup | None,
    soma: TwinGroup,
    share: float = 1.0,
) -> Numbers:
    """Lay out an SRM neuron as two dendrites and a memoryless soma next to the chip's; a part the chip lacks is exact.

    The dendrites get a ``share`` of the weights.
    """
    graph, name, n = levels.compartments, q.population.name, q.population.size
    threshold = neuron.theta * q.scale * (1 - SLACK)

    def exactly(chip: TwinGroup, keep: float) -> TwinGroup:
        return _exactly(chip, np.full(n, keep), np.full(n, keep), threshold)

    a, gain = alpha_recursion(neuron.tau_sr)
    refractory_a, refractory_gain = alpha_recursion(neuron.tau_ref)
    alpha = GroupNumbers(exactly(dendrite, a), dendrite)
    pulled = f"{name}/refractory" if refractory is None else refractory.name
    pull = TwinSynapses(
        name, pulled, -neuron.scale_ref * neuron.theta * refractory_gain * share * q.scale
    )
    if refractory is None:
        exact = exactly(replace(dendrite, name=pull.target), refractory_a)
        own = GroupNumbers(exact, exact)
        pulls: tuple[SynapseNumbers, ...] = (
            SynapseNumbers(pull, pull.weights, pull.weights, pull.weights),
        )
    else:
        own = GroupNumbers(exactly(refractory, refractory_a), refractory)
        pulls = numbers.beside_chip(graph, [pull], own, refractory.name)
    inputs = numbers.exact_synapses(levels.network, name, dendrite.name, gain * share * q.scale)
    onto = dendrite.name if any(g.name == dendrite.name for g in graph.groups) else name
    return Numbers(
        (alpha, own, GroupNumbers(exactly(soma, 0.0), soma)),
        (*numbers.beside_chip(graph, inputs, alpha, onto), *pulls),
    )


@forms_of.register
def _(neuron: Cuba, levels: Levels, q: QuantizedPopulation) -> tuple[Numbers, Numbers]:
    """Lay out a leaky integrate-and-fire neuron in one compartment."""
    name = q.population.name
    chip = numbers.chip_group(levels.compartments.group(name))
    threshold = neuron.threshold * q.scale * (1 + (SLACK if neuron.rule == ">" else -SLACK))
    keeps = 1.0 - neuron.decay_u, 1.0 - neuron.decay_v
    exact = replace(
        _exactly(chip, *keeps, threshold), bias=neuron.bias * q.scale, floor=_floor(neuron, q)
    )
    group = GroupNumbers(exact, chip)
    synapses = numbers.exact_synapses(levels.network, name, name, q.scale)
    same = Numbers((group,), numbers.beside_chip(levels.compartments, synapses, group, name))
    return same, same


@forms_of.register
def _(neuron: SoftCuba, levels: Levels, q: QuantizedPopulation) -> tuple[Numbers, Numbers]:
    """Lay out a dendrite that is never reset, from which own spikes take the drop, and a memoryless soma."""
    graph, name = levels.compartments, q.population.name
    dendrite, soma = (numbers.chip_group(graph.group(part)) for part in (f"{name}/dendrite", name))
    threshold = neuron.threshold * q.scale * (1 + SLACK)
    keep_u, keep_v = 1.0 - neuron.decay_u, 1.0 - neuron.decay_v
    exact = replace(_exactly(dendrite, keep_u, keep_v, threshold), floor=_floor(neuron, q))
    membrane = GroupNumbers(exact, dendrite)
    top = GroupNumbers(_exactly(soma, soma.keep_u, soma.keep_v, threshold), soma)
    drop = neuron.drop * q.scale
    synapses = numbers.exact_synapses(levels.network, name, dendrite.name, q.scale)
    for delay, taken in ((0, -drop), (1, drop * keep_u)):
        # Recurrent weights with the same delay share its synapse.
        beside = next((s for s in synapses if (s.source, s.delay) == (name, delay)), None)
        weights = taken if beside is None else beside.weights + np.diag(taken)
        synapses = [s for s in synapses if s is not beside] + [
            TwinSynapses(name, dendrite.name, weights, delay)
        ]
    same = Numbers((membrane, top), numbers.beside_chip(graph, synapses, membrane, dendrite.name))
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
