"""The compartments of a lowered network twice over, in exact numbers and in the chip's, side by side.

Exact numbers are in units of the registers too, but real: a float weight times the scale and the gain of its kernel,
what a decay keeps as ``exp(-1 / tau)``, a threshold of theta times the scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import sparse

from hw_model.fixed_point import DECAY_ONE, effective_weight
from hw_model.graph import Axis, CompartmentGraph, Compartments
from locsnn_compile.error_budget.twin import TwinGroup, TwinSynapses
from locsnn_compile.matrices import Matrix, of_target, values_of, with_values
from locsnn_compile.network import Network, Projection
from locsnn_compile.neurons import Cuba, FloatArray, SrmAlpha
from locsnn_compile.passes.kernels import best_gain
from locsnn_compile.pipeline import Levels
from locsnn_compile.quantized import QuantizedPopulation

DENSE_ENTRIES = 1 << 22
"""A matrix of no more entries is kept dense."""
SLACK = 1e-14
"""Relative: an exact threshold is taken this much on the safe side, so that a tie stays one after scaling."""


@dataclass(frozen=True, eq=False)
class GroupNumbers:
    """A group of compartments, of which only the numbers differ."""

    exact: TwinGroup
    chip: TwinGroup

    @property
    def gain_ratio(self) -> FloatArray:
        """The gain that makes up for the rounding of both decays, (n,).

        Chip weights carry it: those of one side fit the decays of the other after multiplying or dividing by it.
        """
        exact, chip = self.exact, self.chip
        return best_gain(exact.keep_u, exact.keep_v, chip.keep_u, chip.keep_v)

    @property
    def bias_ratio(self) -> FloatArray:
        """Likewise of biases, (n,): what a bias settles at is kept."""
        lost = 1.0 - self.exact.keep_v
        return np.divide(1.0 - self.chip.keep_v, lost, out=np.ones(len(lost)), where=lost > 0)


@dataclass(frozen=True, eq=False)
class SynapseNumbers:
    """Synapses of one delay between two groups, of which only the weights differ; the gain ratio is the target's."""

    exact: TwinSynapses
    chip: TwinSynapses
    gain_ratio: FloatArray


@dataclass(frozen=True, eq=False)
class Numbers:
    """All groups, children before their parents, and all synapses of one axis."""

    groups: tuple[GroupNumbers, ...]
    synapses: tuple[SynapseNumbers, ...]


def numbers_of(levels: Levels, axis: Axis) -> Numbers:
    """Return the numbers of every population of an axis."""
    groups: list[GroupNumbers] = []
    synapses: list[SynapseNumbers] = []
    for q in levels.quantized.populations:
        if q.population.axis == axis:
            made = _numbers(levels, q)
            groups += made.groups
            synapses += made.synapses
    return Numbers(tuple(groups), tuple(synapses))


def _numbers(levels: Levels, q: QuantizedPopulation) -> Numbers:
    neuron = q.population.neuron
    if isinstance(neuron, SrmAlpha):
        return _dendrite(levels, q, neuron)
    if isinstance(neuron, Cuba):
        return _native(levels, q, neuron)
    return _on_grid(levels, q)


def _dendrite(levels: Levels, q: QuantizedPopulation, neuron: SrmAlpha) -> Numbers:
    """An SRM neuron as alpha dendrite, refractory dendrite and memoryless soma."""
    graph, name, n = levels.compartments, q.population.name, q.population.size
    threshold = neuron.theta * q.scale * (1 - SLACK)

    def group(part: str, keep: float) -> GroupNumbers:
        chip = chip_group(graph.group(part))
        every = np.full(n, keep)
        return GroupNumbers(replace(_real(chip), keep_u=every, keep_v=every, threshold=threshold), chip)

    a, gain = kernel_recursion(neuron.tau_sr)
    refractory_a, refractory_gain = kernel_recursion(neuron.tau_ref)
    dendrite, refractory = group(f"{name}/dendrite", a), group(f"{name}/refractory", refractory_a)
    onto_dendrite = exact_synapses(levels.network, name, dendrite.exact.name, gain * q.scale)
    own = TwinSynapses(name, refractory.exact.name, -neuron.scale_ref * neuron.theta * refractory_gain * q.scale)
    return Numbers(
        (dendrite, refractory, group(name, 0.0)),
        (*_pairs(graph, onto_dendrite, dendrite), *_pairs(graph, [own], refractory)),
    )


def _native(levels: Levels, q: QuantizedPopulation, neuron: Cuba) -> Numbers:
    """A leaky integrate-and-fire neuron in one compartment."""
    name = q.population.name
    chip = chip_group(levels.compartments.group(name))
    exact = replace(
        _real(chip),
        keep_u=1.0 - neuron.decay_u,
        keep_v=1.0 - neuron.decay_v,
        threshold=neuron.threshold * q.scale * (1 + (SLACK if neuron.rule == ">" else -SLACK)),
        bias=neuron.bias * q.scale,
    )
    group = GroupNumbers(exact, chip)
    synapses = exact_synapses(levels.network, name, name, q.scale)
    return Numbers((group,), _pairs(levels.compartments, synapses, group))


