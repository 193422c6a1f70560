"""A phase whose inputs are played as they come: rows are pushed, and its state goes on from push to push."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from hw_model.engine import state
from hw_model.engine.compiled import called, compiled
from hw_model.engine.events import list_events, list_into
from hw_model.engine.fast import join_lists, machine_code
from hw_model.engine.layout import LANES, FastLayout
from hw_model.engine.trace import EVENTS, TOTALS
from hw_model.values import AnyArray, ByteArray, Int32Array, IntArray


class Read(NamedTuple):
    """The columns that predict by their largest potentials, each from a step on; none where spikes predict."""

    columns: AnyArray
    first: AnyArray


TILE = 8
"""Steps that a session keeps charges for at a time: few rows come at once, and after each push the rest is moved."""


class Live:
    """A phase of ``steps`` steps, or without end, before its first step."""

    def __init__(self, layout: FastLayout, steps: int | None, read: Read) -> None:
        self._layout, self._steps, self._read, self._start = layout, steps, read, 0
        ends = np.cumsum([0, *layout.nodes.size[: layout.inputs]])
        self._inputs = [slice(*ends) for ends in pairwise(ends.tolist())]
        self._state, self._work = state.first_state(layout, TILE), state.workspace(layout, TILE)
        self._so_far = np.zeros(layout.columns, dtype=np.int64)
        # What the loop adds up of a whole recording: nobody asks a session for it.
        shapes = (1, int(ends[-1]) + layout.columns), (1, len(EVENTS), layout.columns), (1, len(TOTALS))
        self._sent, self._events, self._totals = (np.zeros(shape, dtype=np.int64) for shape in shapes)
        self._place = np.full(layout.columns, -1, dtype=np.int64)
        self._place[read.columns] = np.arange(len(read.columns))
        self._room = self._room_for(1)
        lines = int(ends[-1])
        self._row = lines, np.zeros((1, 2), dtype=np.int64), np.empty(lines + LANES, dtype=np.int32)
        self._list_of_row = self._row[1][:, :, None], self._row[2]
        arguments = self._room[2]
        self._run = machine_code(layout, (0, 1, *self._lists(np.zeros((1, lines), np.uint8)), *arguments))

    def reset(self) -> None:
        """Go back to before the first step."""
        state.reset(self._state)
        self._so_far[:] = 0
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
            self._play(before, rows if lasting == len(rows) else rows[:lasting], counts)
        if lasting < len(rows):
            counts[lasting:] = self._so_far
        return counts

    def _play(self, before: int, rows: ByteArray, counts: IntArray) -> None:
        """Play some rows, and write what every column gives so far after each, (rows, columns)."""
        if len(self._room[0]) != len(rows):
            self._room = self._room_for(len(rows))
        spikes, potential, arguments = self._room
        self._run(0, 1, *self._lists(rows), *arguments)
        known = self._so_far[self._read.columns] if potential.size else None
        called(_sum_up, spikes, self._so_far, counts)
        if known is not None:
            self._take_largest(before, potential, known, counts[: len(rows)])
            potential[:] = 0

    def _lists(self, rows: ByteArray) -> tuple[IntArray, Int32Array]:
        """Return the events of some rows as the loop takes them."""
        if len(rows) == 1 and len(self._inputs) == 1:
            called(list_into, rows[0], *self._row)
            return self._list_of_row
        lists = [list_events(rows[None, :, its] if len(self._inputs) > 1 else rows[None]) for its in self._inputs]
        return join_lists(lists)

    def _room_for(self, many: int) -> tuple[ByteArray, IntArray, tuple[Any, ...]]:
        """Return room for the spikes and potentials of so many rows, and what the loop is to be given with it."""
        layout, read = self._layout, len(self._read.columns)
        spikes, active = np.zeros((1, many, layout.columns), np.uint8), np.zeros((1, many, layout.pieces), np.int64)
        potential, kept = np.zeros((1, many, read), dtype=np.int64), state.NOTHING_KEPT
        if read:
            register = state.KeptRegister(self._place, 0, potential)
            kept = state.Kept(True, state.NO_REGISTER, state.NO_REGISTER, register)
        arguments = (
            np.zeros(1, np.int64), np.full(1, many), layout.nodes, layout.chunks, layout.links, self._state, self._work,
            True, True, spikes, self._sent, active, self._events, self._totals, kept,
        )  # fmt: skip
        return spikes[0], potential[0], arguments

    def _take_largest(self, before: int, potential: IntArray, known: IntArray, counts: IntArray) -> None:
        """Put the largest potentials so far of the columns that are read in place of their spikes.

        ``known`` are those before these rows; 0 stands for that of a column whose first step is yet to come.
        """
        columns, step = self._read.columns, np.arange(before, before + len(potential))[:, None]
        least = np.iinfo(np.int64).min
        known = np.where(before > self._read.first, known, least)
        seen = np.where(step >= self._read.first, potential, least)
        largest = np.maximum.accumulate(np.maximum(seen, known), axis=0)
        counts[:, columns] = np.where(step >= self._read.first, largest, 0)
        self._so_far[columns] = counts[-1, columns]


@compiled
def _sum_up(spikes, so_far, counts):  # type: ignore[no-untyped-def]
    """Add rows of spikes to those of every column ``so_far``, note these after each row, and empty the spikes."""
    for row in range(len(spikes)):
        for column in range(len(so_far)):
            so_far[column] += spikes[row, column]
            spikes[row, column] = 0
            counts[row, column] = so_far[column]


@compiled
def weigh(counts, first, weights, scores):  # type: ignore[no-untyped-def]
    """Add columns of counts, ``first`` on, to class scores (rows, classes), times the weight of each row or of all."""
    for row in range(len(scores)):
        weight = weights[min(row, len(weights) - 1)]
        for label in range(scores.shape[1]):
            scores[row, label] += weight * counts[row, first + label]
