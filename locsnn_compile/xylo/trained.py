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
from locsnn_compile.xylo.quantized import QuantizedXylo, XyloScales, places


def trained_integers(parts: XyloParts) -> QuantizedXylo:
    """Return the integers of a network; a ``TargetError`` where a group of synapses has two shifts."""
    place = places(parts.hidden)
    hidden_size = sum(population.size for population in parts.hidden)
    weights_in = np.zeros((parts.view.lines, hidden_size), dtype=np.int64)
    weights_hidden = np.zeros((hidden_size, hidden_size), dtype=np.int64)
    weights_out = np.zeros((hidden_size, parts.outputs.size), dtype=np.int64)
    shifts: dict[str, set[int]] = {"inputs": set(), "hidden neurons": set(), "outputs": set()}
    for projection in parts.network.projections:
        assert isinstance(projection, ChipProjection)
        mantissa = dense(projection.mantissa).T
        if projection.target == parts.outputs.name:
            weights_out[place[projection.source]] += mantissa
            shifts["outputs"].add(projection.exponent)
        elif projection.source == parts.view.name:
            weights_in[:, place[projection.target]] += mantissa
            shifts["inputs"].add(projection.exponent)
        else:
            weights_hidden[place[projection.source], place[projection.target]] += mantissa
            shifts["hidden neurons"].add(projection.exponent)
    network = XyloNetwork(
        hidden=_population(parts.hidden),
        outputs=_population((parts.outputs,)),
        weights_in=weights_in[:, :, None],
        weights_hidden=weights_hidden[:, :, None],
        weights_out=weights_out,
        shift_in=_one_shift("inputs", shifts["inputs"]),
        shift_hidden=_one_shift("hidden neurons", shifts["hidden neurons"]),
        shift_out=_one_shift("outputs", shifts["outputs"]),
    )
    return QuantizedXylo(
        parts, network, _as_they_are(hidden_size), _as_they_are(parts.outputs.size)
    )


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


def _one_shift(group: str, shifts: set[int]) -> int:
    if len(shifts) > 1:
        what = f"weights of {group} have several shifts, and a Xylo has one for them all"
        measured = f"{sorted(shifts)}"
        raise TargetError("weights", what, measured=measured, fix="Give them one exponent.")
    return max(shifts, default=0)


def _as_they_are(size: int) -> XyloScales:
    """Return scales of 1: the network's own units are those of the registers."""
    return XyloScales(current=np.ones(size), potential=np.ones(size), level=0)
