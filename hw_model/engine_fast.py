"""The fast engine: compiled, event-driven, in 32 bits, block by block over tiles of steps. The same integers, always.

Charges are kept in units of 64, the least that a weight can be. Wrapping q to 21 bits plus sign is then taking the low
16 bits, and rz needs no 64-bit product: with |x| = 4096 a + b it is a * keep + (b * keep >> 12).
A segment that is all zero, and on which nothing arrives, is skipped: nothing could change in it.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from hw_model.compiled import compiled
from hw_model.fast_layout import FastLayout, fast_layout
from hw_model.program import ChipProgram
from hw_model.registers32 import rz, wrap24
from hw_model.trace import EVENTS, NOTHING, REGISTERS, PhaseInput, PhaseTrace, Register, Window

TILE = 64
"""Steps that one block runs before the next does: their charges stay in the cache."""


def run_phase(program: ChipProgram, phase: str, played: PhaseInput, windows: dict[Register, Window]) -> PhaseTrace:
    """Run a batch through one phase, in threads; keep of the registers what the windows ask for."""
    layout = fast_layout(program, phase)
    batch, steps, lines = played.lines.shape
    n = len(layout.columns.keep_u)
    trace = PhaseTrace(
        spikes=np.zeros((batch, steps, n), dtype=np.uint8),
        sent=np.zeros((batch, lines + n), dtype=np.int64),
        active=np.zeros((batch, steps, layout.cores), dtype=np.int64),
        events=np.zeros((batch, len(EVENTS), n), dtype=np.int64),
        skipped=np.zeros(batch, dtype=np.int64),
        registers={kind: window.empty(batch) for kind, window in windows.items()},
    )
    threads = min(batch, os.cpu_count() or 1)
    bounds = np.linspace(0, batch, threads + 1).astype(int)

    def run(part: int) -> None:
        _run_part(layout, played, trace, windows, int(bounds[part]), int(bounds[part + 1]))

    if threads == 1:
        run(0)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(run, range(threads)))
    return trace


def _run_part(
    layout: FastLayout, played: PhaseInput, trace: PhaseTrace, windows: dict[Register, Window], start: int, stop: int
) -> None:
    n = len(layout.columns.keep_u)
    c, s, k = layout.columns, layout.segments, layout.links
    kept = []
    for kind in REGISTERS:
        window = windows.get(kind, NOTHING)
        place = np.full(n, -1, dtype=np.int64)
        place[window.columns] = np.arange(len(window.columns))
        kept += [place, window.start, trace.registers.get(kind, window.empty(stop))[start:stop]]
    charge = np.zeros((TILE + layout.longest_delay + 1, n), dtype=np.int64 if layout.wide else np.int32)
    _run(
        played.lines[start:stop], charge, TILE,
        layout.inputs, layout.node_first, layout.node_size,
        (c.keep_u, c.keep_v, c.threshold, c.bias, c.refractory, c.vmin, c.vmax, c.spiking),
        (s.first, s.stop, s.core, s.node, s.parent, s.parent_node, s.of_block),
        (k.source, k.target_node, k.dense, k.offset, k.width, k.target, k.delay, k.matrix, k.list_start, k.column,
         k.weight, k.late, k.into_block, k.from_node),
        trace.spikes[start:stop], trace.sent[start:stop], trace.active[start:stop], trace.events[start:stop],
        trace.skipped[start:stop], *kept,
    )  # fmt: skip


@compiled
def _sweep(  # type: ignore[no-untyped-def]
    first, stop, node, rows_from, rows_to, at_rest, charge, passed, touched, columns, state, wrapped, spikes, active,
    updated, parent, parent_node,
):  # fmt: skip
    """Update the columns ``first..stop`` of a segment in some rows of a tile; return whether they end at rest.

    ``spikes`` (rows, n), ``active`` and ``updated`` (rows,) are those of the tile. Charge and passed voltages are
    taken and set to 0. The inner loop has no branches and unsigned indices, so that it runs in vectors.
    """
    keep_u, keep_v, threshold, bias, refractory, vmin, vmax, spiking = columns
    u, v, potential, blocked = state
    wraps_q, wraps_u, clips = wrapped
    shift = np.uint64(parent - first) if parent >= 0 else np.uint64(0)
    low, high = np.uint64(first), np.uint64(stop)
    for r in range(np.uint64(rows_from), np.uint64(rows_to)):
        if at_rest and not touched[r, node]:
            continue
        busy_columns = np.int32(0)
        resting = np.int32(0)
        for i in range(low, high):
            arrived = charge[r, i]
            charge[r, i] = 0
            added = passed[r, i]
            passed[r, i] = 0
            busy = (arrived != 0) | (u[i] != 0) | (v[i] != 0) | (bias[i] != 0) | (added != 0)
            busy_columns += np.int32(busy)

            q = np.int32(np.int16(arrived))
            wraps_q[i] += np.int32(q != arrived)
            unwrapped = np.int32(rz(u[i], keep_u[i]) + np.int32(q << np.int32(6)))
            u[i] = wrap24(unwrapped)
            drive = np.int32(u[i] + bias[i])
            drive_wrapped = wrap24(drive)
            unclipped = np.int32(np.int32(rz(v[i], keep_v[i]) + drive_wrapped) + added)
            clipped = np.int32(min(max(unclipped, vmin[i]), vmax[i]))

            live = blocked[i] == 0
            seen = np.int32(clipped if live else np.int32(0))
            fired = live & (spiking[i] != 0) & (clipped > threshold[i])
            wraps_u[i] += np.int32(u[i] != unwrapped) + np.int32(live & (drive_wrapped != drive))
            clips[i] += np.int32(live & (clipped != unclipped))
            potential[i] = seen
            v[i] = np.int32(0) if fired else seen
            held = np.int32(0) if live else np.int32(blocked[i] - np.int32(1))
            blocked[i] = np.int32(refractory[i] - np.int32(1)) if fired else held
            spikes[r, i] = np.uint8(fired)
            resting += np.int32((not busy) & (blocked[i] == 0))
        active[r] += busy_columns
        updated[r] = 1
        at_rest = resting == stop - first
        if parent >= 0:
            for i in range(low, high):
                passed[r, i + shift] += v[i]
            touched[r, parent_node] = 1
    return at_rest


@compiled
def _collect(spikes, first, size, rows_from, rows_to, event, begin):  # type: ignore[no-untyped-def]
    """List the spikes of a node row by row: those of row r are ``event[begin[r]]`` up to ``begin[r + 1]``.

    Every index is written and only the spikes' ones are kept: a branch a compartment would be guessed wrong too often.
    """
    found = np.uint64(begin[rows_from])
    many, low = np.uint64(size), np.uint64(first)
    for r in range(np.uint64(rows_from), np.uint64(rows_to)):
        for i in range(many):
            event[found] = i
            found += np.uint64(spikes[r, low + i])
        begin[r + np.uint64(1)] = found


@compiled
def _deliver(link, rows_from, rows_to, event, begin, charge, touched, links):  # type: ignore[no-untyped-def]
    """Add the synapses of a link's spikes to the rows in which they are due: the next one, and later."""
    _, target_node, dense, offset, width, target, delay, matrix, list_start, column, weight, late, _, _ = links
    node = target_node[link]
    if dense[link]:
        many = np.uint64(width[link])
        low = np.uint64(target[link])
        for r in range(rows_from, rows_to):
            at = np.uint64(r + 1 + delay[link])
            for e in range(begin[r], begin[r + 1]):
                start = np.uint64(offset[link] + event[e] * width[link])
                for j in range(many):
                    charge[at, low + j] += matrix[start + j]
            if begin[r + 1] > begin[r]:
                touched[at, node] = 1
    else:
        for r in range(rows_from, rows_to):
            for e in range(begin[r], begin[r + 1]):
                source = offset[link] + event[e]
                for k in range(list_start[source], list_start[source + 1]):
                    at = r + 1 + late[k]
                    charge[at, column[k]] += weight[k]
                    touched[at, node] = 1


