"""The compiled loops of the fast engine over a tile of steps: a link, a block; a chunk is
:mod:`hw_model.engine.chunks`.

Charges are kept in units of 64, the least that a weight can be. A chunk that is all zero, and on which nothing arrives,
is skipped: nothing could change in it.
"""

from typing import NamedTuple

import numpy as np

from hw_model.engine.chunks import (
    add_up,
    add_weights,
    fill,
    list_lanes,
    note,
    pass_on,
    update,
    update_pair,
    update_plain,
)
from hw_model.engine.compiled import absorbed, compiled, inner
from hw_model.engine.layout import BIAS, FIELDS, LANES, MATRIX, PACKED_LIST, POTENTIAL, FastLayout, U, V, aligned
from hw_model.values import AnyArray

TILE = 64
"""Steps that one block runs before the next does: their charges stay in the cache."""


LONG = 128
"""Slots from which on several matrix rows are added at once; for fewer, setting out takes longer than it saves."""


MOST_LISTED = 1 << 12
"""Spikes that are delivered together at most."""


class State(NamedTuple):
    """A phase at a step: registers; charges due in a tile of steps and after it; the chunks that they touch, by row.

    ``at_rest`` marks the chunks that are all zero; the next two are registers and marks before the first step. Between
    tiles charges lie in the first ``due`` rows only, as many as the longest delay takes.
    """

    registers: AnyArray
    charge: AnyArray
    touched: AnyArray
    at_rest: AnyArray
    first_registers: AnyArray
    first_at_rest: AnyArray
    due: int


class Workspace(NamedTuple):
    """The spikes of a tile, as bits by row and chunk and as lists by node and row; and which rows were updated.

    ``row_of`` has room for the rows of spikes that are delivered together.
    """

    masks: AnyArray
    event: AnyArray
    begin: AnyArray
    updated: AnyArray
    row_of: AnyArray


class KeptRegister(NamedTuple):
    """Rows (batch, rows, columns) of a register from step ``start`` on; column c goes to ``place[c]`` if not -1."""

    place: AnyArray
    start: int
    rows: AnyArray


class Kept(NamedTuple):
    """What to keep of registers; ``watched``: anything at all."""

    watched: bool
    u: KeptRegister
    v: KeptRegister
    potential: KeptRegister


NO_REGISTER = KeptRegister(np.empty(0, dtype=np.int64), 0, np.empty((1, 0, 0), dtype=np.int64))
NOTHING_KEPT = Kept(False, NO_REGISTER, NO_REGISTER, NO_REGISTER)


def first_state(layout: FastLayout, tile: int = TILE) -> State:
    """Return the state before the first step."""
    registers = layout.chunks.registers.reshape(-1)
    at_rest = (layout.chunks.registers[:, BIAS] == 0).min(axis=1)
    chunks, due = len(at_rest), len(layout.links.due_late)
    charge = aligned((tile + due, chunks * LANES), registers.dtype)
    touched = np.zeros((tile + due, chunks), dtype=np.uint8)
    current = aligned(registers.shape, registers.dtype)
    current[:] = registers
    return State(current, charge, touched, at_rest.copy(), registers, at_rest, due)


def workspace(layout: FastLayout, tile: int = TILE) -> Workspace:
    """Return room for the spikes of a tile."""
    masks = np.zeros((tile, len(layout.chunks.node)), dtype=np.int32)
    begin = np.zeros((tile + 1, len(layout.nodes.first)), dtype=np.int64)
    event, updated = np.empty(tile * layout.columns + LANES, dtype=np.int32), np.zeros(tile, dtype=np.uint8)
    return Workspace(masks, event, begin, updated, np.empty(MOST_LISTED + LANES, dtype=np.int32))


_ZERO = np.int64(0)
"""Of a type, as a variable is: loops are compiled anew for each literal that they are called with."""
# Unsigned, or each index would be tested for being negative.
_LANES, _CHUNK = np.uint64(LANES), np.uint64(FIELDS * LANES)
_U, _V, _POTENTIAL = np.uint64(U * LANES), np.uint64(V * LANES), np.uint64(POTENTIAL * LANES)


