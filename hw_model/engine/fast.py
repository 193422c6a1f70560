"""The fast engine: compiled, event-driven, 32 bits wide, block by block over tiles of steps. The same integers."""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from hw_model.engine import packed
from hw_model.engine.ahead import start_ahead
from hw_model.engine.compiled import address, call_at, compiled, entry, inner
from hw_model.engine.delivery import paths_of
from hw_model.engine.lay_out import fast_layout
from hw_model.engine.layout import CHARGE_WRAPS, FIELDS, LANES, FastLayout, Tables
from hw_model.engine.packed import Packed
from hw_model.engine.private_numba import is_missing
from hw_model.engine.state import (
    NOTHING_KEPT,
    Arriving,
    Kept,
    KeptRegister,
    Memory,
    Tile,
    Written,
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
from hw_model.values import AnyArray, Int32Array, IntArray

_NO_STEP = np.int64(0)
COMPARTMENTS_TO_KEEP = 1 << 12
"""The most compartments of a phase whose memory, some MiB, is kept for the next recording: making it takes time."""


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
        registers = [_kept(kind, layout, trace, windows) for kind in REGISTERS]
        kept = packed.pack(Kept(True, *registers))
    first, line = join_lists(played.events)
    recordings = _Recordings(first=first, line=line, start=played.start, stop=played.stop)
    written = _Trace(
        spikes=trace.spikes,
        sent=trace.sent,
        active=trace.active,
        events=trace.events,
        totals=trace.totals,
        kept=kept,
    )
    in_parts(partial(_run_part, layout, recordings, skip, written), len(trace.sent))
    return trace


def start_ahead_if_missing() -> None:
    """Start what compiles loops in other processes, if the tile, which takes longest, is not compiled."""
    if is_missing(run_tile):
        start_ahead()


class _Recordings(NamedTuple):
    """A batch: the lists of its input events, and the steps from which and to which each recording runs.

    Those of recording b, row r and input m are ``line[first[b, r, m]:first[b, r + 1, m]]``.
    """

    first: IntArray
    line: Int32Array
    start: IntArray
    stop: IntArray


class _Trace(NamedTuple):
    """Arrays of :class:`hw_model.engine.trace.PhaseTrace`, and what to keep of registers."""

    spikes: AnyArray
    sent: AnyArray
    active: AnyArray
    events: AnyArray
    totals: AnyArray
    kept: Packed[Kept]


def _run_part(
    layout: FastLayout, recordings: _Recordings, skip: bool, written: _Trace, low: int, high: int
) -> None:
    """Run recordings ``low..high`` of a batch, in a memory of their own."""
    memories, code = _memories_and_code(layout)
    try:
        memory = memories.pop()  # of two threads that ask for the last one, one finds none
    except IndexError:
        memory = packed.pack(Memory(first_state(layout), workspace(layout), paths_of(layout)))
    if not code:
        code.append(_machine_code(recordings, layout.packed_tables, memory, skip, written))
    tile_at, loop = code[0]
    loop(low, high, tile_at, recordings, layout.packed_tables, memory, skip, written)
    if layout.columns <= COMPARTMENTS_TO_KEEP:
        memories.append(memory)


def _machine_code(
    recordings: _Recordings,
    tables: Packed[Tables],
    memory: Packed[Memory],
    skip: bool,
    written: _Trace,
) -> tuple[np.int64, Callable[..., Any]]:
    """Return where a tile lies, and the loop over recordings, for arguments of the kinds that a layout always has."""
    tile_at = address(
        run_tile,
        Tile(_NO_STEP, _NO_STEP, skip),
        Arriving(recordings.first[0], recordings.line),
        tables,
        memory,
        Written(written.spikes[0], written.sent[0], written.active[0], _NO_STEP, written.kept),
    )
    return tile_at, entry(_run, 0, 0, tile_at, recordings, tables, memory, skip, written)


@lru_cache(maxsize=8)
def _memories_and_code(
    layout: FastLayout,
) -> tuple[list[Packed[Memory]], list[tuple[np.int64, Callable[..., Any]]]]:
    """Return two lists that callers fill: the memories of a layout that no thread is using, and its machine code.

    Both are empty in the first call, and kept for the next ones. Whoever takes a memory resets it.
    """
    return [], []


def _kept(
    kind: Register, layout: FastLayout, trace: PhaseTrace, windows: dict[Register, Window]
) -> KeptRegister:
    """Return where the registers of a kind are written: into the trace, or nowhere without a window for them."""
    window = windows.get(kind, NOTHING)
    place = np.full(layout.columns, -1, dtype=np.int64)
    place[window.columns] = np.arange(len(window.columns))
    rows = trace.registers.get(kind, window.empty(len(trace.sent)))
    return KeptRegister(place=place, start=window.start, rows=rows)


def join_lists(events: Sequence[EventLists]) -> tuple[IntArray, Int32Array]:
    """Return the lists of several inputs as one: where each recording, row and input begins, and lines; in C order."""
    if len(events) == 1:
        return np.ascontiguousarray(events[0].first)[:, :, None], events[0].channel
    events_before = np.cumsum([0, *(len(lists.channel) for lists in events[:-1])])
    # An array of its own: a sum in numpy would lie in memory in the order of its operands.
    first = np.empty((*events[0].first.shape, len(events)), dtype=np.int64)
    for m, lists in enumerate(events):
        np.add(lists.first, events_before[m], out=first[:, :, m])
    return first, np.concatenate([lists.channel for lists in events])


@compiled
def _run(low, high, tile_at, recordings, tables, memory, skip, written):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Run recordings ``low..high`` one after the other, each tile by tile."""
    first, line, start, stop = recordings
    state = memory.state
    nodes = tables.nodes
    chunks = tables.chunks
    links = tables.links
    spikes, sent, active, events, totals, kept = written
    rows_of_tile = len(memory.work.masks)
    for b in range(low, high):
        reset(state)
        for step in range(start[b], stop[b], rows_of_tile):
            tile = Tile(step, min(rows_of_tile, stop[b] - step), skip)
            arriving = Arriving(first[b, step:], line)
            of_tile = Written(spikes[b, step:], sent[b], active[b, step:], b, kept)
            totals[b, SKIPPED] += call_at(tile_at, (tile, arriving, tables, memory, of_tile))
        for k in range(len(chunks.first_column)):
            for i in range(chunks.width[k]):
                column = chunks.first_column[k] + i
                registers_of_lane = k * FIELDS * LANES + i
                for event in range(events.shape[1]):
                    counter = registers_of_lane + (CHARGE_WRAPS + event) * LANES
                    events[b, event, column] = state.registers[counter]
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
def _add_up(start, stop, first, line, nodes, links, spikes, active, events, totals):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Add up what :func:`hw_model.engine.trace.added_up` does, of one recording: its ``totals``, in their order.

    Synaptic operations are counted from what is sent, by delay: what would act after the last step is left out.
    """
    due_late = links.due_late
    columns = spikes.shape[1]
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
