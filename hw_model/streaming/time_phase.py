"""Play a time phase while a recording arrives: rows are pushed, and the phase keeps its state from push to push.

In a time phase, a row of the recording is one step. The compiled loop lists the events of up to :data:`TILE` rows, runs
the fast engine for so many steps (:func:`hw_model.engine.tiles.run_tile`), and adds up what the readout reads of each
column: its spikes, or its largest potential. :class:`hw_model.streaming.session.Session` uses one per time phase.
"""

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


class PotentialColumns(NamedTuple):
    """The columns that the readout reads by their largest potential, from ``first_step`` of each on; all arrays (n,).

    All other columns are read by their spike counts.
    """

    columns: AnyArray
    first_step: AnyArray


class Room(NamedTuple):
    """The arrays of a phase that the loop writes besides the engine's state.

    - ``begin`` (inputs + 1,): where the lines of each input begin in a row
    - ``first`` (rows + 1, inputs), ``line``: the events of a tile: ``line[first[t, i]:first[t + 1, i]]`` are the
      lines of input i that spike in its step t
    - ``spikes``, ``sent``, ``active``, ``potential``: what the engine writes in a tile
    - ``so_far`` (columns,): the reading of every column; ``largest`` (columns of potentials,): the largest potentials
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
    """All that the loop over rows reads and writes. ``starts_late`` is explained at :class:`Live`."""

    room: Room
    potentials: PotentialColumns
    tables: Packed[Tables]
    memory: Packed[state.Memory]
    kept: Packed[state.Kept]
    starts_late: bool


TILE = 8
"""The most steps that are run at a time. Small, because few rows arrive at once, and charges that are due later are
moved after each push. Chosen by hand."""
_NO_END = 1 << 62
"""The end of a phase without a number of steps. It leaves room to add the steps that an aligned phase waits."""
# Typed constants: numba would compile a loop anew for each Python literal that it is called with.
_NO_STEP = np.int64(0)
_SKIP = np.bool_(True)
"""Let the engine skip updates that cannot change anything."""


class Live:
    """A time phase of ``steps`` steps, or without an end, that is played row by row.

    ``starts_late`` is for an aligned phase: it waits for the first row with enough events (:meth:`wait`). In the steps
    before that and after its last, the chip does not run it, and its registers count as 0.
    """

    def __init__(
        self,
        layout: FastLayout,
        steps: int | None,
        potentials: PotentialColumns,
        starts_late: bool = False,
    ) -> None:
        self._steps = _NO_END if steps is None else steps
        self._end = self._steps
        columns_read = len(potentials.columns)
        # The engine records the potentials of these columns here, tile after tile.
        potential = np.zeros((1, TILE, columns_read), dtype=np.int64)
        self._room = _room(layout, potential)
        first_state = state.first_state(layout, TILE)
        self._state = packed.pack(first_state)
        memory = state.Memory(first_state, state.workspace(layout, TILE), paths_of(layout))
        # Where the engine records the potential of each column; -1 for columns that are not recorded.
        place = np.full(layout.columns, -1, dtype=np.int64)
        place[potentials.columns] = np.arange(columns_read)
        recorded_registers = state.Kept(
            watched=columns_read > 0,
            u=state.NO_REGISTER,
            v=state.NO_REGISTER,
            potential=state.KeptRegister(place, start=0, rows=potential),
        )
        self._phase = _Phase(
            room=self._room,
            potentials=potentials,
            tables=layout.packed_tables,
            memory=packed.pack(memory),
            kept=packed.pack(recorded_registers),
            starts_late=starts_late,
        )
        self._packed_phase = packed.pack(self._phase)
        # Compile the loop for these types of arguments; their values do not matter.
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
        """Forget the recording: return to the state before the first step."""
        state.reset(self._state)
        self._room.so_far[:] = 0
        self._room.largest[:] = 0
        self._end = self._steps

    def wait(self, rows: ByteArray, readings: IntArray, low: int) -> None:
        """Leave out rows that come before the first step of an aligned phase; all readings are 0 after each."""
        self._end += len(rows)
        readings[:, low : low + len(self._room.so_far)] = 0

    def push(self, before: int, rows: ByteArray, readings: IntArray, low: int) -> None:
        """Play rows (rows, lines), a contiguous writeable array; ``before`` rows of the recording came before them.

        After each row, write the reading of every column so far into ``readings`` (rows, columns of all phases), from
        column ``low`` on. The reading is the count of spikes, or the largest potential of a column that is read by it.
        """
        self._run(
            before, self._end, self._tile_at, rows.reshape(-1), self._packed_phase, readings, low
        )

    @cached_property
    def _tile_at(self) -> np.int64:
        """The address of the compiled code of a tile.

        Compiled when the first tile is run, not in ``__init__``: the process that compiles ahead runs no tile
        (:mod:`hw_model.streaming.ahead`).
        """
        phase = self._phase
        room = phase.room
        # The arguments only give their types.
        return address(
            run_tile,
            Tile(_NO_STEP, _NO_STEP, _SKIP),
            Arriving(room.first, room.line),
            phase.tables,
            phase.memory,
            Written(room.spikes, room.sent, room.active, _NO_STEP, phase.kept),
        )


def _room(layout: FastLayout, potential: IntArray) -> Room:
    """Return the arrays for a tile; the engine writes potentials to ``potential`` (1, rows, columns of potentials)."""
    begin = np.cumsum([0, *layout.tables.nodes.size[: layout.inputs]])
    lines = int(begin[-1])
    return Room(
        begin=begin,
        first=np.zeros((TILE + 1, layout.inputs), np.int64),
        line=np.empty(TILE * lines + CACHE_LINE, np.int32),
        spikes=np.zeros((TILE, layout.columns), np.uint8),
        # The engine counts these two, and a session does not use them.
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
    readings,
    at,
):
    """Play the rows ``events``, a flat array of bytes, from step ``before`` on, but no step from ``end`` on.

    Write the reading of every column after each row into ``readings``, from column ``at`` on.
    """
    room = phase.room
    potentials = phase.potentials
    begin = room.begin
    rows_to_play = max(0, min(len(readings), end - before))
    for low in range(0, rows_to_play, TILE):
        rows = min(TILE, rows_to_play - low)
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
            _take_largest(before + low + row, row, room, potentials)
            _write_readings(room.so_far, readings, low + row, at)
    # Rows after the end of the phase change no spike count.
    for row in range(rows_to_play, len(readings)):
        if phase.starts_late:
            # Potentials count as 0 after the end. Row 0 of `room.potential` is 0 between tiles.
            _take_largest(before + row, 0, room, potentials)
        _write_readings(room.so_far, readings, row, at)


@absorbed
def _write_readings(so_far, readings, row, at):  # type: ignore[no-untyped-def]
    """Copy the readings of all columns into a row of ``readings``, from column ``at`` on."""
    for column in range(len(so_far)):
        readings[row, at + column] = so_far[column]


@absorbed
def _take_largest(step, row, room, potentials):  # type: ignore[no-untyped-def]
    """Replace the spike counts of columns that are read by potentials: the largest so far, 0 before the first step."""
    for j in range(len(potentials.columns)):
        potential = room.potential[0, row, j]
        room.potential[0, row, j] = 0
        room.largest[j] = (
            max(room.largest[j], potential) if step > potentials.first_step[j] else potential
        )
        room.so_far[potentials.columns[j]] = (
            room.largest[j] if step >= potentials.first_step[j] else 0
        )


@compiled
def weigh(readings, first, weights, scores):  # type: ignore[no-untyped-def]
    """Add the weighted readings of all terms of the readout to the class scores (rows, classes).

    A term is a population. ``first`` (terms,) is the first of its columns in ``readings``, one per class; ``weights``
    is (terms, rows), or (terms, 1) for the same weights in all rows.
    """
    for term in range(len(first)):
        for row in range(len(scores)):
            weight = weights[term, min(row, weights.shape[1] - 1)]
            for label in range(scores.shape[1]):
                scores[row, label] += weight * readings[row, first[term] + label]