@absorbed
def deliver(  # type: ignore[no-untyped-def]
    link, rows_from, rows_to, event, base, begin, m, charge, touched, row_of, nodes, links
):
    """Add the synapses of a link's spikes to the rows in which they are due: the next one, and later.

    The spikes of row r are ``event[base + e]`` for e in ``begin[r, m]..begin[r + 1, m]``.
    """
    offset, width = links.offset[link], links.width[link]
    if links.kind[link] == MATRIX:
        node = links.target_node[link]
        many, low = np.uint64(width), np.uint64(links.target[link])
        if width < LONG and begin[rows_to, m] - begin[rows_from, m] <= MOST_LISTED:
            _add_listed(link, rows_from, rows_to, event, base, begin, m, charge, row_of, links)
            for r in range(rows_from, rows_to):
                at, anything = np.uint64(r + 1 + links.delay[link]), begin[r + 1, m] > begin[r, m]
                for chunk in range(nodes.chunk[node], nodes.chunk[node + 1]):
                    touched[at, np.uint64(chunk)] |= anything
            return
        for r in range(rows_from, rows_to):
            if begin[r + 1, m] > begin[r, m]:
                at = np.uint64(r + 1 + links.delay[link])
                rest = begin[r, m]
                if width >= LONG:
                    rest = _add_eights(link, base, rest, begin[r + 1, m], event, charge, at, links)
                for e in range(rest, begin[r + 1, m]):
                    start = np.uint64(offset + event[base + e] * width)
                    for j in range(many):
                        charge[at, low + j] += links.matrix[start + j]
                _touch_all(node, at, nodes, touched)
    else:
        for r in range(rows_from, rows_to):
            due = np.uint64(r + 1 + links.delay[link])
            for e in range(begin[r, m], begin[r + 1, m]):
                source = np.uint64(offset + event[base + e])
                first, last = np.uint64(links.list_start[source]), np.uint64(links.list_start[source + np.uint64(1)])
                if links.kind[link] == PACKED_LIST:
                    _follow_packed(link, due, first, last, charge, links)
                else:
                    for k in range(first, last):
                        charge[np.uint64(r + 1 + links.late[k]), np.uint64(links.slot[k])] += links.weight[k]
                first, last = np.uint64(links.reach_start[source]), np.uint64(links.reach_start[source + np.uint64(1)])
                for k in range(first, last):
                    touched[np.uint64(r + 1 + links.reach_late[k]), np.uint64(links.reach_chunk[k])] = 1
            if width and begin[r + 1, m] > begin[r, m]:
                for late in range(np.uint64(width)):
                    _touch_all(links.target_node[link], due + late, nodes, touched)


@inner
def _add_listed(link, rows_from, rows_to, event, base, begin, m, charge, row_of, links):  # type: ignore[no-untyped-def]
    """Add a short matrix row for each spike; ``row_of`` is first told the row of each.

    One loop over all spikes: how many a row has would be guessed wrong in most rows.
    """
    first, last = begin[rows_from, m], begin[rows_to, m]
    for r in range(rows_from, rows_to):
        at = begin[r, m] - first
        fill(row_of, at, r)
        for k in range(at + LANES, begin[r + 1, m] - first, LANES):
            fill(row_of, k, r)
    offset, width, low = links.offset[link], np.uint64(links.width[link]), np.uint64(links.target[link])
    for e in range(last - first):
        at = np.uint64(row_of[e] + 1 + links.delay[link])
        start = np.uint64(offset + event[base + first + e] * links.width[link])
        for j in range(np.uint64(0), width, _LANES):
            add_weights(charge, at, low + j, links.matrix, start + j)


@absorbed
def _touch_all(node, at, nodes, touched):  # type: ignore[no-untyped-def]
    """Mark all chunks of a node as touched in a row."""
    for chunk in range(nodes.chunk[node], nodes.chunk[node + 1]):
        touched[at, np.uint64(chunk)] = 1


