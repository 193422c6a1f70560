"""The compiled loops of the fast engine over a tile of steps: blocks in turn, and in these the updates of chunks.

A chunk is :mod:`hw_model.engine.chunks`. One that is all zero, and on which nothing arrives, is skipped: nothing could
change in it.
"""

import numpy as np

from hw_model.engine.chunks import (
    change_echo,
    list_lanes,
    note,
    pass_on,
    update,
    update_pair,
    update_plain,
)
from hw_model.engine.compiled import absorbed, inner, shared
from hw_model.engine.delivery import Listed, deliver
from hw_model.engine.layout import FIELDS, LANES, POTENTIAL, U, V
from hw_model.engine.state import move_on

_ZERO, _NONE = np.int64(0), np.int32(0)
"""Of a type, as a variable is: loops are compiled anew for each literal that they are called with."""
# Unsigned, or each index would be tested for being negative.
_LANES, _CHUNK = np.uint64(LANES), np.uint64(FIELDS * LANES)
_U, _V, _POTENTIAL = np.uint64(U * LANES), np.uint64(V * LANES), np.uint64(POTENTIAL * LANES)


@shared
def run_tile(tile, arriving, tables, memory, written):  # type: ignore[no-untyped-def]
    """Run the steps of a tile; return in how many of them nothing could change.

    ``spikes`` and ``active`` of what is :class:`hw_model.engine.state.Written` are written, ``sent``
    is added to, and registers are kept.
    """
    first = arriving.first
    rows = tile.rows
    state = memory.state
    work = memory.work
    for m in range(first.shape[1]):
        _count(arriving.line, first[0, m], first[rows, m], tables.nodes.first[m], written.sent)
    for r in range(rows):
        work.updated[r] = 0
    for block in range(len(tables.chunks.feeds_itself)):
        _run_block(block, tile, arriving, tables, memory, written)
    move_on(state, rows)
    quiet = rows
    for r in range(rows):
        quiet -= work.updated[r]
    return quiet


@inner
def _run_block(block, tile, arriving, tables, memory, written):  # type: ignore[no-untyped-def]
    """Run one block over the rows of a tile: at once, or, if it feeds itself, row by row."""
    _deliver_into(block, tile.rows, arriving, tables, memory)
    chunks = tables.chunks
    first = chunks.bundle[chunks.of_block[block]]
    last = chunks.bundle[chunks.of_block[block + 1]]
    # What a block that feeds itself sends in a row, it must be given before the next one.
    stride = 1 if chunks.feeds_itself[block] else tile.rows
    for low in range(0, tile.rows, stride):
        fired = _ZERO
        for r in range(low, low + stride):
            fired |= _update_members(first, last, r, tile, chunks, memory, written)
        _deliver_within(block, low, low + stride, fired, tables, memory, written)


@absorbed
def _deliver_into(block, rows, arriving, tables, memory):  # type: ignore[no-untyped-def]
    """Deliver what inputs and earlier blocks sent in a tile to a block."""
    links = tables.links
    work = memory.work
    for link in range(links.into_block[block], links.into_block[block + 1]):
        m = links.source[link]
        if m < arriving.first.shape[1]:
            listed = Listed(arriving.line, _ZERO, arriving.first, m)
        else:
            listed = Listed(work.event, work.list_start[m], work.begin, m)
        deliver(link, _ZERO, rows, listed, tables, memory)


@absorbed
def _deliver_within(block, low, high, fired, tables, memory, written):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """List the spikes of a block in rows ``low..high``, and deliver those that stay within it."""
    chunks = tables.chunks
    links = tables.links
    work = memory.work
    for index in range(chunks.of_node[block], chunks.of_node[block + 1]):
        m = chunks.spiking_node[index]
        _list_spikes(m, low, high, fired, tables, work, written)
        if fired:
            listed = Listed(work.event, work.list_start[m], work.begin, m)
            for link in range(links.from_node[m], links.from_node[m + 1]):
                deliver(link, low, high, listed, tables, memory)


