"""Divide the synapses of an input axon into lists, and count the memory words that each list takes.

Routing, the report and the memory image of the open core use it. All synapses of a list have one format, so an axon has
a list for each format of its synapses on the core, whichever populations they end on. A dense list stores no target
numbers: it ends where a target does not follow the one before, and at the end of each population.
"""

from collections.abc import Sequence

import numpy as np

from hw_model.description.chip import SynapseMemory
from hw_model.mapping.fan_in import SynapseFormat
from hw_model.values import BoolArray, Frozen, IntArray


class SynapseLists(Frozen, eq=False):
    """The synapse lists of a core. List i is rows ``order[start[i] : start[i] + length[i]]`` of the core's synapses.

    It belongs to input axon ``axon[i]``, takes ``width[i]`` bits per synapse and ``words[i]`` words of memory, and is
    dense if ``dense[i]``. Arrays are (lists,), except ``order`` (synapses,).
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

    ``ends`` has an entry per slice of a group on the core: the compartment after its last, ascending.
    """
    is_dense = np.array([form.index_bits == 0 for form in formats], dtype=np.bool_)
    bits = np.array([form.bits_per_synapse for form in formats], dtype=np.int64)

    # Synapses in the order of memory: axon by axon, and of an axon format by format.
    axon_by_target = np.repeat(np.arange(len(list_start) - 1), np.diff(list_start))
    order = np.lexsort((format_index, axon_by_target))
    axon = axon_by_target[order]
    stored_as = format_index[order]
    compartment = target[order]
    population = np.searchsorted(ends, compartment, side="right")

    # Compare each synapse with the one before it: a list begins where axon, format or, in a dense list, the sequence
    # of targets changes. The first synapse of all begins a list, too, unless there is none.
    other_axon = np.diff(axon) != 0
    other_format = np.diff(stored_as) != 0
    skips_targets = np.diff(compartment) != 1
    other_population = np.diff(population) != 0
    ends_dense_list = is_dense[stored_as[1:]] & (skips_targets | other_population)
    begins = other_axon | other_format | ends_dense_list
    start = np.flatnonzero(np.append(True, begins)[: len(compartment)])
    length = np.diff(np.append(start, len(compartment)))
    width = bits[stored_as[start]]
    return SynapseLists(
        order=order,
        start=start,
        length=length,
        axon=axon[start],
        width=width,
        words=memory.words(length, width),
        dense=is_dense[stored_as[start]],
    )