@inner
def _follow_packed(link, at, first, last, charge, links):  # type: ignore[no-untyped-def]
    """Add the packed synapses ``first..last`` to the row of charges ``at``, and later ones."""
    low, slot_bits, shift = links.target[link], links.slot_bits[link], links.weight_shift[link]
    slots, lates = (1 << slot_bits) - 1, (1 << links.late_bits[link]) - 1
    above = slot_bits + links.late_bits[link]
    if lates == 0:
        for k in range(first, last):
            word = np.int64(links.packed[k])
            charge[at, np.uint64(low + (word & slots))] += (word >> above) << shift
    else:
        for k in range(first, last):
            word = np.int64(links.packed[k])
            late = np.uint64((word >> slot_bits) & lates)
            charge[at + late, np.uint64(low + (word & slots))] += (word >> above) << shift


@inner
def _add_eights(link, base, first, last, event, charge, at, links):  # type: ignore[no-untyped-def]
    """Add matrix rows eight at once, so that the row of charges is passed less often; return the first one left."""
    matrix, many = links.matrix, np.uint64(links.width[link])
    offset, width, low = links.offset[link], links.width[link], np.uint64(links.target[link])
    while first + 8 <= last:
        k = base + first
        a, b = np.uint64(offset + event[k] * width), np.uint64(offset + event[k + 1] * width)
        c, d = np.uint64(offset + event[k + 2] * width), np.uint64(offset + event[k + 3] * width)
        e, f = np.uint64(offset + event[k + 4] * width), np.uint64(offset + event[k + 5] * width)
        g, h = np.uint64(offset + event[k + 6] * width), np.uint64(offset + event[k + 7] * width)
        for j in range(many):
            one = np.int32(matrix[a + j]) + np.int32(matrix[b + j]) + np.int32(matrix[c + j]) + np.int32(matrix[d + j])
            two = np.int32(matrix[e + j]) + np.int32(matrix[f + j]) + np.int32(matrix[g + j]) + np.int32(matrix[h + j])
            charge[at, low + j] += np.int32(one) + np.int32(two)
        first += 8
    return first


@inner
def _keep(registers, at, first_column, width, step, recording, kept):  # type: ignore[no-untyped-def]
    """Copy the lanes of a chunk that are to be kept, if this step is."""
    row = step - kept.start
    if 0 <= row < kept.rows.shape[1]:
        for i in range(width):
            if kept.place[first_column + i] >= 0:
                kept.rows[recording, row, kept.place[first_column + i]] = registers[at + np.uint64(i)]


@compiled
def reset(state):  # type: ignore[no-untyped-def]
    """Go back to before the first step."""
    # Loops: each assignment of a whole array would take a second to compile.
    for k in range(len(state.registers)):
        state.registers[k] = state.first_registers[k]
    for k in range(len(state.at_rest)):
        state.at_rest[k] = state.first_at_rest[k]
    for r in range(state.due):
        _clear(state.charge, r)
        _clear(state.touched, r)


@inner
def _clear(array, row):  # type: ignore[no-untyped-def]
    for k in range(array.shape[1]):
        array[row, k] = 0


@inner
def _move_row(array, row, to):  # type: ignore[no-untyped-def]
    """Move a row to another; return whether anything in it was not 0."""
    anything = False
    for k in range(array.shape[1]):
        anything |= array[row, k] != 0
        array[to, k] = array[row, k]
        array[row, k] = 0
    return anything


@inner
def run_tile(  # type: ignore[no-untyped-def]
    step, rows, first, line, nodes, chunks, links, state, work, skip, spikes, sent, active, recording, kept
):
    """Run ``rows`` steps from ``step`` on; return how many of them nothing had to be updated in.

    ``first`` (rows + 1 or more, inputs) and ``line``: the lists of the tile's input events. ``spikes`` (rows, n) and
    ``active`` (rows, pieces) are written, ``sent`` (lines + n,) is added to, and registers are kept for ``recording``.
    """
    if skip and _is_silent(rows, first, state):
        return rows
    for m in range(first.shape[1]):
        low = np.uint64(nodes.first[m])
        for e in range(np.uint64(first[0, m]), np.uint64(first[rows, m])):
            sent[low + np.uint64(line[e])] += 1
    for r in range(rows):
        work.updated[r] = 0
    for block in range(len(chunks.feeds_itself)):
        _run_block(
            block, step, rows, first, line, nodes, chunks, links, state, work, skip,
            spikes, sent, active, recording, kept,
        )  # fmt: skip
    _move_on(state, rows)
    quiet = rows
    for r in range(rows):
        quiet -= work.updated[r]
    return quiet


