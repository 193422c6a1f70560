"""The compiled loops that deliver spikes: they add weights to the charges of later steps.

A *row* is a step of the current tile. A *link* is all synapses from one node (an input or a group)
to one group, as a matrix or as lists (:class:`hw_model.engine.layout.Links`); ``deliver`` follows one
link for the spikes of its source in some rows. A spike of row r is due in row r + 1 + delay. Delivery
also marks the chunks of compartments that get charge as *touched*: all others may be skipped.

There are four ways to do it: by lists; by matrix rows, spike by spike; eight matrix rows at once for
long rows; and, for short rows, all spikes of a tile in one loop.
``docs/research/special-paths.md`` measures what they are worth. Ranges ``a..b`` leave out their end.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hw_model.engine import packed
from hw_model.engine.chunks import add_weights, fill
from hw_model.engine.compiled import absorbed, address, call_at, inner, shared
from hw_model.engine.layout import LANES, LIST, MATRIX, FastLayout
from hw_model.engine.state import MOST_LISTED, NO_PATHS, TILE, Paths, first_state
from hw_model.values import AnyArray

LONG = 128
"""Slots of a matrix row from which on eight rows are added at once; for shorter rows, the setup takes longer than it
saves. That it helps was measured (``docs/research/special-paths.md``); 128 was chosen by hand."""

# Constants that take part in indices are unsigned: numba tests signed indices for being negative, which means "from the
# end" in Python.
_LANES = np.uint64(LANES)
_NEXT = np.uint64(1)
_NO_STEP = np.int64(0)
"""Stands for a row or a link where only the type of an argument matters."""
_PARTS = np.uint64(4)
"""A list of spikes is divided into this many parts, and one spike of each part is delivered in turn. Neighbours in the
list are due in the same row: an addition would wait for the one before it to be stored. Chosen by hand."""


class Listed(NamedTuple):
    """The spikes of one node.

    Those of row r are ``event[base + e]`` with ``begin[r, node] <= e < begin[r + 1, node]``.
    """

    event: AnyArray
    base: int | np.int64
    begin: AnyArray
    node: int


@absorbed
def deliver(link, rows_from, rows_to, listed, tables, memory):  # type: ignore[no-untyped-def]
    """Deliver the spikes ``listed`` of rows ``rows_from..rows_to`` over a link."""
    # Loops that not every phase needs are called by address: they are compiled only if a phase has such links.
    links = tables.links
    if links.kind[link] != MATRIX:
        by_lists = memory.paths.by_lists
        call_at(by_lists, (link, rows_from, rows_to, listed, tables, memory.state))
        return
    first = listed.begin[rows_from, listed.node]
    last = listed.begin[rows_to, listed.node]
    if links.width[link] < LONG and last - first <= MOST_LISTED:
        _deliver_by_short_rows(link, rows_from, rows_to, listed, tables, memory)
    else:
        by_rows = memory.paths.by_rows
        call_at(by_rows, (link, rows_from, rows_to, listed, tables, memory.state))


@lru_cache(maxsize=8)
def paths_of(layout: FastLayout) -> Paths:
    """Compile what a phase needs of :func:`by_lists` and :func:`by_rows`, and return their addresses.

    Every loop that :func:`deliver` may call must be there: a call to address 0 crashes the process.
    """
    links = layout.tables.links
    sizes = layout.tables.nodes.size
    is_matrix = links.kind == MATRIX
    is_long = links.width >= LONG
    # A tile has TILE rows at most, in each of which a source spikes once at most.
    may_send_more = sizes[links.source] * TILE > MOST_LISTED
    # Arguments of the right types: their values do not matter, as nothing is run here.
    listed = Listed(np.zeros(0, np.int32), _NO_STEP, np.zeros((1, 1), np.int64), 0)
    state = packed.pack(first_state(layout, tile=1))
    arguments = (_NO_STEP, _NO_STEP, _NO_STEP, listed, layout.packed_tables, state)
    paths = NO_PATHS
    if not is_matrix.all():
        paths = paths._replace(by_lists=address(by_lists, *arguments))
    if (is_matrix & (is_long | may_send_more)).any():
        paths = paths._replace(by_rows=address(by_rows, *arguments))
    return paths


@shared
def by_lists(link, rows_from, rows_to, listed, tables, state):  # type: ignore[no-untyped-def]
    """Deliver by lists: add the synapses in the list of each spike's source."""
    event, base, begin, node = listed
    nodes = tables.nodes
    links = tables.links
    ahead = np.uint64(1 + links.delay[link])
    rows_touched = np.uint64(links.width[link])
    for r in range(np.uint64(rows_from), np.uint64(rows_to)):
        due = r + ahead
        for e in range(begin[r, node], begin[r + _NEXT, node]):
            source = np.uint64(links.offset[link] + event[base + e])
            first = np.uint64(links.list_start[source])
            last = np.uint64(links.list_start[source + _NEXT])
            # The two kinds differ in the type of their words: a call for each.
            if links.kind[link] == LIST:
                _follow(link, due, first, last, state, links, links.word)
            else:
                _follow(link, due, first, last, state, links, links.wide_word)
        # Links with few synapses have 0 rows here: `_follow` has marked their chunks one by one.
        if begin[r + _NEXT, node] > begin[r, node]:
            for late in range(rows_touched):
                _touch_all(links.target_node[link], due + late, nodes, state.touched)
    return 0


