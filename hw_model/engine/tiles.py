"""The compiled loops of the fast engine over a tile: some consecutive steps, called its rows.

:func:`run_tile` runs the blocks of a phase one after the other, each over all rows of the tile. A block delivers the
spikes that reach it from outside, updates its chunks of compartments in every row, and lists their spikes for the
blocks behind it (:mod:`hw_model.engine.layout` explains the words, :mod:`hw_model.engine.chunks` the update of a
chunk). A chunk whose state is 0, and on which no charge arrives, is skipped: nothing could change in it. Ranges
``a..b`` leave out their end.
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

# Typed like variables: numba would compile a loop again for each literal that it is called with.
_ZERO = np.int64(0)
_NO_SPIKES = np.int32(0)
# Unsigned: numba tests signed indices for being negative, which means "from the end" in Python.
_LANES = np.uint64(LANES)
_CHUNK = np.uint64(FIELDS * LANES)
_U = np.uint64(U * LANES)
_V = np.uint64(V * LANES)
_POTENTIAL = np.uint64(POTENTIAL * LANES)


@shared
def run_tile(tile, arriving, tables, memory, written):  # type: ignore[no-untyped-def]
    """Run the steps of a tile; return in how many of them nothing could change.

    The results go to ``written`` (:class:`hw_model.engine.state.Written`): ``spikes`` and ``active``
    are written, ``sent`` is added to, and registers are recorded.
    """
    first = arriving.first
    rows = tile.rows
    state = memory.state
    work = memory.work
    # Input events of all rows are known beforehand; spikes of groups are counted as they are listed.
    for item in range(first.shape[1]):
        _count(
            arriving.line, first[0, item], first[rows, item], tables.nodes.first[item], written.sent
        )
    for r in range(rows):
        work.updated[r] = 0
    for block in range(len(tables.chunks.feeds_itself)):
        _run_block(block, tile, arriving, tables, memory, written)
    move_on(state, rows)
    # No block changed anything in a quiet row.
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
    # A block that feeds itself must receive the spikes of a row before it updates the next row.
    stride = 1 if chunks.feeds_itself[block] else tile.rows
    for low in range(0, tile.rows, stride):
        fired = _ZERO
        for r in range(low, low + stride):
            fired |= _update_members(first, last, r, tile, chunks, memory, written)
        _deliver_within(block, low, low + stride, fired, tables, memory, written)


@absorbed
def _deliver_into(block, rows, arriving, tables, memory):  # type: ignore[no-untyped-def]
    """Deliver to a block the spikes that inputs and earlier blocks sent in the tile."""
    links = tables.links
    work = memory.work
    for link in range(links.into_block[block], links.into_block[block + 1]):
        node = links.source[link]
        if node < arriving.first.shape[1]:
            listed = Listed(arriving.line, _ZERO, arriving.first, node)
        else:
            listed = Listed(work.event, work.list_start[node], work.begin, node)
        deliver(link, _ZERO, rows, listed, tables, memory)


@absorbed
def _deliver_within(block, low, high, fired, tables, memory, written):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """List the spikes of a block in rows ``low..high``, and deliver those that go to the block itself.

    ``fired`` is 0 if there are none.
    """
    chunks = tables.chunks
    links = tables.links
    work = memory.work
    for index in range(chunks.of_node[block], chunks.of_node[block + 1]):
        node = chunks.spiking_node[index]
        _list_spikes(node, low, high, fired, tables, work, written)
        if fired:
            listed = Listed(work.event, work.list_start[node], work.begin, node)
            for link in range(links.from_node[node], links.from_node[node + 1]):
                deliver(link, low, high, listed, tables, memory)


@absorbed
def _update_members(start, stop, r, tile, chunks, memory, written):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Update the bundles ``member[start:stop]`` in row r; return the bits of all their spikes, 0 if there are none."""
    state = memory.state
    work = memory.work
    kept = written.kept
    registers = state.registers
    at_rest = state.at_rest
    fired = np.int32(0)
    # Whether an earlier member of the current bundle was updated: it may pass a voltage on to this one.
    stirred = False
    index = start
    while index < stop:
        chunk = np.uint64(chunks.member[index])
        # A pair runs in one kernel, which records no potentials.
        is_pair = chunks.pair[index] and chunks.plain[chunk]
        if is_pair and chunks.plain[chunks.member[index + 1]] and not kept.watched:
            fired |= _update_pair(index, np.uint64(r), tile, chunks, memory, written)
            index += 3
            continue
        stirred &= not chunks.begins[index]
        index += 1
        was_at_rest = at_rest[chunk]
        if tile.skip and was_at_rest and not state.touched[r, chunk] and not stirred:
            continue
        at = np.uint64(chunk * np.uint64(FIELDS * LANES))
        if chunks.plain[chunk]:
            mask, busy, restless = update_plain(
                registers, at, state.charge, np.uint64(r), chunk * _LANES
            )
        else:
            mask, busy, restless = update(
                registers, at, state.charge, np.uint64(r), chunk * _LANES, chunks.widths
            )
        at_rest[chunk] = restless == 0
        work.masks[r, chunk] = mask
        fired |= mask
        _echo(chunk, np.uint64(r), mask, chunks, state)
        written.active[r, chunks.piece[chunk]] += busy
        # Arriving charges may cancel out, in which case nothing changes: that does not count as an update.
        if busy or not was_at_rest or not tile.skip:
            work.updated[r] = 1
        stirred = True
        if chunks.parent[chunk] >= 0:
            pass_on(registers, at, registers, np.uint64(chunks.parent[chunk] * FIELDS * LANES))
        if kept.watched:
            step = tile.step + r
            recording = written.recording
            _keep(registers, at + _U, chunk, chunks, step, recording, kept.u)
            _keep(registers, at + _V, chunk, chunks, step, recording, kept.v)
            _keep(registers, at + _POTENTIAL, chunk, chunks, step, recording, kept.potential)
    return fired