@inner
def _is_silent(rows, first, state):  # type: ignore[no-untyped-def]
    """Tell whether nothing comes in a tile, nothing is due in it or later, and everything is at rest."""
    for m in range(first.shape[1]):
        if first[0, m] != first[rows, m]:
            return False
    for k in range(len(state.at_rest)):
        if not state.at_rest[k]:
            return False
    for r in range(state.due):
        for k in range(len(state.at_rest)):
            if state.touched[r, k]:
                return False
    return True


@absorbed
def _move_on(state, rows):  # type: ignore[no-untyped-def]
    """Move what is due after a tile to the front; the rows behind it start empty. Charges of the tile are all taken."""
    for r in range(state.due):
        if _move_row(state.touched, r + rows, r):
            _move_row(state.charge, r + rows, r)
    for r in range(state.due, rows):
        _clear(state.touched, r)


@inner
def _run_block(  # type: ignore[no-untyped-def]
    block, step, rows, first, line, nodes, chunks, links, state, work, skip, spikes, sent, active, recording, kept
):
    """Run one block over the rows of a tile: at once, or, if it feeds itself, row by row."""
    charge, touched = state.charge, state.touched
    event, begin = work.event, work.begin
    tile = len(work.masks)
    for link in range(links.into_block[block], links.into_block[block + 1]):
        m = links.source[link]
        if m < first.shape[1]:
            deliver(link, _ZERO, rows, line, _ZERO, first, m, charge, touched, work.row_of, nodes, links)
        else:
            base = nodes.first[m] * tile
            deliver(link, _ZERO, rows, event, base, begin, m, charge, touched, work.row_of, nodes, links)

    # A block that feeds itself is updated row by row; any other, bundle by bundle, with its registers in the cache.
    by_row = chunks.feeds_itself[block]
    stride = 1 if by_row else rows
    for low in range(0, rows, stride):
        fired = np.int32(0)
        next_bundle = chunks.of_block[block]
        while next_bundle < chunks.of_block[block + 1]:
            start = chunks.bundle[next_bundle]
            next_bundle = chunks.of_block[block + 1] if by_row else next_bundle + 1
            if not by_row and chunks.bundle[next_bundle] == start + 1 and not kept.watched:
                fired |= _update_alone(np.uint64(chunks.member[start]), rows, chunks, state, work, skip, active)
                continue
            for r in range(low, low + stride):
                fired |= _update_members(
                    start, chunks.bundle[next_bundle], r, step, chunks, state, work, skip, active, recording, kept
                )
        for index in range(chunks.of_node[block], chunks.of_node[block + 1]):
            m = chunks.spiking_node[index]
            _list_spikes(m, low, low + stride, fired, nodes, chunks, work, spikes, sent)
            if fired:
                for link in range(links.from_node[m], links.from_node[m + 1]):
                    base = nodes.first[m] * tile
                    deliver(link, low, low + stride, event, base, begin, m, charge, touched, work.row_of, nodes, links)


@absorbed
def _update_alone(k, rows, chunks, state, work, skip, active):  # type: ignore[no-untyped-def]
    """Do what :func:`_update_members` does for a chunk to which nothing is joined, in all rows: the shortest loop."""
    piece = np.uint64(chunks.piece[k])
    rests, plain = skip and state.at_rest[k], chunks.plain[k]
    fired = np.int32(0)
    for r in range(np.uint64(rows)):
        if rests and not state.touched[r, k]:
            continue
        if plain:
            mask, busy, restless = update_plain(state.registers, k * _CHUNK, state.charge, r, k * _LANES)
        else:
            mask, busy, restless = update(state.registers, k * _CHUNK, state.charge, r, k * _LANES, chunks.widths)
        rests = skip and restless == 0
        work.masks[r, k] = mask
        work.updated[r] = 1
        active[r, piece] += busy
        fired |= mask
    state.at_rest[k] = rests
    return fired


