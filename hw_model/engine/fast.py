"""The fast engine: compiled, event-driven, 32 bits wide, block by block over tiles of steps. The same integers."""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np

from hw_model.engine.compiled import address, call_at, compiled, entry, inner
from hw_model.engine.lay_out import fast_layout
from hw_model.engine.layout import CHARGE_WRAPS, FIELDS, LANES, FastLayout
from hw_model.engine.state import (
    NOTHING_KEPT,
    Kept,
    KeptRegister,
    State,
    Workspace,
    first_state,
    reset,
    workspace,
)
from hw_model.engine.threads import in_parts
from hw_model.engine.tiles import run_tile
from hw_model.engine.trace import (
    NOTHING,
    REGISTERS,
    SKIPPED,
    EventLists,
    PhaseInput,
    PhaseTrace,
    Register,
    Window,
)
from hw_model.program.chip_program import ChipProgram
from hw_model.values import Int32Array, IntArray

_NO_STEP = np.int64(0)
SMALL = 1 << 12
"""Compartments up to which a phase keeps its room, some MiB, for the next recording; making it takes time."""


def run_phase(
    program: ChipProgram,
    phase: str,
    played: PhaseInput,
    windows: dict[Register, Window],
    skip: bool = True,
) -> PhaseTrace:
    """Run a batch through one phase, in threads; keep of the registers what the windows ask for."""
    layout = fast_layout(program, phase)
    trace = PhaseTrace.empty(played, layout.columns, layout.pieces, windows)
    kept = NOTHING_KEPT
    if windows:
        kept = Kept(True, *(_kept(kind, layout, trace, windows) for kind in REGISTERS))
    given = (
        *join_lists(played.events),
        played.start,
        played.stop,
        layout.nodes,
        layout.chunks,
        layout.links,
    )
    written = trace.spikes, trace.sent, trace.active, trace.events, trace.totals, kept
    in_parts(partial(_run_part, layout, given, skip, written), len(trace.sent))
    return trace


def _run_part(
    layout: FastLayout,
    given: tuple[Any, ...],
    skip: bool,
    written: tuple[Any, ...],
    low: int,
    high: int,
) -> None:
    """Run recordings ``low..high`` of those given, in a room of their own."""
    rooms, code = _made(layout)
    try:
        room = rooms.pop()  # of two threads that ask for the last one, one finds none
    except IndexError:
        room = first_state(layout), workspace(layout)
    if not code:
        code.append(_machine_code(given, room, skip, written))
    tile_at, loop = code[0]
    loop(low, high, tile_at, given, room, skip, written)
    if layout.columns <= SMALL:
        rooms.append(room)


def _machine_code(
    given: tuple[Any, ...], room: tuple[State, Workspace], skip: bool, written: tuple[Any, ...]
) -> tuple[np.int64, Callable[..., Any]]:
    """Return where a tile lies, and the loop over recordings, for arguments of the kinds that a layout always has."""
    first, line, _, _, *tables = given
    spikes, sent, active, _, _, kept = written
    tile_at = address(
        run_tile, _NO_STEP, _NO_STEP, first[0], line, *tables, *room, skip,
        spikes[0], sent[0], active[0], _NO_STEP, kept,
    )  # fmt: skip
    return tile_at, entry(_run, 0, 0, tile_at, given, room, skip, written)


@lru_cache(maxsize=8)
def _made(
    layout: FastLayout,
) -> tuple[list[tuple[State, Workspace]], list[tuple[np.int64, Callable[..., Any]]]]:
    """Return the rooms of a layout that no thread is using, whoever takes one resets it, and its machine code."""
    return [], []


def _kept(
    kind: Register, layout: FastLayout, trace: PhaseTrace, windows: dict[Register, Window]
) -> KeptRegister:
    window = windows.get(kind, NOTHING)
    place = np.full(layout.columns, -1, dtype=np.int64)
    place[window.columns] = np.arange(len(window.columns))
    return KeptRegister(
        place, window.start, trace.registers.get(kind, window.empty(len(trace.sent)))
    )


def join_lists(events: Sequence[EventLists]) -> tuple[IntArray, Int32Array]:
    """Return the lists of several inputs as one: where each recording, row and input begins, and lines; in C order."""
    if len(events) == 1:
        return np.ascontiguousarray(events[0].first)[:, :, None], events[0].channel
    before = np.cumsum([0, *(len(lists.channel) for lists in events[:-1])])
    first = np.empty(
        (*events[0].first.shape, len(events)), dtype=np.int64
    )  # numpy would keep the order of those given
    for m, lists in enumerate(events):
        np.add(lists.first, before[m], out=first[:, :, m])
    return first, np.concatenate([lists.channel for lists in events])


@compiled
def _run(low, high, tile_at, given, room, skip, written):  # type: ignore[no-untyped-def]
    """Run recordings ``low..high`` one after the other, each tile by tile."""
    first, line, start, stop, nodes, chunks, links = given
    state, work = room
    spikes, sent, active, events, totals, kept = written
    tile = len(work.masks)
    for b in range(low, high):
        reset(state)
        for step in range(start[b], stop[b], tile):
            rows = min(tile, stop[b] - step)
            totals[b, SKIPPED] += call_at(tile_at, (
                step, rows, first[b, step:], line, nodes, chunks, links, state, work, skip,
                spikes[b, step:], sent[b], active[b, step:], b, kept,
            ))  # fmt: skip
        for k in range(len(chunks.first_column)):
            for i in range(chunks.width[k]):
                at = k * FIELDS * LANES + i
                for event in range(3):
                    events[b, event, chunks.first_column[k] + i] = state.registers[
                        at + (CHARGE_WRAPS + event) * LANES
                    ]
        _add_up(
            start[b],
            stop[b],
            first[b],
            line,
            nodes,
            links,
            spikes[b],
            active[b],
            events[b],
            totals[b],
        )


@inner
def _add_up(start, stop, first, line, nodes, links, spikes, active, events, totals):  # type: ignore[no-untyped-def]
    """Add up what :func:`hw_model.engine.trace.added_up` does, of one recording."""
    due_late, columns = links.due_late, spikes.shape[1]
    lines = due_late.shape[1] - columns
    for late in range(min(len(due_late), stop - start)):
        row = stop - 1 - late
        for m in range(first.shape[1]):
            for e in range(first[row, m], first[row + 1, m]):
                totals[0] += due_late[late, nodes.first[m] + line[e]]
        for column in range(columns):
            totals[0] += spikes[row, column] * due_late[late, lines + column]
    totals[1] = (stop - start) * columns
    for row in range(start, stop):
        for piece in range(active.shape[1]):
            totals[2] += active[row, piece]
    for event in range(len(events)):
        for column in range(columns):
            totals[3 + event] += events[event, column]
