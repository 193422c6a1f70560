"""All synapses from a source to a population as one list, however many formats they came in."""

import numpy as np

from hw_model.arithmetic import spinnaker_inverse as inverse
from hw_model.arithmetic.spinnaker_inverse import Sums
from hw_model.mapping.graph import CompartmentGraph, Synapses
from hw_model.values import IntArray, Shown


class SignedSynapses(Shown):
    """Synapses from ``source`` to ``target`` in weights of 1, ordered by source, then target, then delay.

    Arrays are (synapses,). No two have the same ends and delay, and no weight is 0.
    """

    source: str
    target: str
    source_index: IntArray
    target_index: IntArray
    delay: IntArray
    weight: IntArray


def joined_synapses(graph: CompartmentGraph) -> tuple[SignedSynapses, ...]:
    """Return the synapses of a graph, those that act together added up."""
    by_ends: dict[tuple[str, str], list[Synapses]] = {}
    for synapses in graph.synapses:
        by_ends.setdefault((synapses.source, synapses.target), []).append(synapses)
    return tuple(_joined(*ends, parts) for ends, parts in by_ends.items())


def _joined(source: str, target: str, parts: list[Synapses]) -> SignedSynapses:
    rows = np.concatenate([_rows(part) for part in parts], axis=1)
    weights = np.concatenate(
        [inverse.weights_in_units(np.asarray(part.mantissa), part.exponent) for part in parts]
    )
    different, place = np.unique(rows, axis=1, return_inverse=True)
    summed = np.zeros(different.shape[1], dtype=np.int64)
    np.add.at(summed, place.ravel(), weights)
    acts = summed != 0
    source_index, target_index, delay = different[:, acts]
    return SignedSynapses(source, target, source_index, target_index, delay, summed[acts])


def _rows(synapses: Synapses) -> IntArray:
    """Return source, target and delay of each synapse, (3, synapses)."""
    delay = inverse.delays_of(synapses.delay)
    rows: IntArray = np.stack([synapses.source_index, synapses.target_index, delay])
    return rows.astype(np.int64)


def arriving(synapses: tuple[SignedSynapses, ...], target: str, size: int) -> IntArray:
    """Return the most that weights of each sign bring to each neuron in a step, (2, n), 0 or more."""
    sums = np.zeros((2, size), dtype=np.int64)
    for part in synapses:
        if part.target == target:
            np.add.at(sums[0], part.target_index, np.maximum(part.weight, 0))
            np.add.at(sums[1], part.target_index, np.maximum(-part.weight, 0))
    return sums


def largest_sums(arriving_sums: IntArray) -> Sums:
    """Return the largest of (2, n)."""
    excitatory, inhibitory = arriving_sums.max(axis=1).tolist()
    return Sums(excitatory, inhibitory)
