"""The fast engine: it runs a phase in compiled loops, with the same integers as the plain engine.

:func:`run_phase` divides a batch between threads. Each thread runs its recordings one after the
other, and each recording in tiles of 64 steps (:mod:`hw_model.engine.tiles`).
"""

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
"""Stands for a step where only the type of an argument matters."""
COMPARTMENTS_TO_KEEP = 1 << 12
"""The most compartments of a phase whose memory, a few MiB, is kept for the next call, as allocating it takes time
(``docs/research/special-paths.md``: a factor of 1.4 for one recording). The limit was chosen by hand."""


def run_phase(
    program: ChipProgram,
    phase: str,
    played: PhaseInput,
    windows: dict[Register, Window],
    skip: bool = True,
) -> PhaseTrace:
    """Run a batch through one phase, in threads; record the columns and steps of registers that ``windows`` name."""
    layout = fast_layout(program, phase)
    trace = PhaseTrace.empty(played, layout.columns, layout.pieces, windows)
    kept = NOTHING_KEPT
    if windows:
        u, v, potential = (_kept(kind, layout, trace, windows) for kind in REGISTERS)
        kept = packed.pack(Kept(watched=True, u=u, v=v, potential=potential))
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
    """Start the processes that compile loops, if the loop that takes longest to compile, the tile, is missing."""
    if is_missing(run_tile):
        start_ahead()


class _Recordings(NamedTuple):
    """A batch: its input events, and the steps ``start..stop`` in which each recording runs.

    The events of recording b, row r and input i are ``line[first[b, r, i]:first[b, r + 1, i]]``.
    """

    first: IntArray
    line: Int32Array
    start: IntArray
    stop: IntArray


class _Trace(NamedTuple):
    """The arrays of a :class:`hw_model.engine.trace.PhaseTrace` that loops write, and which registers to record."""

    spikes: AnyArray
    sent: AnyArray
    active: AnyArray
    events: AnyArray
    totals: AnyArray
    kept: Packed[Kept]


def _run_part(
    layout: FastLayout, recordings: _Recordings, skip: bool, written: _Trace, low: int, high: int
) -> None:
    """Run recordings ``low..high`` of a batch, with a memory that no other thread uses."""
    memories, code = _memories_and_code(layout)
    try:
        # Not after `if memories`: another thread could take the last one in between.
        memory = memories.pop()
    except IndexError:
        memory = packed.pack(Memory(first_state(layout), workspace(layout), paths_of(layout)))
    if not code:
        code.append(_machine_code(recordings, layout.packed_tables, memory, skip, written))
    tile_at, loop = code[0]
    loop(low, high, tile_at, recordings, layout.packed_tables, memory, skip, written)
    # Large memories are freed, and allocated again for the next call.
    if layout.columns <= COMPARTMENTS_TO_KEEP:
        memories.append(memory)


def _machine_code(
    recordings: _Recordings,
    tables: Packed[Tables],
    memory: Packed[Memory],
    skip: bool,
    written: _Trace,
) -> tuple[np.int64, Callable[..., Any]]:
    """Return the address of :func:`run_tile` and the code of :func:`run_recordings`, for the types of a layout.

    All calls for one layout have the same types, so this is done once per layout.
    """
    tile_at = address(
        run_tile,
        Tile(_NO_STEP, _NO_STEP, skip),
        Arriving(recordings.first[0], recordings.line),
        tables,
        memory,
        Written(written.spikes[0], written.sent[0], written.active[0], _NO_STEP, written.kept),
    )
    return tile_at, entry(run_recordings, 0, 0, tile_at, recordings, tables, memory, skip, written)


@lru_cache(maxsize=8)
def _memories_and_code(
    layout: FastLayout,
) -> tuple[list[Packed[Memory]], list[tuple[np.int64, Callable[..., Any]]]]:
    """Return two lists that callers fill: memories of a layout that no thread is using, and its machine code.

    Both are empty at first, and the cache keeps them. A memory holds an old state: :func:`run_recordings` resets it.
    """
    return [], []


