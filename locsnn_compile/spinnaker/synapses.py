"""Join the synapses between each source and target to one list, with signed weights.

The passes for ``loihi-sim`` divide a projection by the format of its weights, such as by sign. For SpiNNaker they are
joined again: synapses with equal ends and delay act in the same step, so their weights can be added.
"""

import numpy as np

from hw_model.arithmetic import spinnaker_inverse as inverse
from hw_model.arithmetic.spinnaker_inverse import Sums
from hw_model.mapping.graph import CompartmentGraph, Synapses
from hw_model.values import IntArray, Shown


class SignedSynapses(Shown):
    """Synapses from ``source`` to ``target``, ordered by source, then target, then delay.

    Arrays are (synapses,). Weights are signed, in units of an integer weight of 1. Delays are in steps, 1 or more. No
    two synapses have the same ends and delay, and no weight is 0.
    """

    source: str
    target: str
    source_index: IntArray
    target_index: IntArray
    delay: IntArray
    weight: IntArray


def joined_synapses(graph: CompartmentGraph) -> tuple[SignedSynapses, ...]:
    """Return the synapses of a graph, one list for each pair of source and target."""
    by_ends: dict[tuple[str, str], list[Synapses]] = {}
    for synapses in graph.synapses:
        by_ends.setdefault((synapses.source, synapses.target), []).append(synapses)
    return tuple(_joined(source, target, parts) for (source, target), parts in by_ends.items())


def _joined(source: str, target: str, parts: list[Synapses]) -> SignedSynapses:
    """Return synapses of the same source and target as one list, ordered by ends and delay.

    Synapses act together if they have the same ends and delay: their weights are added up, and those
    that add up to 0 are left out.
    """
    ends_and_delay = np.concatenate([_ends_and_delay(part) for part in parts], axis=1)
    weights = np.concatenate([_weights(part) for part in parts])
    # `unique` sorts the columns, which gives the order of SignedSynapses.
    distinct, place = np.unique(ends_and_delay, axis=1, return_inverse=True)
    weight_sums = np.zeros(distinct.shape[1], dtype=np.int64)
    np.add.at(weight_sums, place.ravel(), weights)
    acts = weight_sums != 0
    source_index, target_index, delay = distinct[:, acts]
    return SignedSynapses(source, target, source_index, target_index, delay, weight_sums[acts])


def _ends_and_delay(synapses: Synapses) -> IntArray:
    """Return the source, target and delay of each synapse, (3, synapses); delays as SpiNNaker counts them."""
    delay = inverse.delays_of(synapses.delay)
    columns: IntArray = np.stack([synapses.source_index, synapses.target_index, delay])
    return columns.astype(np.int64)


def _weights(synapses: Synapses) -> IntArray:
    """Return the weight of each synapse in units of an integer weight of 1, (synapses,)."""
    return inverse.weights_in_units(np.asarray(synapses.mantissa), synapses.exponent)


def arriving(synapses: tuple[SignedSynapses, ...], target: str, size: int) -> IntArray:
    """Return the largest sums of weights that can arrive at each neuron in a step, (2, n), 0 or more.

    Row 0 is the sum of positive weights, row 1 of negative weights without sign. All sources spike at once, so no step
    can bring more.
    """
    excitatory = np.zeros(size, dtype=np.int64)
    inhibitory = np.zeros(size, dtype=np.int64)
    for part in synapses:
        if part.target == target:
            np.add.at(excitatory, part.target_index, np.maximum(part.weight, 0))
            np.add.at(inhibitory, part.target_index, np.maximum(-part.weight, 0))
    return np.stack([excitatory, inhibitory])


def largest_sums(arriving_sums: IntArray) -> Sums:
    """Return the largest sums of any neuron, given those of :func:`arriving`."""
    excitatory, inhibitory = arriving_sums.max(axis=1).tolist()
    return Sums(excitatory, inhibitory)
