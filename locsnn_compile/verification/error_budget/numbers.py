"""Groups of compartments and their synapses in exact numbers and in the chip's, side by side.

Exact numbers are real numbers, but in the units of the registers: a weight is the float weight times the scale and the
gain of its kernel, a decay keeps ``exp(-1 / tau)``, and the threshold is theta times the scale.
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
        """The factor of weights, (n,), that compensates best for the rounding of both decays."""
        exact, chip = self.exact, self.chip
        return best_gain(exact.keep_u, exact.keep_v, chip.keep_u, chip.keep_v)

    @property
    def bias_ratio(self) -> FloatArray:
        """The factor of biases, (n,), with which the voltage settles at the same value with rounded decays."""
        lost = 1.0 - self.exact.keep_v
        return np.divide(1.0 - self.chip.keep_v, lost, out=np.ones(len(lost)), where=lost > 0)


class SynapseNumbers(Frozen, eq=False):
    """Synapses with one delay between two groups, with four versions of their weights.

    | weights | for exact decays | for the chip's decays |
    | --- | --- | --- |
    | exact | ``exact.weights`` | ``exact_fitted`` |
    | rounded | ``chip_fitted`` | ``chip``, those on the chip |

    Weights for the chip's decays compensate for the rounding of these decays, see :attr:`GroupNumbers.gain_ratio`.
    """

    exact: TwinSynapses
    exact_fitted: Matrix
    chip: Matrix
    chip_fitted: Matrix

    def weights(self, *, rounded: bool, chip_decays: bool) -> Matrix:
        """Return one of the four versions."""
        if rounded and chip_decays:
            return self.chip
        if rounded:
            return self.chip_fitted
        if chip_decays:
            return self.exact_fitted
        return self.exact.weights


class Numbers(Sums, eq=False):
    """The groups of some populations, dendrites before somas, and the synapses onto them; numbers can be added."""

    groups: tuple[GroupNumbers, ...] = ()
    synapses: tuple[SynapseNumbers, ...] = ()


def beside_chip(
    graph: CompartmentGraph, exact: list[TwinSynapses], target: GroupNumbers, held_by: str
) -> tuple[SynapseNumbers, ...]:
    """Pair exact weights onto ``target`` with those onto the chip's group ``held_by``, as arrays of the same form."""
    ratio = target.gain_ratio
    on_chip = chip_weights(graph, held_by)
    pairs = []
    for s in exact:
        weights = on_chip.get((s.source, s.delay))
        if weights is None:
            chip = s.weights * 0  # all rounded to 0, so the chip has no synapses
        elif sparse.issparse(s.weights):
            chip = weights
        elif s.weights.ndim == 1:
            chip = weights.diagonal()
        else:
            chip = weights.toarray()
        pairs.append(
            SynapseNumbers(
                exact=s,
                exact_fitted=times(s.weights, ratio),
                chip=chip,
                chip_fitted=times(chip, 1.0 / ratio),
            )
        )
    return tuple(pairs)


def exact_synapses(
    network: Network, population: str, target: str, gain: FloatArray
) -> list[TwinSynapses]:
    """Return the float weights onto a population, times a gain (n,), as synapses onto a group.

    There is one entry per source and delay.
    """
    weights_from: dict[tuple[str, int], Matrix] = {}
    for projection in network.into(population):
        # check_network: only float weights reach float neurons.
        assert isinstance(projection, Projection)
        for delay, weights in by_delay(projection.weights, projection.delay):
            weights_from = added(weights_from, {(projection.source, delay): times(weights, gain)})
    return [
        TwinSynapses(source, target, weights, delay)
        for (source, delay), weights in weights_from.items()
    ]


def chip_weights(graph: CompartmentGraph, target: str) -> dict[tuple[str, int], Matrix]:
    """Return effective weights onto a group, CSR (n_target, n_source), by source and delay.

    Several lists of synapses, in formats of their own, can join the same ends with the same delay; they are added.
    """
    size = {node.name: node.size for node in graph.nodes}
    weights_from: dict[tuple[str, int], Matrix] = {}
    for s in graph.synapses:
        if s.target != target:
            continue
        weights = loihi.charge_of(s.mantissa, s.exponent).astype(np.float64)
        for delay in np.unique(s.delay):
            has_delay = s.delay == delay
            ends = (s.target_index[has_delay], s.source_index[has_delay])
            shape = (size[target], size[s.source])
            of_delay = sparse.csr_array((weights[has_delay], ends), shape=shape)
            weights_from = added(weights_from, {(s.source, int(delay)): of_delay})
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
        # A twin spikes where v >= threshold, the chip where v > threshold: take the next float above.
        threshold=np.nextafter(loihi.threshold_of(group.threshold.astype(np.float64)), np.inf),
        bias=loihi.bias_of(group.bias_mantissa, group.bias_exponent).astype(np.float64),
        vmin=group.vmin.astype(np.float64),
        vmax=group.vmax.astype(np.float64),
        truncates=True,
        limited=True,
    )
