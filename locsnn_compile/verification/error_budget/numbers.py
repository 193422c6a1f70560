"""Groups and synapses in exact numbers and in the chip's, side by side.

Exact numbers are also in units of the registers, but real: a float weight times the scale and the gain of its kernel,
``exp(-1 / tau)`` as what a decay keeps, theta times the scale as the threshold.
"""

import numpy as np
from scipy import sparse

from hw_model.arithmetic import loihi, loihi_inverse
from hw_model.mapping.graph import CompartmentGraph, Compartments
from hw_model.values import FloatArray, Frozen, Sums, added, picked
from locsnn_compile.network.network import Network
from locsnn_compile.network.projections import (
    Matrix,
    Projection,
    by_delay,
    of_target,
    values_of,
    with_values,
)
from locsnn_compile.passes.kernels import best_gain
from locsnn_compile.verification.error_budget.twin import TwinGroup, TwinSynapses


class GroupNumbers(Frozen, eq=False):
    """A group of compartments in exact and in chip numbers."""

    exact: TwinGroup
    chip: TwinGroup

    @property
    def gain_ratio(self) -> FloatArray:
        """The gain that compensates for the rounding of both decays, (n,); weights for the chip's decays include it."""
        exact, chip = self.exact, self.chip
        return best_gain(exact.keep_u, exact.keep_v, chip.keep_u, chip.keep_v)

    @property
    def bias_ratio(self) -> FloatArray:
        """The same for biases, (n,): it keeps the level at which a bias settles."""
        lost = 1.0 - self.exact.keep_v
        return np.divide(1.0 - self.chip.keep_v, lost, out=np.ones(len(lost)), where=lost > 0)


class SynapseNumbers(Frozen, eq=False):
    """Synapses with one delay between two groups, exact or rounded, each for exact decays and for the chip's.

    ``exact.weights`` are for exact decays, and ``exact_fitted`` compensate for rounded ones. ``chip`` are the weights
    on the chip, and ``chip_fitted`` have the same rounding errors for exact decays.
    """

    exact: TwinSynapses
    exact_fitted: Matrix
    chip: Matrix
    chip_fitted: Matrix

    def weights(self, *, rounded: bool, chip_decays: bool) -> Matrix:
        """Return one of the four matrices."""
        if rounded:
            return self.chip if chip_decays else self.chip_fitted
        return self.exact_fitted if chip_decays else self.exact.weights


class Numbers(Sums, eq=False):
    """Groups, children before their parents, and synapses."""

    groups: tuple[GroupNumbers, ...] = ()
    synapses: tuple[SynapseNumbers, ...] = ()


def beside_chip(
    graph: CompartmentGraph, exact: list[TwinSynapses], target: GroupNumbers, held_by: str
) -> tuple[SynapseNumbers, ...]:
    """Pair exact weights onto ``target`` with the chip's onto ``held_by``; weights that rounded to 0 are 0."""
    pairs, ratio = [], target.gain_ratio
    held_by_chip = chip_weights(graph, held_by)
    for s in exact:
        weights = held_by_chip.get((s.source, s.delay))
        if weights is None:
            chip = s.weights * 0
        elif sparse.issparse(s.weights):
            chip = weights
        else:
            chip = weights.diagonal() if s.weights.ndim == 1 else weights.toarray()
        pairs.append(SynapseNumbers(s, times(s.weights, ratio), chip, times(chip, 1.0 / ratio)))
    return tuple(pairs)


def exact_synapses(
    network: Network, population: str, target: str, gain: FloatArray
) -> list[TwinSynapses]:
    """Return the float weights onto a population, times a gain (n,), as synapses onto a group: one entry per delay."""
    weights_from: dict[tuple[str, int], Matrix] = {}
    for projection in network.into(population):
        assert isinstance(
            projection, Projection
        )  # check_network: only float weights reach float neurons
        for delay, weights in by_delay(projection.weights, projection.delay):
            weights_from = added(weights_from, {(projection.source, delay): times(weights, gain)})
    return [
        TwinSynapses(source, target, weights, delay)
        for (source, delay), weights in weights_from.items()
    ]


def chip_weights(graph: CompartmentGraph, target: str) -> dict[tuple[str, int], Matrix]:
    """Return effective weights onto a group, CSR (n_target, n_source) by source and delay, summed over formats."""
    size = {node.name: node.size for node in graph.nodes}
    weights_from: dict[tuple[str, int], Matrix] = {}
    for s in graph.synapses:
        if s.target == target:
            weights = loihi.charge_of(s.mantissa, s.exponent).astype(np.float64)
            for delay in np.unique(s.delay):
                has_delay = s.delay == delay
                ends = (s.target_index[has_delay], s.source_index[has_delay])
                part = sparse.csr_array(
                    (weights[has_delay], ends), shape=(size[target], size[s.source])
                )
                weights_from = added(weights_from, {(s.source, int(delay)): part})
    return weights_from


def times(weights: Matrix, factor: FloatArray) -> Matrix:
    """Return weights (n_target, n_source), or (n,), times a factor per target, (n_target,)."""
    if weights.ndim == 1:
        return weights * factor
    return with_values(weights, values_of(weights) * of_target(weights, factor))


def chip_group(group: Compartments) -> TwinGroup:
    """Return a group in the chip's numbers and arithmetic."""
    return TwinGroup(
        **picked(group, "name", "size", "refractory", "joined_to"),
        keep_u=loihi_inverse.share_kept(group.decay_u),
        keep_v=loihi_inverse.share_kept(group.decay_v),
        # v >= this is v > the threshold for any real v.
        threshold=np.nextafter(loihi.threshold_of(group.threshold.astype(np.float64)), np.inf),
        bias=loihi.bias_of(group.bias_mantissa, group.bias_exponent).astype(np.float64),
        vmin=group.vmin.astype(np.float64),
        vmax=group.vmax.astype(np.float64),
        truncates=True,
        limited=True,
    )
