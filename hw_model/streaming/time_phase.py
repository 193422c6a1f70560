"""A phase whose inputs are played as they come: rows are pushed, and its state goes on from push to push."""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from hw_model.engine import packed, state
from hw_model.engine.compiled import absorbed, address, call_at, compiled, entry
from hw_model.engine.delivery import paths_of
from hw_model.engine.events import list_row
from hw_model.engine.layout import CACHE_LINE, FastLayout, Tables
from hw_model.engine.packed import Packed
from hw_model.engine.state import Arriving, Tile, Written
from hw_model.engine.tiles import run_tile
from hw_model.values import AnyArray, ByteArray, IntArray


class Read(NamedTuple):
    """The columns that predict by their largest potentials, each from a step on; none where spikes predict."""

    columns: AnyArray
    first: AnyArray


class Room(NamedTuple):
    """What a session keeps of a phase beside its state, and room for a tile.

    ``begin`` (inputs + 1,): where the lines of each input begin in a row; ``first`` (rows + 1, inputs) and ``line``:
    the lists of a tile's events; ``so_far`` (columns,): what every column gives; ``largest`` (columns read,).
    """

    begin: AnyArray
    first: AnyArray
    line: AnyArray
    spikes: AnyArray
    sent: AnyArray
    active: AnyArray
    potential: AnyArray
    so_far: AnyArray
    largest: AnyArray


class _Phase(NamedTuple):
    """All that the loop over rows reads and writes; ``starts_late`` as in :class:`Live`."""

    room: Room
    read: Read
    tables: Packed[Tables]
    memory: Packed[state.Memory]
    kept: Packed[state.Kept]
    starts_late: bool


TILE = 8
"""Steps that a session keeps charges for at a time: few rows come at once, and after each push the rest is moved."""
_NO_END = 1 << 62
"""Later than any step of a recording, by more than the steps that a phase can wait for its first."""
_NO_STEP, _SKIP = np.int64(0), np.bool_(True)
"""Of a type, as variables are: loops are compiled anew for each literal that they are called with."""


class Live:
    """A phase of ``steps`` steps, or without end, before its first step.

    ``starts_late``: it waits for its first step, and registers are 0 in the steps after its last, as in those before.
    """

    def __init__(
        self, layout: FastLayout, steps: int | None, read: Read, starts_late: bool = False
    ) -> None:
        self._steps = _NO_END if steps is None else steps
        self._end = self._steps
        columns_read = len(read.columns)
        potential = np.zeros((1, TILE, columns_read), dtype=np.int64)
        self._room = _room(layout, potential)
        first_state = state.first_state(layout, TILE)
        self._state = packed.pack(first_state)
        memory = state.Memory(first_state, state.workspace(layout, TILE), paths_of(layout))
        place = np.full(layout.columns, -1, dtype=np.int64)
        place[read.columns] = np.arange(columns_read)
        kept_registers = state.Kept(
            columns_read > 0,
            state.NO_REGISTER,
            state.NO_REGISTER,
            state.KeptRegister(place, 0, potential),
        )
        self._phase = _Phase(
            self._room,
            read,
            layout.packed_tables,
            packed.pack(memory),
            packed.pack(kept_registers),
            starts_late,
        )
        self._packed_phase = packed.pack(self._phase)
        self._run = entry(
            _run,
            0,
            0,
            _NO_STEP,
            np.zeros(0, np.uint8),
            self._packed_phase,
            np.zeros((0, 0), np.int64),
            0,
        )

    def reset(self) -> None:
        """Go back to before the first step."""
        state.reset(self._state)
        self._room.so_far[:] = 0
        self._room.largest[:] = 0
        self._end = self._steps

    def wait(self, rows: ByteArray, counts: IntArray, low: int) -> None:
        """Leave rows out that come before the first step; all columns give 0 after each."""
        self._end += len(rows)
        counts[:, low : low + len(self._room.so_far)] = 0

    def push(self, before: int, rows: ByteArray, counts: IntArray, low: int) -> None:
        """Play rows (rows, lines), side by side in memory and writeable, from step ``before`` on.

        Note what every column gives so far after each, its spikes or, if read, largest potential, in ``counts`` (rows,
        columns of all phases), from column ``low`` on.
        """
        self._run(
            before, self._end, self._tile_at, rows.reshape(-1), self._packed_phase, counts, low
        )

    @cached_property
    def _tile_at(self) -> np.int64:
        """Return where the code of a tile lies: asked when one is run, since who compiles ahead runs none."""
        phase = self._phase
        room = phase.room
        return address(
            run_tile,
            Tile(_NO_STEP, _NO_STEP, _SKIP),
            Arriving(room.first, room.line),
            phase.tables,
            phase.memory,
            Written(room.spikes, room.sent, room.active, _NO_STEP, phase.kept),
        )


