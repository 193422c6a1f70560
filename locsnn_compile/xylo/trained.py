"""Take over the integers of a network that was trained in the arithmetic of a Xylo.

Before: ``XyloParts`` whose network has the chip's integers already.
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
    """Return the integers of a network; raise ``TargetError`` if a group of synapses has more than one shift."""
    weights: GroupedWeights[IntArray] = no_weights(parts, np.int64)
    shifts: dict[SynapseGroup, set[int]] = {group: set() for group in SynapseGroup}
    for projection in parts.network.projections:
        assert isinstance(projection, ChipProjection)
        add_weights(weights, parts, projection, dense(projection.mantissa).T)
        shifts[group_of(parts, projection)].add(projection.exponent)
    hidden = _population(parts.hidden)
    outputs = _population((parts.outputs,))
    # The last axis: a hidden neuron of a Xylo can have several currents; ours have one.
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
    return QuantizedXylo(parts, network, _unit_scales(hidden.size), _unit_scales(outputs.size))


def _population(populations: Iterable[Population]) -> XyloPopulation:
    """Return the parameters of all neurons of some populations, one population after the other."""
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
    """Return the shift of a group's weights; raise ``TargetError`` if its projections have several."""
    shifts_of_group = shifts[group]
    if len(shifts_of_group) > 1:
        what = f"weights of {group.value} have several shifts, and a Xylo has one for them all"
        measured = f"{sorted(shifts_of_group)}"
        raise TargetError("weights", what, measured=measured, fix="Give them one exponent.")
    # For a group without synapses, any shift will do.
    return max(shifts_of_group, default=0)


def _unit_scales(size: int) -> XyloScales:
    """Return scales of 1: the network's units are those of the chip's registers."""
    return XyloScales(current=np.ones(size), potential=np.ones(size), level=0)