@absorbed
def _deliver_by_short_rows(link, rows_from, rows_to, listed, tables, memory):  # type: ignore[no-untyped-def]
    """Deliver by short matrix rows: the spikes of all rows in one loop, then the marks."""
    _add_short_rows(link, rows_from, rows_to, listed, tables, memory)
    nodes = tables.nodes
    links = tables.links
    begin = listed.begin
    node = listed.node
    touched = memory.state.touched
    target_node = links.target_node[link]
    ahead = np.uint64(1 + links.delay[link])
    for r in range(np.uint64(rows_from), np.uint64(rows_to)):
        any_spike = begin[r + _NEXT, node] > begin[r, node]
        # Without a branch, because the processor could not predict which rows have a spike.
        for chunk in range(nodes.chunk[target_node], nodes.chunk[target_node + 1]):
            touched[r + ahead, np.uint64(chunk)] |= any_spike


@shared
def by_rows(link, rows_from, rows_to, listed, tables, state):  # type: ignore[no-untyped-def]
    """Deliver by matrix rows, the spikes of one row after the other."""
    event, base, begin, node = listed
    nodes = tables.nodes
    links = tables.links
    charge = state.charge
    offset = links.offset[link]
    width = links.width[link]
    low = np.uint64(links.target[link])
    ahead = np.uint64(1 + links.delay[link])
    for r in range(np.uint64(rows_from), np.uint64(rows_to)):
        if begin[r + _NEXT, node] > begin[r, node]:
            due = r + ahead
            next_spike = begin[r, node]
            if width >= LONG:
                next_spike = _add_eights(
                    link, listed, next_spike, begin[r + _NEXT, node], charge, due, links
                )
            for e in range(next_spike, begin[r + _NEXT, node]):
                start = np.uint64(offset + event[base + e] * width)
                for j in range(np.uint64(width)):
                    charge[due, low + j] += links.matrix[start + j]
            _touch_all(links.target_node[link], due, nodes, state.touched)
    return 0


@inner
def _add_short_rows(link, rows_from, rows_to, listed, tables, memory):  # type: ignore[no-untyped-def]
    """Add a short matrix row for each spike.

    First the row of every spike is written to ``row_of``. Then one loop runs over all spikes: nested loops over rows
    and their spikes would end at another number in most rows, which the processor cannot predict.
    """
    event, base, begin, node = listed
    links = tables.links
    charge = memory.state.charge
    row_of = memory.work.row_of
    first = begin[rows_from, node]
    last = begin[rows_to, node]
    for r in range(rows_from, rows_to):
        # `fill` writes LANES numbers at a time. The next row overwrites those that are too many.
        place = begin[r, node] - first
        fill(row_of, place, r)
        for k in range(place + LANES, begin[r + 1, node] - first, LANES):
            fill(row_of, k, r)
    offset = np.uint64(links.offset[link])
    width = np.uint64(links.width[link])
    low = np.uint64(links.target[link])
    ahead = np.uint64(1 + links.delay[link])
    first_event = np.uint64(base + first)
    spikes = np.uint64(last - first)
    spikes_of_part = spikes // _PARTS
    for i in range(spikes):
        # One spike of each part in turn; at the end, those that the division by _PARTS leaves over.
        spike: int | np.uint64 = i
        if i < _PARTS * spikes_of_part:
            spike = i % _PARTS * spikes_of_part + i // _PARTS
        due = np.uint64(row_of[spike]) + ahead
        start = offset + np.uint64(event[first_event + spike]) * width
        # Matrix rows are as long as the slots of their target, a multiple of LANES.
        for j in range(np.uint64(0), width, _LANES):
            add_weights(charge, due, low + j, links.matrix, start + j)