def _kept(
    kind: Register, layout: FastLayout, trace: PhaseTrace, windows: dict[Register, Window]
) -> KeptRegister:
    """Return where a register is recorded: in the trace, or nowhere if it has no window."""
    window = windows.get(kind, NOTHING)
    place = np.full(layout.columns, -1, dtype=np.int64)
    place[window.columns] = np.arange(len(window.columns))
    rows = trace.registers.get(kind, window.empty(len(trace.sent)))
    return KeptRegister(place=place, start=window.start, rows=rows)


def join_lists(events: Sequence[EventLists]) -> tuple[IntArray, Int32Array]:
    """Return the lists of all inputs as one pair of arrays, in C order, as in :class:`_Recordings`."""
    if len(events) == 1:
        return np.ascontiguousarray(events[0].first)[:, :, None], events[0].channel
    events_before = np.cumsum([0, *(len(lists.channel) for lists in events[:-1])])
    # Written into an array in C order: the sum of numpy would have the memory order of its operands.
    first = np.empty((*events[0].first.shape, len(events)), dtype=np.int64)
    for item, lists in enumerate(events):
        np.add(lists.first, events_before[item], out=first[:, :, item])
    return first, np.concatenate([lists.channel for lists in events])


@compiled
def run_recordings(low, high, tile_at, recordings, tables, memory, skip, written):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Run recordings ``low..high`` one after the other, each tile by tile."""
    first, line, start, stop = recordings
    state = memory.state
    nodes = tables.nodes
    chunks = tables.chunks
    links = tables.links
    spikes, sent, active, events, totals, kept = written
    rows_of_tile = len(memory.work.masks)
    for recording in range(low, high):
        reset(state)
        for step in range(start[recording], stop[recording], rows_of_tile):
            tile = Tile(step, min(rows_of_tile, stop[recording] - step), skip)
            arriving = Arriving(first[recording, step:], line)
            of_tile = Written(
                spikes[recording, step:], sent[recording], active[recording, step:], recording, kept
            )
            totals[recording, SKIPPED] += call_at(
                tile_at, (tile, arriving, tables, memory, of_tile)
            )
        # Events are counted in fields of the registers: copy them to the trace, where each column has its own place.
        for k in range(len(chunks.first_column)):
            for i in range(chunks.width[k]):
                column = chunks.first_column[k] + i
                registers_of_lane = k * FIELDS * LANES + i
                for event in range(events.shape[1]):
                    counter = registers_of_lane + (CHARGE_WRAPS + event) * LANES
                    events[recording, event, column] = state.registers[counter]
        _add_up(
            start[recording],
            stop[recording],
            first[recording],
            line,
            nodes,
            links,
            spikes[recording],
            active[recording],
            events[recording],
            totals[recording],
        )


@inner
def _add_up(start, stop, first, line, nodes, links, spikes, active, events, totals):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Write the ``totals`` of one recording, in the order of :data:`hw_model.engine.trace.TOTALS`.

    :func:`hw_model.engine.trace.added_up` does the same for the plain engine. ``totals[0]`` counts the synapses of
    spikes that would act after the last step: of a spike ``late`` steps before it, those with a delay of at least
    ``late``.
    """
    due_late = links.due_late
    columns = spikes.shape[1]
    lines = due_late.shape[1] - columns
    for late in range(min(len(due_late), stop - start)):
        row = stop - 1 - late
        for item in range(first.shape[1]):
            for e in range(first[row, item], first[row + 1, item]):
                totals[0] += due_late[late, nodes.first[item] + line[e]]
        for column in range(columns):
            totals[0] += spikes[row, column] * due_late[late, lines + column]
    totals[1] = (stop - start) * columns
    for row in range(start, stop):
        for piece in range(active.shape[1]):
            totals[2] += active[row, piece]
    for event in range(len(events)):
        for column in range(columns):
            totals[3 + event] += events[event, column]