def _on_grid(levels: Levels, q: QuantizedPopulation) -> Numbers:
    """A population whose reference is the chip's own arithmetic: both sides are the same."""
    graph, name = levels.compartments, q.population.name
    parts = [g for g in graph.groups if g.joined_to == name] + [graph.group(name)]
    groups, synapses = [], []
    for part in parts:
        same = chip_group(part)
        groups.append(GroupNumbers(same, same))
        for (source, delay), weights in chip_weights(graph, part.name).items():
            s = TwinSynapses(source, part.name, _plain(weights), delay)
            synapses.append(SynapseNumbers(s, s, np.ones(part.size)))
    return Numbers(tuple(groups), tuple(synapses))


def kernel_recursion(tau: float) -> tuple[float, float]:
    """Return ``a`` and ``c`` of the kernel ``(k / tau) exp(1 - k / tau) = c * k * a^(k-1)``."""
    a = math.exp(-1.0 / tau)
    return a, math.e * a / tau


def _real(group: TwinGroup) -> TwinGroup:
    """Return a group whose registers hold any real number."""
    return replace(group, truncates=False, limited=False)


def exact_synapses(network: Network, population: str, target: str, gain: FloatArray) -> list[TwinSynapses]:
    """Return the float weights onto a population, times a gain (n,), as synapses onto a group: one entry a delay."""
    found: dict[tuple[str, int], Matrix] = {}
    for projection in network.into(population):
        assert isinstance(projection, Projection)  # the network's own check: float weights reach float neurons
        for delay, weights in _by_delay(projection):
            scaled = with_values(weights, values_of(weights) * of_target(weights, gain))
            key = (projection.source, delay)
            found[key] = found[key] + scaled if key in found else scaled
    return [TwinSynapses(source, target, weights, delay) for (source, delay), weights in found.items()]


def _by_delay(projection: Projection) -> list[tuple[int, Matrix]]:
    weights, delay = projection.weights, np.asarray(projection.delay)
    if delay.ndim == 0:
        return [(int(delay), weights)]
    values = values_of(weights)
    return [(int(d), with_values(weights, np.where(delay == d, values, 0.0))) for d in np.unique(delay)]


def _pairs(graph: CompartmentGraph, exact: list[TwinSynapses], onto: GroupNumbers) -> tuple[SynapseNumbers, ...]:
    """Set the chip's weights onto a group beside exact ones; those that rounded to 0 are 0."""
    pairs, ratio = [], onto.gain_ratio
    held_by_chip = chip_weights(graph, onto.chip.name)
    for s in exact:
        weights = held_by_chip.get((s.source, s.delay))
        if weights is None:
            held = s.weights * 0
        elif sparse.issparse(s.weights):
            held = weights
        else:
            held = weights.diagonal() if s.weights.ndim == 1 else weights.toarray()
        pairs.append(SynapseNumbers(s, replace(s, weights=held), ratio))
    return tuple(pairs)


def chip_weights(graph: CompartmentGraph, target: str) -> dict[tuple[str, int], Matrix]:
    """Return effective weights onto a group, CSR (n_target, n_source) by source and delay; all formats added up."""
    size = {node.name: node.size for node in graph.nodes}
    found: dict[tuple[str, int], Matrix] = {}
    for s in graph.synapses:
        if s.target == target:
            weights = effective_weight(s.mantissa, s.exponent).astype(np.float64)
            for delay in np.unique(s.delay):
                here = s.delay == delay
                ends = (s.target_index[here], s.source_index[here])
                part = sparse.csr_array((weights[here], ends), shape=(size[target], size[s.source]))
                key = (s.source, int(delay))
                found[key] = found[key] + part if key in found else part
    return found


def _plain(weights: Matrix) -> Matrix:
    """Return a sparse matrix dense, unless it is large."""
    return weights.toarray() if weights.shape[0] * weights.shape[1] <= DENSE_ENTRIES else weights


def chip_group(group: Compartments) -> TwinGroup:
    """Return a group in the chip's numbers and arithmetic."""
    return TwinGroup(
        name=group.name,
        size=group.size,
        keep_u=_kept(group.decay_u),
        keep_v=_kept(group.decay_v),
        # For any real v this is v > 64 * threshold.
        threshold=np.nextafter(64.0 * group.threshold, np.inf),
        bias=(group.bias_mantissa << group.bias_exponent).astype(np.float64),
        refractory=group.refractory,
        vmin=group.vmin.astype(np.float64),
        vmax=group.vmax.astype(np.float64),
        truncates=True,
        limited=True,
        joined_to=group.joined_to,
    )


def _kept(decay: npt.NDArray[np.int64]) -> FloatArray:
    return (DECAY_ONE - decay) / DECAY_ONE
