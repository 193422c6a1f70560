"""The compiled loops that deliver spikes: those of a node in some rows of a tile, over a link.

A spike adds its synapses to the charges of the row in which they are due: the next one, or as many later as the delay
says. A link is held as a matrix, of which every spike adds a row, or as lists, which every spike follows.
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
"""Slots from which on several matrix rows are added at once; for fewer, setting out takes longer than it saves."""

# Unsigned, or each index would be tested for being negative.
_LANES = np.uint64(LANES)
_NEXT = np.uint64(1)
_NO_STEP = np.int64(0)
_PARTS = np.uint64(4)
"""Parts of a list of spikes that are delivered in turn: neighbours in one would wait for each other's charges."""


class Listed(NamedTuple):
    """The spikes of one node: those of row r are ``event[base + e]``, e in ``begin[r, node]..begin[r + 1, node]``."""

    event: AnyArray
    base: int | np.int64
    begin: AnyArray
    node: int


@absorbed
def deliver(link, rows_from, rows_to, listed, tables, memory):  # type: ignore[no-untyped-def]
    """Add the synapses of a link's spikes in rows ``rows_from..rows_to`` to the rows in which they are due."""
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
    """Return where the code lies that a phase needs of :func:`by_lists` and :func:`by_rows`.

    What :func:`deliver` may call must be there: a call to an address of 0 ends the process.
    """
    links = layout.tables.links
    sizes = layout.tables.nodes.size
    is_matrix = links.kind == MATRIX
    is_long = links.width >= LONG
    # No tile is longer, and a source sends one spike a step at most.
    may_send_more = sizes[links.source] * TILE > MOST_LISTED
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
    """Follow the list of each spike's source."""
    event, base, begin, m = listed
    nodes = tables.nodes
    links = tables.links
    ahead = np.uint64(1 + links.delay[link])
    rows_touched = np.uint64(links.width[link])
    for r in range(np.uint64(rows_from), np.uint64(rows_to)):
        due = r + ahead
        for e in range(begin[r, m], begin[r + _NEXT, m]):
            source = np.uint64(links.offset[link] + event[base + e])
            first = np.uint64(links.list_start[source])
            last = np.uint64(links.list_start[source + _NEXT])
            if links.kind[link] == LIST:
                _follow(link, due, first, last, state, links, links.word)
            else:
                _follow(link, due, first, last, state, links, links.wide_word)
        if begin[r + _NEXT, m] > begin[r, m]:
            for late in range(rows_touched):
                _touch_all(links.target_node[link], due + late, nodes, state.touched)
    return 0


@absorbed
def _deliver_by_short_rows(link, rows_from, rows_to, listed, tables, memory):  # type: ignore[no-untyped-def]
    """Add short matrix rows of the spikes of all rows together."""
    _add_short_rows(link, rows_from, rows_to, listed, tables, memory)
    nodes = tables.nodes
    links = tables.links
    begin = listed.begin
    m = listed.node
    touched = memory.state.touched
    node = links.target_node[link]
    ahead = np.uint64(1 + links.delay[link])
    for r in range(np.uint64(rows_from), np.uint64(rows_to)):
        any_spike = begin[r + _NEXT, m] > begin[r, m]
        # No branch: which rows have a spike would be guessed wrong too often.
        for chunk in range(nodes.chunk[node], nodes.chunk[node + 1]):
            touched[r + ahead, np.uint64(chunk)] |= any_spike


@shared
def by_rows(link, rows_from, rows_to, listed, tables, state):  # type: ignore[no-untyped-def]
    """Add matrix rows of the spikes of one row after the other."""
    event, base, begin, m = listed
    nodes = tables.nodes
    links = tables.links
    charge = state.charge
    offset = links.offset[link]
    width = links.width[link]
    low = np.uint64(links.target[link])
    ahead = np.uint64(1 + links.delay[link])
    for r in range(np.uint64(rows_from), np.uint64(rows_to)):
        if begin[r + _NEXT, m] > begin[r, m]:
            due = r + ahead
            rest = begin[r, m]
            if width >= LONG:
                rest = _add_eights(link, listed, rest, begin[r + _NEXT, m], charge, due, links)
            for e in range(rest, begin[r + _NEXT, m]):
                start = np.uint64(offset + event[base + e] * width)
                for j in range(np.uint64(width)):
                    charge[due, low + j] += links.matrix[start + j]
            _touch_all(links.target_node[link], due, nodes, state.touched)
    return 0


@inner
def _add_short_rows(link, rows_from, rows_to, listed, tables, memory):  # type: ignore[no-untyped-def]
    """Add a short matrix row for each spike; ``row_of`` is first told the row of each.

    One loop over all spikes: how many a row has would be guessed wrong in most rows.
    """
    event, base, begin, m = listed
    links = tables.links
    charge = memory.state.charge
    row_of = memory.work.row_of
    first = begin[rows_from, m]
    last = begin[rows_to, m]
    for r in range(rows_from, rows_to):
        at = begin[r, m] - first
        fill(row_of, at, r)
        for k in range(at + LANES, begin[r + 1, m] - first, LANES):
            fill(row_of, k, r)
    offset = np.uint64(links.offset[link])
    width = np.uint64(links.width[link])
    low = np.uint64(links.target[link])
    ahead = np.uint64(1 + links.delay[link])
    first_event = np.uint64(base + first)
    spikes = np.uint64(last - first)
    part = spikes // _PARTS
    for i in range(spikes):
        e: int | np.uint64 = i
        if i < _PARTS * part:
            e = i % _PARTS * part + i // _PARTS
        due = np.uint64(row_of[e]) + ahead
        start = offset + np.uint64(event[first_event + e]) * width
        for j in range(np.uint64(0), width, _LANES):
            add_weights(charge, due, low + j, links.matrix, start + j)


@absorbed
def _touch_all(node, at, nodes, touched):  # type: ignore[no-untyped-def]
    """Mark all chunks of a node as touched in a row."""
    for chunk in range(nodes.chunk[node], nodes.chunk[node + 1]):
        touched[at, np.uint64(chunk)] = 1


@inner
def _follow(link, at, first, last, state, links, words):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Add the synapses ``first..last``, packed in words, to the row of charges ``at``, and later ones."""
    charge = state.charge
    touched = state.touched
    low = links.target[link]
    shift = links.weight_shift[link]
    # A word, from its lowest bit on: the slot, how many rows late, and the weight.
    slot_bits = links.slot_bits[link]
    late_bits = links.late_bits[link]
    slot_mask = (1 << slot_bits) - 1
    late_mask = (1 << late_bits) - 1
    weight_from = slot_bits + late_bits
    # Three loops, for which of them it is does not change from synapse to synapse.
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
    """Add matrix rows eight at once, so that the row of charges is passed less often; return the first one left."""
    event = listed.event
    base = listed.base
    matrix = links.matrix
    offset = links.offset[link]
    width = links.width[link]
    slots = np.uint64(width)
    low = np.uint64(links.target[link])
    while first + 8 <= last:
        k = base + first
        # Where the rows of eight spikes begin.
        a = np.uint64(offset + event[k] * width)
        b = np.uint64(offset + event[k + 1] * width)
        c = np.uint64(offset + event[k + 2] * width)
        d = np.uint64(offset + event[k + 3] * width)
        e = np.uint64(offset + event[k + 4] * width)
        f = np.uint64(offset + event[k + 5] * width)
        g = np.uint64(offset + event[k + 6] * width)
        h = np.uint64(offset + event[k + 7] * width)
        for j in range(slots):
            # Made 32 bits again and again: numba takes the sum of two such numbers for one of 64.
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