@compiled
def _keep(register, first, stop, row, place, kept):  # type: ignore[no-untyped-def]
    """Copy the columns of a segment that a window wants to its row, if the window has such a row."""
    if 0 <= row < len(kept):
        for i in range(first, stop):
            if place[i] >= 0:
                kept[row, place[i]] = register[i]


@compiled
def _run(  # type: ignore[no-untyped-def]
    lines, charge, tile, inputs, node_first, node_size, columns, segments, links,
    spikes, sent, active, events, skipped,
    u_place, u_start, u_kept, v_place, v_start, v_kept, potential_place, potential_start, potential_kept,
):  # fmt: skip
    """Run recordings one after the other; tiles of steps within one, blocks within a tile, steps within a block."""
    first, stop, core, node_of, parent, parent_node, of_block = segments
    source_of, into_block, from_node = links[0], links[12], links[13]
    steps, n, cores = spikes.shape[1], spikes.shape[2], active.shape[2]
    all_lines = lines.shape[2]
    nodes = len(node_size)
    u, v, potential, blocked = (
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
    )
    state = (u, v, potential, blocked)
    wrapped = (np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32))
    passed = np.zeros((tile, n), np.int32)
    touched = np.zeros((len(charge), nodes), np.uint8)
    at_rest = np.zeros(len(first), np.bool_)
    busy = np.zeros((cores, tile), np.int64)
    updated = np.zeros(tile, np.uint8)
    base = np.zeros(nodes + 1, np.int64)
    for m in range(nodes):
        base[m + 1] = base[m] + node_size[m] * tile
    event = np.zeros(base[nodes], np.int32)
    begin = np.zeros((nodes, tile + 1), np.int64)
    # A window needs every row as it is written, so steps are then taken one by one in every block.
    watched = len(u_kept[0]) + len(v_kept[0]) + len(potential_kept[0]) > 0
    for b in range(len(lines)):
        for array in state:
            array[:] = 0
        for array in wrapped:
            array[:] = 0
        charge[:] = 0
        passed[:] = 0
        touched[:] = 0
        at_rest[:] = False
        for tile_start in range(0, steps, tile):
            rows = min(tile, steps - tile_start)
            played = lines[b, tile_start : tile_start + rows]
            fired = spikes[b, tile_start : tile_start + rows]
            busy[:] = 0
            updated[:] = 0
            for m in range(inputs):
                here = event[base[m] : base[m + 1]]
                _collect(played, node_first[m], node_size[m], 0, rows, here, begin[m])
                for e in range(begin[m, rows]):
                    sent[b, node_first[m] + here[e]] += 1

            for block in range(len(of_block) - 1):
                low, high = of_block[block], of_block[block + 1]
                for link in range(into_block[block], into_block[block + 1]):
                    m = source_of[link]
                    _deliver(link, 0, rows, event[base[m] : base[m + 1]], begin[m], charge, touched, links)
                recurrent = node_of[low] != node_of[high - 1]
                for s in range(low, high):
                    recurrent |= from_node[node_of[s] + 1] > from_node[node_of[s]]
                stride = 1 if recurrent or watched else rows
                for r in range(0, rows, stride):
                    for s in range(low, high):
                        at_rest[s] = _sweep(
                            first[s], stop[s], node_of[s], r, r + stride, at_rest[s], charge, passed, touched, columns,
                            state, wrapped, fired, busy[core[s]], updated, parent[s], parent_node[s],
                        )  # fmt: skip
                        if watched:
                            step = tile_start + r
                            _keep(u, first[s], stop[s], step - u_start, u_place, u_kept[b])
                            _keep(v, first[s], stop[s], step - v_start, v_place, v_kept[b])
                            _keep(
                                potential, first[s], stop[s], step - potential_start, potential_place, potential_kept[b]
                            )
                    last = -1
                    for s in range(low, high):
                        m = node_of[s]
                        if m != last and parent[s] < 0:
                            here = event[base[m] : base[m + 1]]
                            _collect(fired, node_first[m], node_size[m], r, r + stride, here, begin[m])
                            for link in range(from_node[m], from_node[m + 1]):
                                _deliver(link, r, r + stride, here, begin[m], charge, touched, links)
                        last = m
                for s in range(low, high):
                    m = node_of[s]
                    if parent[s] < 0 and first[s] == node_first[m]:
                        for e in range(begin[m, rows]):
                            sent[b, all_lines + node_first[m] + event[base[m] + e]] += 1
            for r in range(rows):
                skipped[b] += 1 - updated[r]
                for k in range(cores):
                    active[b, tile_start + r, k] = busy[k, r]
            # What is due after this tile moves to the front; the rows behind it start empty.
            late = len(charge) - rows
            for r in range(late):
                charge[r] = charge[r + rows]
                touched[r] = touched[r + rows]
            charge[late:] = 0
            touched[late:] = 0
        for i in range(n):
            events[b, 0, i] = wrapped[0][i]
            events[b, 1, i] = wrapped[1][i]
            events[b, 2, i] = wrapped[2][i]