def _room(layout: FastLayout, potential: IntArray) -> Room:
    """Return room for a tile, whose potentials (1, rows, columns read) the loop writes to ``potential``."""
    begin = np.cumsum([0, *layout.tables.nodes.size[: layout.inputs]])
    lines = int(begin[-1])
    return Room(
        begin=begin,
        first=np.zeros((TILE + 1, layout.inputs), np.int64),
        line=np.empty(TILE * lines + CACHE_LINE, np.int32),
        spikes=np.zeros((TILE, layout.columns), np.uint8),
        # What the loop counts of a whole recording, sent and active: nobody asks a session for it.
        sent=np.zeros(lines + layout.columns, np.int64),
        active=np.zeros((TILE, layout.pieces), np.int64),
        potential=potential,
        so_far=np.zeros(layout.columns, np.int64),
        largest=np.zeros(potential.shape[2], np.int64),
    )


@compiled
def _run(  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    before,
    end,
    tile_at,
    events,
    phase,
    counts,
    at,
):
    """Play rows, bytes side by side, from step ``before`` up to ``end``; note what every column gives after each."""
    room = phase.room
    read = phase.read
    begin = room.begin
    lasting = max(0, min(len(counts), end - before))
    for low in range(0, lasting, TILE):
        rows = min(TILE, lasting - low)
        listed = np.uint64(0)
        for m in range(len(begin) - 1):
            room.first[0, m] = listed
            for row in range(rows):
                start = (low + row) * begin[-1] + begin[m]
                listed, _ = list_row(events, start, begin[m + 1] - begin[m], room.line, listed)
                room.first[row + 1, m] = listed
        tile = Tile(_NO_STEP, rows, _SKIP)
        arriving = Arriving(room.first, room.line)
        written = Written(room.spikes, room.sent, room.active, _NO_STEP, phase.kept)
        call_at(tile_at, (tile, arriving, phase.tables, phase.memory, written))
        for row in range(rows):
            for column in range(len(room.so_far)):
                room.so_far[column] += room.spikes[row, column]
                room.spikes[row, column] = 0
            _take_largest(before + low + row, row, room, read)
            _note(room.so_far, counts, low + row, at)
    for row in range(lasting, len(counts)):
        if phase.starts_late:
            _take_largest(before + row, 0, room, read)  # of room that is 0 between tiles
        _note(room.so_far, counts, row, at)


@absorbed
def _note(so_far, counts, row, at):  # type: ignore[no-untyped-def]
    """Copy what every column gives into a row of counts, from column ``at`` on."""
    for column in range(len(so_far)):
        counts[row, at + column] = so_far[column]


@absorbed
def _take_largest(step, row, room, read):  # type: ignore[no-untyped-def]
    """Put the largest potentials so far of the columns that are read in place of their spikes; 0 before their step."""
    for j in range(len(read.columns)):
        potential = room.potential[0, row, j]
        room.potential[0, row, j] = 0
        room.largest[j] = max(room.largest[j], potential) if step > read.first[j] else potential
        room.so_far[read.columns[j]] = room.largest[j] if step >= read.first[j] else 0


@compiled
def weigh(counts, first, weights, scores):  # type: ignore[no-untyped-def]
    """Add columns of counts to class scores (rows, classes), for each term from its ``first`` on, times its weight.

    ``first`` (terms,); ``weights`` (terms, rows), or (terms, 1) for all rows.
    """
    for term in range(len(first)):
        for row in range(len(scores)):
            weight = weights[term, min(row, weights.shape[1] - 1)]
            for label in range(scores.shape[1]):
                scores[row, label] += weight * counts[row, first[term] + label]