@absorbed
def _update_pair(index, r, tile, chunks, memory, written):  # type: ignore[no-untyped-def]
    """Do what :func:`_update_members` does for a pair: two dendrites and their sum, three members, in one kernel."""
    state = memory.state
    work = memory.work
    active = written.active
    at_rest = state.at_rest
    touched = state.touched
    registers = state.registers
    # The two dendrites, and the chunk of their sum, on which no charge arrives.
    a = np.uint64(chunks.member[index])
    b = np.uint64(chunks.member[index + 1])
    c = np.uint64(chunks.member[index + 2])
    are_at_rest = at_rest[a] and at_rest[b] and at_rest[c]
    if tile.skip and are_at_rest and not touched[r, a] and not touched[r, b]:
        return np.int32(0)
    mask, busy_a, busy_b, busy_c, restless_a, restless_b, restless_c = update_pair(
        registers, a * _CHUNK, registers, b * _CHUNK, registers, c * _CHUNK,
        state.charge, r, a * _LANES, state.charge, r, b * _LANES,
    )  # fmt: skip
    at_rest[a] = restless_a == 0
    at_rest[b] = restless_b == 0
    at_rest[c] = restless_c == 0
    active[r, chunks.piece[a]] += busy_a
    active[r, chunks.piece[b]] += busy_b
    active[r, chunks.piece[c]] += busy_c
    if busy_a or busy_b or busy_c or not are_at_rest or not tile.skip:
        work.updated[r] = 1
    _echo(c, r, mask, chunks, state)
    work.masks[r, c] = mask
    return mask


@absorbed
def _echo(chunk, r, mask, chunks, state):  # type: ignore[no-untyped-def]
    """Add the echo of a chunk's spikes to the charges of a child, due from the next row on, one row per delay.

    An echo with one delay, as most have, takes no branch: without spikes it adds 0.
    """
    if chunks.echo_to[chunk] >= 0:
        child = np.uint64(chunks.echo_to[chunk])
        due = r + np.uint64(1)
        end = np.uint64(len(chunks.echo))
        weights_of_row = np.uint64(state.charge.shape[1])
        at = child * _LANES
        while at < end:
            change_echo(state.charge, due, child * _LANES, chunks.echo, at, mask, _NO_SPIKES)
            state.touched[due, child] |= mask != 0
            # Without spikes, stop after the first row: nothing is added in any.
            at += weights_of_row if mask else end
            due += np.uint64(1)


@absorbed
def _list_spikes(node, low, high, fired, tables, work, written):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Turn a node's spikes in rows ``low..high`` from bits into lists, into 0 and 1, and into counts.

    ``fired`` is 0 if there are none.
    """
    nodes = tables.nodes
    chunks = tables.chunks
    spikes = written.spikes
    sent = written.sent
    masks = work.masks
    event = work.event
    begin = work.begin
    base = work.list_start[node]
    first = nodes.first[node]
    columns = spikes.shape[1]
    # `sent` counts input lines first, then columns.
    lines = len(sent) - columns
    # The last column from which a whole chunk of lanes can be written without leaving the row.
    last = columns - LANES
    # The lists of a tile follow each other: this call continues where that of the rows before ended.
    listed = begin[low, node] if low else 0
    begin[low, node] = listed
    for r in range(np.uint64(low), np.uint64(high)):
        if fired:
            for chunk in range(np.uint64(nodes.chunk[node]), np.uint64(nodes.chunk[node + 1])):
                mask = masks[r, chunk]
                column = chunks.first_column[chunk]
                masks[r, chunk] = 0
                # Without branches on the number of spikes, which the processor could not predict.
                listed += list_lanes(event, base + listed, column - first, mask)[0]
                # The last chunk is written further left, with its bits moved up by as many lanes. A phase with fewer
                # columns than a chunk has lanes is written lane by lane.
                at = min(column, last)
                if at >= 0:
                    note(spikes, r, at, mask << (column - at))
                    continue
                for i in range(np.uint64(chunks.width[chunk])):
                    spikes[r, np.uint64(column) + i] |= (mask >> i) & 1
        begin[r + np.uint64(1), node] = listed
    _count(event, base + begin[low, node], base + listed, lines + first, sent)


@inner
def _count(event, first, last, source, sent):  # type: ignore[no-untyped-def]
    """Add the spikes ``event[first:last]`` to the counts of a node's sources, which begin at ``sent[source]``."""
    source = np.uint64(source)
    for e in range(np.uint64(first), np.uint64(last)):
        sent[source + np.uint64(event[e])] += 1


@inner
def _keep(registers, at, chunk, chunks, step, recording, kept):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Record a register of a chunk, if this step and these columns are recorded."""
    row = step - kept.start
    first_column = chunks.first_column[chunk]
    if 0 <= row < kept.rows.shape[1]:
        for i in range(chunks.width[chunk]):
            if kept.place[first_column + i] >= 0:
                kept.rows[recording, row, kept.place[first_column + i]] = registers[
                    at + np.uint64(i)
                ]