@absorbed
def _touch_all(node, at, nodes, touched):  # type: ignore[no-untyped-def]
    """Mark all chunks of a node as touched in a row."""
    for chunk in range(nodes.chunk[node], nodes.chunk[node + 1]):
        touched[at, np.uint64(chunk)] = 1


@inner
def _follow(link, at, first, last, state, links, words):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Add the synapses ``words[first..last]`` to the charges of row ``at``, or later by what a word says."""
    charge = state.charge
    touched = state.touched
    low = links.target[link]
    shift = links.weight_shift[link]
    # A word, from its lowest bit on: the slot, how many rows after `at`, and the weight.
    slot_bits = links.slot_bits[link]
    late_bits = links.late_bits[link]
    slot_mask = (1 << slot_bits) - 1
    late_mask = (1 << late_bits) - 1
    weight_from = slot_bits + late_bits
    # Three loops, so that none tests in each synapse what is the same for the whole link: whether synapses mark their
    # own chunks, and whether all have one delay.
    if links.width[link] == 0:
        for k in range(first, last):
            word = np.int64(words[k])
            due = at + np.uint64((word >> slot_bits) & late_mask)
            slot = np.uint64(low + (word & slot_mask))
            charge[due, slot] += (word >> weight_from) << shift
            touched[due, slot // _LANES] = 1
    elif late_mask == 0:
        for k in range(first, last):
            word = np.int64(words[k])
            charge[at, np.uint64(low + (word & slot_mask))] += (word >> weight_from) << shift
    else:
        for k in range(first, last):
            word = np.int64(words[k])
            due = at + np.uint64((word >> slot_bits) & late_mask)
            charge[due, np.uint64(low + (word & slot_mask))] += (word >> weight_from) << shift


@inner
def _add_eights(link, listed, first, last, charge, at, links):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Add matrix rows eight at once, so that the charges are loaded and stored once for eight spikes.

    Return the number of the first spike that is left: less than eight remain.
    """
    event = listed.event
    base = listed.base
    matrix = links.matrix
    offset = links.offset[link]
    width = links.width[link]
    slots = np.uint64(width)
    low = np.uint64(links.target[link])
    while first + 8 <= last:
        k = base + first
        # The first entries of the matrix rows of eight spikes.
        a = np.uint64(offset + event[k] * width)
        b = np.uint64(offset + event[k + 1] * width)
        c = np.uint64(offset + event[k + 2] * width)
        d = np.uint64(offset + event[k + 3] * width)
        e = np.uint64(offset + event[k + 4] * width)
        f = np.uint64(offset + event[k + 5] * width)
        g = np.uint64(offset + event[k + 6] * width)
        h = np.uint64(offset + event[k + 7] * width)
        for j in range(slots):
            # numba makes the sum of two 32-bit integers 64 bits wide, which would halve the lanes of the vectors: so
            # each sum is made 32 bits again. Eight weights of 16 bits cannot exceed them.
            first_four = (
                np.int32(matrix[a + j])
                + np.int32(matrix[b + j])
                + np.int32(matrix[c + j])
                + np.int32(matrix[d + j])
            )
            last_four = (
                np.int32(matrix[e + j])
                + np.int32(matrix[f + j])
                + np.int32(matrix[g + j])
                + np.int32(matrix[h + j])
            )
            charge[at, low + j] += np.int32(first_four) + np.int32(last_four)
        first += 8
    return first
