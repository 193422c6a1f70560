"""Synapse lists: how an axon's synapses on a core become runs of memory words. Placement, report and image count by it.

A run is of one format. So an axon has a list for each format of its synapses on the core, whatever populations they end
on. A dense list has no index: it ends where its targets do not simply go on, and with each population.
"""

from collections.abc import Sequence

import numpy as np

from hw_model.description.chip import SynapseMemory
from hw_model.mapping.fan_in import SynapseFormat
from hw_model.values import BoolArray, Frozen, IntArray


class SynapseLists(Frozen, eq=False):
    """Rows ``order[start[i] : start[i] + length[i]]`` of a core's synapses are list i, of axon ``axon[i]``.

    ``width`` of a synapse in bits, ``words`` of memory, and whether the list is ``dense``; all (lists,) but ``order``.
    """

    order: IntArray
    start: IntArray
    length: IntArray
    axon: IntArray
    width: IntArray
    words: IntArray
    dense: BoolArray


def synapse_lists(
    list_start: IntArray,
    target: IntArray,
    format_index: IntArray,
    formats: "Sequence[SynapseFormat]",
    ends: IntArray,
    memory: "SynapseMemory",
) -> SynapseLists:
    """Return the lists of a core; axon j has the synapses ``list_start[j]..list_start[j + 1]``.

    ``ends``: the compartment after the last of each population on the core, ascending.
    """
    of_axon = np.repeat(np.arange(len(list_start) - 1), np.diff(list_start))
    order = np.lexsort((format_index, of_axon))
    of_axon, target, form = of_axon[order], target[order], format_index[order]
    dense = np.array([f.index_bits == 0 for f in formats], dtype=np.bool_)[form]
    population = np.searchsorted(ends, target, side="right")
    begins = (np.diff(of_axon) != 0) | (np.diff(form) != 0)
    begins |= dense[1:] & ((np.diff(target) != 1) | (np.diff(population) != 0))
    start = np.flatnonzero(np.append(True, begins)[: len(target)])
    length = np.diff(np.append(start, len(target)))
    width = np.array([f.bits_per_synapse for f in formats], dtype=np.int64)[form[start]]
    return SynapseLists(
        order, start, length, of_axon[start], width, memory.words(length, width), dense[start]
    )