@absorbed
def _update_members(start, stop, r, step, chunks, state, work, skip, active, recording, kept):  # type: ignore[no-untyped-def]
    """Update whole bundles, members ``start..stop``, in row r; return the spikes of all of them as bits."""
    step += r
    registers, at_rest = state.registers, state.at_rest
    fired = np.int32(0)
    stirred = False
    index = start
    while index < stop:
        k = np.uint64(chunks.member[index])
        if chunks.pair[index] and chunks.plain[k] and chunks.plain[chunks.member[index + 1]] and not kept.watched:
            fired |= _update_pair(index, np.uint64(r), chunks, state, work, skip, active)
            index += 3
            continue
        stirred &= not chunks.begins[index]
        index += 1
        if skip and at_rest[k] and not state.touched[r, k] and not stirred:
            continue
        at = np.uint64(k * np.uint64(FIELDS * LANES))
        if chunks.sums[k]:
            mask, busy, restless = add_up(registers, at)
        elif chunks.plain[k]:
            mask, busy, restless = update_plain(registers, at, state.charge, np.uint64(r), k * _LANES)
        else:
            mask, busy, restless = update(registers, at, state.charge, np.uint64(r), k * _LANES, chunks.widths)
        at_rest[k] = restless == 0
        work.masks[r, k] = mask
        fired |= mask
        active[r, chunks.piece[k]] += busy
        work.updated[r] = 1
        stirred = True
        if chunks.parent[k] >= 0:
            pass_on(registers, at, registers, np.uint64(chunks.parent[k] * FIELDS * LANES))
        if kept.watched:
            first, width = chunks.first_column[k], chunks.width[k]
            _keep(registers, at + _U, first, width, step, recording, kept.u)
            _keep(registers, at + _V, first, width, step, recording, kept.v)
            _keep(registers, at + _POTENTIAL, first, width, step, recording, kept.potential)
    return fired


@absorbed
def _update_pair(index, r, chunks, state, work, skip, active):  # type: ignore[no-untyped-def]
    """Do what :func:`_update_members` does for two dendrites and their sum, three members, at once."""
    a, b, c = chunks.member[index], chunks.member[index + 1], chunks.member[index + 2]
    a, b, c = np.uint64(a), np.uint64(b), np.uint64(c)
    at_rest, touched, registers = state.at_rest, state.touched, state.registers
    if skip and at_rest[a] and at_rest[b] and at_rest[c] and not touched[r, a] and not touched[r, b]:
        return np.int32(0)
    mask, busy_a, busy_b, busy_c, left_a, left_b, left_c = update_pair(
        registers, a * _CHUNK, registers, b * _CHUNK, registers, c * _CHUNK,
        state.charge, r, a * _LANES, state.charge, r, b * _LANES,
    )  # fmt: skip
    at_rest[a], at_rest[b], at_rest[c] = left_a == 0, left_b == 0, left_c == 0
    active[r, chunks.piece[a]] += busy_a
    active[r, chunks.piece[b]] += busy_b
    active[r, chunks.piece[c]] += busy_c
    work.masks[r, c] = mask
    work.updated[r] = 1
    return mask


@absorbed
def _list_spikes(m, low, high, fired, nodes, chunks, work, spikes, sent):  # type: ignore[no-untyped-def]
    """Turn the bits of node m in rows ``low..high`` into its lists, into 0 and 1, and into counts."""
    masks, event, begin = work.masks, work.event, work.begin
    base = nodes.first[m] * len(masks)
    lines = len(sent) - spikes.shape[1]
    found = begin[low, m] if low else 0
    begin[low, m] = found
    for r in range(low, high):
        if fired:
            for k in range(nodes.chunk[m], nodes.chunk[m + 1]):
                mask, column, width = masks[r, k], chunks.first_column[k], chunks.width[k]
                masks[r, k] = 0
                # No branches: they would be guessed wrong too often.
                found += list_lanes(event, base + found, column - nodes.first[m], mask)[0]
                if column + LANES <= spikes.shape[1]:
                    note(spikes, r, column, sent, lines + column, mask)
                    continue
                for i in range(width):
                    spikes[r, column + i] |= (mask >> i) & 1
                    sent[lines + column + i] += (mask >> i) & 1
        begin[r + 1, m] = found