@absorbed
def _update_members(start, stop, r, tile, chunks, memory, written):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Update whole bundles, members ``start..stop``, in row r; return the spikes of all of them as bits."""
    state = memory.state
    work = memory.work
    kept = written.kept
    registers = state.registers
    at_rest = state.at_rest
    fired = np.int32(0)
    stirred = False
    index = start
    while index < stop:
        k = np.uint64(chunks.member[index])
        is_pair = chunks.pair[index] and chunks.plain[k]
        if is_pair and chunks.plain[chunks.member[index + 1]] and not kept.watched:
            fired |= _update_pair(index, np.uint64(r), tile, chunks, memory, written)
            index += 3
            continue
        stirred &= not chunks.begins[index]
        index += 1
        was_at_rest = at_rest[k]
        if tile.skip and was_at_rest and not state.touched[r, k] and not stirred:
            continue
        at = np.uint64(k * np.uint64(FIELDS * LANES))
        if chunks.plain[k]:
            mask, busy, restless = update_plain(
                registers, at, state.charge, np.uint64(r), k * _LANES
            )
        else:
            mask, busy, restless = update(
                registers, at, state.charge, np.uint64(r), k * _LANES, chunks.widths
            )
        at_rest[k] = restless == 0
        work.masks[r, k] = mask
        fired |= mask
        _echo(k, np.uint64(r), mask, chunks, state)
        written.active[r, chunks.piece[k]] += busy
        # What arrives may add up to nothing, and then nothing changes.
        if busy or not was_at_rest or not tile.skip:
            work.updated[r] = 1
        stirred = True
        if chunks.parent[k] >= 0:
            pass_on(registers, at, registers, np.uint64(chunks.parent[k] * FIELDS * LANES))
        if kept.watched:
            step = tile.step + r
            recording = written.recording
            _keep(registers, at + _U, k, chunks, step, recording, kept.u)
            _keep(registers, at + _V, k, chunks, step, recording, kept.v)
            _keep(registers, at + _POTENTIAL, k, chunks, step, recording, kept.potential)
    return fired


@absorbed
def _update_pair(index, r, tile, chunks, memory, written):  # type: ignore[no-untyped-def]
    """Do what :func:`_update_members` does for two dendrites and their sum, three members, at once."""
    state = memory.state
    work = memory.work
    active = written.active
    at_rest = state.at_rest
    touched = state.touched
    registers = state.registers
    # The dendrites, and the chunk of their sum.
    a = np.uint64(chunks.member[index])
    b = np.uint64(chunks.member[index + 1])
    c = np.uint64(chunks.member[index + 2])
    are_at_rest = at_rest[a] and at_rest[b] and at_rest[c]
    if tile.skip and are_at_rest and not touched[r, a] and not touched[r, b]:
        return np.int32(0)
    mask, busy_a, busy_b, busy_c, left_a, left_b, left_c = update_pair(
        registers, a * _CHUNK, registers, b * _CHUNK, registers, c * _CHUNK,
        state.charge, r, a * _LANES, state.charge, r, b * _LANES,
    )  # fmt: skip
    at_rest[a] = left_a == 0
    at_rest[b] = left_b == 0
    at_rest[c] = left_c == 0
    active[r, chunks.piece[a]] += busy_a
    active[r, chunks.piece[b]] += busy_b
    active[r, chunks.piece[c]] += busy_c
    if busy_a or busy_b or busy_c or not are_at_rest or not tile.skip:
        work.updated[r] = 1
    _echo(c, r, mask, chunks, state)
    work.masks[r, c] = mask
    return mask


@absorbed
def _echo(k, r, mask, chunks, state):  # type: ignore[no-untyped-def]
    """Add what the spikes of a chunk pass to a child, due from the next row on; without branches if that is one row."""
    if chunks.echo_to[k] >= 0:
        to = np.uint64(chunks.echo_to[k])
        due = r + np.uint64(1)
        end = np.uint64(len(chunks.echo))
        weights_of_row = np.uint64(state.charge.shape[1])
        at = to * _LANES
        while at < end:
            change_echo(state.charge, due, to * _LANES, chunks.echo, at, mask, _NONE)
            state.touched[due, to] |= mask != 0
            # Without spikes one row is enough: it adds nothing, and so would all later ones.
            at += weights_of_row if mask else end
            due += np.uint64(1)


@absorbed
def _list_spikes(m, low, high, fired, tables, work, written):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Turn the bits of node m in rows ``low..high`` into its lists, into 0 and 1, and into counts."""
    nodes = tables.nodes
    chunks = tables.chunks
    spikes = written.spikes
    sent = written.sent
    masks = work.masks
    event = work.event
    begin = work.begin
    base = work.list_start[m]
    first = nodes.first[m]
    columns = spikes.shape[1]
    lines = len(sent) - columns
    # The last column at which a whole chunk of lanes can be written.
    last = columns - LANES
    listed = begin[low, m] if low else 0
    begin[low, m] = listed
    for r in range(np.uint64(low), np.uint64(high)):
        if fired:
            for k in range(np.uint64(nodes.chunk[m]), np.uint64(nodes.chunk[m + 1])):
                mask = masks[r, k]
                column = chunks.first_column[k]
                masks[r, k] = 0
                # No branches: they would be guessed wrong too often.
                listed += list_lanes(event, base + listed, column - first, mask)[0]
                at = min(column, last)
                if at >= 0:
                    note(spikes, r, at, mask << (column - at))
                    continue
                for i in range(np.uint64(chunks.width[k])):
                    spikes[r, np.uint64(column) + i] |= (mask >> i) & 1
        begin[r + np.uint64(1), m] = listed
    _count(event, base + begin[low, m], base + listed, lines + first, sent)


@inner
def _count(event, first, last, source, sent):  # type: ignore[no-untyped-def]
    """Count the spikes ``first..last`` of a list among those of the sources from ``source`` on."""
    source = np.uint64(source)
    for e in range(np.uint64(first), np.uint64(last)):
        sent[source + np.uint64(event[e])] += 1


@inner
def _keep(registers, at, k, chunks, step, recording, kept):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Copy the lanes of chunk k that are to be kept, if this step is."""
    row = step - kept.start
    first_column = chunks.first_column[k]
    if 0 <= row < kept.rows.shape[1]:
        for i in range(chunks.width[k]):
            if kept.place[first_column + i] >= 0:
                kept.rows[recording, row, kept.place[first_column + i]] = registers[
                    at + np.uint64(i)
                ]
