"""A phase whose inputs are played as they come: rows are pushed, and its state goes on from push to push."""

from typing import NamedTuple

import numpy as np

from hw_model.engine import tiles
from hw_model.engine.compiled import absorbed, compiled, entry, inner
from hw_model.engine.layout import FastLayout
from hw_model.engine.tiles import TILE
from hw_model.values import AnyArray, ByteArray


class Read(NamedTuple):
    """The columns that predict by their largest potentials, each from a step on; none where spikes predict."""

    columns: AnyArray
    first: AnyArray


class Room(NamedTuple):
    """What a tile of rows is played from and to: event lists, spikes, and what :func:`run_tile` counts.

    ``so_far`` (columns,): the spikes since the first step, or the largest potentials of the columns that are ``read``.
    """

    first: AnyArray
    line: AnyArray
    spikes: AnyArray
    so_far: AnyArray
    sent: AnyArray
    active: AnyArray
    kept: tiles.Kept
    read: Read


class Live:
    """A phase of ``steps`` steps, or without end, before its first step."""

    def __init__(self, layout: FastLayout, steps: int | None, read: Read) -> None:
        inputs = layout.inputs
        lines = int(layout.nodes.size[:inputs].sum())
        place = np.full(layout.columns, -1, dtype=np.int64)
        place[read.columns] = np.arange(len(read.columns))
        potential = tiles.KeptRegister(place, 0, np.zeros((1, TILE, len(read.columns)), dtype=np.int64))
        room = Room(
            first=np.zeros((TILE + 1, inputs), np.int64), line=np.empty(TILE * lines, np.int32),
            spikes=np.zeros((TILE, layout.columns), np.uint8), so_far=np.zeros(layout.columns, np.int64),
            sent=np.zeros(lines + layout.columns, np.int64), active=np.zeros((TILE, layout.pieces), np.int64),
            kept=tiles.Kept(len(read.columns) > 0, tiles.NO_REGISTER, tiles.NO_REGISTER, potential), read=read,
        )  # fmt: skip
        self._steps, self._columns, self._start = steps, layout.columns, 0
        self._state, self._so_far = tiles.first_state(layout), room.so_far
        self._played = (layout.nodes, layout.chunks, layout.links, self._state, tiles.workspace(layout), room)
        rows, counts = np.zeros((1, lines), dtype=np.uint8), np.zeros((1, layout.columns), dtype=np.int64)
        self._push = entry(_push, rows, 1, 0, *self._played, counts)

    def reset(self) -> None:
        """Go back to before the first step."""
        tiles.reset(self._state)
        self._so_far[:] = 0
        self._start = 0

    def wait(self, rows: ByteArray) -> AnyArray:
        """Leave rows out that come before the first step, and return what every column gives after each: 0."""
        self._start += len(rows)
        return np.zeros((len(rows), self._columns), dtype=np.int64)

    def push(self, before: int, rows: ByteArray) -> AnyArray:
        """Play rows (rows, lines), side by side in memory and writeable, from step ``before`` on.

        Return what every column gives so far after each, (rows, columns): its spikes or, if read, largest potential.
        """
        lasting = len(rows) if self._steps is None else max(0, min(len(rows), self._start + self._steps - before))
        counts = np.empty((len(rows), self._columns), dtype=np.int64)
        self._push(rows, lasting, before, *self._played, counts)
        return counts


# Typed as the variables that :mod:`hw_model.engine.fast` calls the same loop with, so that it is compiled once.
_SKIP, _ZERO = np.bool_(True), np.int64(0)


@compiled
def _push(  # type: ignore[no-untyped-def]
    rows, lasting, before, nodes, chunks, links, state, work, room, counts
):
    for low in range(0, lasting, len(room.spikes)):
        many = min(len(room.spikes), lasting - low)
        _list_rows(rows, low, many, nodes, room.first, room.line)
        tiles.run_tile(
            _ZERO, many, room.first, room.line, nodes, chunks, links, state, work, _SKIP,
            room.spikes, room.sent, room.active, _ZERO, room.kept,
        )  # fmt: skip
        for row in range(many):
            if room.kept.watched:
                _read_potentials(row, before + low + row, room)
            for column in range(len(room.so_far)):
                room.so_far[column] += room.spikes[row, column]
                room.spikes[row, column] = 0
                counts[low + row, column] = room.so_far[column]
    for row in range(lasting, len(rows)):
        for column in range(len(room.so_far)):
            counts[row, column] = room.so_far[column]


@absorbed
def _read_potentials(row, step, room):  # type: ignore[no-untyped-def]
    """Take the potentials of a row of a tile into the largest so far, instead of spikes; leave room for a next tile."""
    for j in range(len(room.read.columns)):
        column, seen = room.read.columns[j], room.kept.potential.rows[0, row, j]
        room.kept.potential.rows[0, row, j] = 0
        room.spikes[row, column] = 0
        first = room.read.first[j]
        if step == first or (step > first and seen > room.so_far[column]):
            room.so_far[column] = seen


@inner
def _list_rows(rows, low, many, nodes, first, line):  # type: ignore[no-untyped-def]
    """List the events of ``many`` rows from ``low`` on, input after input."""
    found = 0
    for node in range(first.shape[1]):
        begin = nodes.first[node]
        for row in range(many):
            first[row, node] = found
            for source in range(nodes.size[node]):
                if rows[low + row, begin + source]:
                    line[found] = source
                    found += 1
        first[many, node] = found
