"""A phase whose inputs are played as they come: rows are pushed, and its state goes on from push to push."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from hw_model.engine import tiles
from hw_model.engine.events import list_events, list_row
from hw_model.engine.fast import join_lists, machine_code
from hw_model.engine.layout import LANES, FastLayout
from hw_model.engine.trace import EVENTS, TOTALS
from hw_model.values import AnyArray, ByteArray, Int32Array, IntArray


class Read(NamedTuple):
    """The columns that predict by their largest potentials, each from a step on; none where spikes predict."""

    columns: AnyArray
    first: AnyArray


class Live:
    """A phase of ``steps`` steps, or without end, before its first step."""

    def __init__(self, layout: FastLayout, steps: int | None, read: Read) -> None:
        self._layout, self._steps, self._read, self._start = layout, steps, read, 0
        ends = np.cumsum([0, *layout.nodes.size[: layout.inputs]])
        self._inputs = [slice(*ends) for ends in pairwise(ends.tolist())]
        self._state, self._work = tiles.first_state(layout), tiles.workspace(layout)
        self._so_far = np.zeros(layout.columns, dtype=np.int64)
        self._place = np.full(layout.columns, -1, dtype=np.int64)
        self._place[read.columns] = np.arange(len(read.columns))
        self._row = np.zeros((1, 2), dtype=np.int64), np.empty(int(ends[-1]) + LANES, dtype=np.int32)
        self._room: tuple[ByteArray, IntArray, tuple[Any, ...]] | None = None
        # What the loop counts of a whole recording: nobody asks a session for it.
        shapes = (1, int(ends[-1]) + layout.columns), (1, len(EVENTS), layout.columns), (1, len(TOTALS))
        self._sent, self._events, self._totals = (np.zeros(shape, dtype=np.int64) for shape in shapes)

    def reset(self) -> None:
        """Go back to before the first step."""
        tiles.reset(self._state)
        self._so_far = np.zeros_like(self._so_far)
        self._start = 0

    def wait(self, rows: ByteArray) -> AnyArray:
        """Leave rows out that come before the first step, and return what every column gives after each: 0."""
        self._start += len(rows)
        return np.zeros((len(rows), self._layout.columns), dtype=np.int64)

    def push(self, before: int, rows: ByteArray) -> AnyArray:
        """Play rows (rows, lines), side by side in memory and writeable, from step ``before`` on.

        Return what every column gives so far after each, (rows, columns): its spikes or, if read, largest potential.
        """
        lasting = len(rows) if self._steps is None else max(0, min(len(rows), self._start + self._steps - before))
        counts = np.empty((len(rows), self._layout.columns), dtype=np.int64)
        if lasting:
            played = counts[:lasting]
            potential = self._play(rows[:lasting], played)
            played[0] += self._so_far
            if lasting > 1:
                np.cumsum(played, axis=0, out=played)
            if potential.size:
                self._take_largest(before, potential, played)
            self._so_far = played[-1].copy()
        if lasting < len(rows):
            counts[lasting:] = self._so_far
        return counts

    def _play(self, rows: ByteArray, spikes: IntArray) -> IntArray:
        """Tell the spikes of some rows, (rows, columns), and return the potentials of the columns that are read."""
        if self._room is None or len(self._room[0]) != len(rows):
            self._room = self._room_for(len(rows))
        sent, potential, arguments = self._room
        sent[:] = 0
        if potential.size:
            potential[:] = 0
        arguments = *self._lists(rows), *arguments
        machine_code(self._layout, arguments)(*arguments)
        spikes[:] = sent
        return potential

    def _lists(self, rows: ByteArray) -> tuple[IntArray, Int32Array]:
        """Return the events of some rows as the loop takes them."""
        if len(rows) == 1 and len(self._inputs) == 1:
            list_row(rows[0], *self._row)
            return self._row[0][:, :, None], self._row[1]
        lists = [list_events(rows[None, :, its] if len(self._inputs) > 1 else rows[None]) for its in self._inputs]
        return join_lists(lists)

    def _room_for(self, many: int) -> tuple[ByteArray, IntArray, tuple[Any, ...]]:
        """Return room for the spikes and potentials of so many rows, and what the loop is to be given with it."""
        layout, read = self._layout, len(self._read.columns)
        spikes, active = np.zeros((1, many, layout.columns), np.uint8), np.zeros((1, many, layout.pieces), np.int64)
        potential, kept = np.zeros((1, many, read), dtype=np.int64), tiles.NOTHING_KEPT
        if read:
            register = tiles.KeptRegister(self._place, 0, potential)
            kept = tiles.Kept(True, tiles.NO_REGISTER, tiles.NO_REGISTER, register)
        arguments = (
            np.zeros(1, np.int64), np.full(1, many), layout.nodes, layout.chunks, layout.links, self._state, self._work,
            True, True, spikes, self._sent, active, self._events, self._totals, kept,
        )  # fmt: skip
        return spikes[0], potential[0], arguments

    def _take_largest(self, before: int, potential: IntArray, counts: IntArray) -> None:
        """Put the largest potential so far of the columns that are read in place of their spikes, until their first."""
        columns, step = self._read.columns, np.arange(before, before + len(potential))[:, None]
        least = np.iinfo(np.int64).min
        known = np.where(before > self._read.first, self._so_far[columns], least)
        seen = np.where(step >= self._read.first, potential, least)
        largest = np.maximum.accumulate(np.maximum(seen, known), axis=0)
        counts[:, columns] = np.where(step >= self._read.first, largest, 0)
