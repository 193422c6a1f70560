"""Take over the integers of a network that was trained on the arithmetic of a Xylo.

Before: ``XyloParts`` on the grid.
After:  ``QuantizedXylo`` with exactly those integers; nothing is rounded.
"""

from collections.abc import Iterable

import numpy as np

from hw_model.errors import TargetError
from hw_model.values import IntArray
from hw_model.xylo.network import XyloNetwork, XyloPopulation
from locsnn_compile.network.network import Population
from locsnn_compile.network.projections import ChipProjection
from locsnn_compile.network.xylo_neurons import XyloNeuron
from locsnn_compile.reference.xylo_neurons import dense
from locsnn_compile.xylo.parts import XyloParts
from locsnn_compile.xylo.quantized import QuantizedXylo, XyloScales
from locsnn_compile.xylo.synapses import (
    GroupedWeights,
    SynapseGroup,
    add_weights,
    group_of,
    no_weights,
)


def trained_integers(parts: XyloParts) -> QuantizedXylo:
    """Return the integers of a network; a ``TargetError`` where a group of synapses has two shifts."""
    weights: GroupedWeights[IntArray] = no_weights(parts, np.int64)
    shifts: dict[SynapseGroup, set[int]] = {group: set() for group in SynapseGroup}
    for projection in parts.network.projections:
        assert isinstance(projection, ChipProjection)
        add_weights(weights, parts, projection, dense(projection.mantissa).T)
        shifts[group_of(parts, projection)].add(projection.exponent)
    hidden = _population(parts.hidden)
    outputs = _population((parts.outputs,))
    network = XyloNetwork(
        hidden=hidden,
        outputs=outputs,
        weights_in=weights.into_hidden[:, :, None],
        weights_hidden=weights.among_hidden[:, :, None],
        weights_out=weights.into_outputs,
        shift_in=_one_shift(SynapseGroup.INTO_HIDDEN, shifts),
        shift_hidden=_one_shift(SynapseGroup.AMONG_HIDDEN, shifts),
        shift_out=_one_shift(SynapseGroup.INTO_OUTPUTS, shifts),
    )
    return QuantizedXylo(parts, network, _as_they_are(hidden.size), _as_they_are(outputs.size))


def _population(populations: Iterable[Population]) -> XyloPopulation:
    neurons = [population.neuron for population in populations]
    assert all(isinstance(neuron, XyloNeuron) for neuron in neurons)

    def joined(name: str) -> IntArray:
        return np.concatenate([getattr(neuron, name) for neuron in neurons])

    return XyloPopulation(
        dash_syn=joined("dash_syn")[:, None],
        dash_mem=joined("dash_mem"),
        threshold=joined("threshold"),
    )


def _one_shift(group: SynapseGroup, shifts: dict[SynapseGroup, set[int]]) -> int:
    of_group = shifts[group]
    if len(of_group) > 1:
        what = f"weights of {group.value} have several shifts, and a Xylo has one for them all"
        measured = f"{sorted(of_group)}"
        raise TargetError("weights", what, measured=measured, fix="Give them one exponent.")
    # A group without synapses has no shift of its own: any will do.
    return max(of_group, default=0)


def _as_they_are(size: int) -> XyloScales:
    """Return scales of 1: the network's own units are those of the registers."""
    return XyloScales(current=np.ones(size), potential=np.ones(size), level=0)
