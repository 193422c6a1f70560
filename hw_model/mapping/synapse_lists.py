"""Divide the synapses of an input axon into lists, and count the memory words that each list takes.

Routing (``routing.py``) counts the words of a core by it, and ``--emit vectors`` packs them for a test bench
(``locsnn_compile/backends/vectors/synapse_image.py``).

All synapses of a list have one format, so an axon has a list for each format of its synapses on the core. A *sparse*
list stores the number of each target, so one list may reach several groups of compartments. A *dense* list stores only
its first target, because each of the others follows the one before. So it ends where the sequence of targets breaks,
and also at the end of each slice, the part of a group that is on the core: a projection ends on one group, and what a
dense list reaches must not depend on which group happens to lie next on the core.
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
    formats: Sequence[SynapseFormat],
    slice_ends: IntArray,
    memory: SynapseMemory,
) -> SynapseLists:
    """Return the lists of a core; axon j has the synapses ``list_start[j]..list_start[j + 1]``.

    ``target`` and ``format_index`` are (synapses,). The synapses of an axon that have one format are expected in
    ascending order of target on each slice, as routing sorts them; in another order, dense lists break more often.
    ``slice_ends`` has an entry per slice of a group on the core: the compartment after its last, ascending.
    """
    is_dense = np.array([form.index_bits == 0 for form in formats], dtype=np.bool_)
    bits = np.array([form.bits_per_synapse for form in formats], dtype=np.int64)

    # Synapses in the order of memory: axon by axon, and the synapses of an axon format by format. lexsort sorts by its
    # last key first, and is stable: synapses of one axon and format keep their order.
    axon_of_synapse = np.repeat(np.arange(len(list_start) - 1), np.diff(list_start))
    order = np.lexsort((format_index, axon_of_synapse))
    axon = axon_of_synapse[order]
    stored_as = format_index[order]
    compartment = target[order]
    # The number of the slice that each synapse ends on. The end of a slice belongs to the next one: side="right".
    slice_number = np.searchsorted(slice_ends, compartment, side="right")

    # Compare each synapse with the one before it: a list begins where axon, format or, in a dense list, the sequence
    # of targets or the slice changes. The first synapse of all begins a list, too, unless the core has no synapse.
    other_axon = np.diff(axon) != 0
    other_format = np.diff(stored_as) != 0
    skips_targets = np.diff(compartment) != 1
    other_slice = np.diff(slice_number) != 0
    ends_dense_list = is_dense[stored_as[1:]] & (skips_targets | other_slice)
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
