"""What the fast engine carries from step to step, where it works, and what it is given and writes of a tile.

Charges are in units of :mod:`hw_model.arithmetic.loihi`.
"""

from typing import NamedTuple

import numpy as np

from hw_model.engine import packed
from hw_model.engine.compiled import absorbed, compiled, inner
from hw_model.engine.layout import BIAS, LANES, FastLayout, aligned
from hw_model.values import AnyArray

TILE = 64
"""Steps that one block runs before the next does: their charges stay in the cache."""
MOST_LISTED = 1 << 14
"""Spikes that are delivered together at most: all that 256 sources can send in a tile."""


class State(NamedTuple):
    """A phase at a step: registers; charges due in a tile of steps and after it; the chunks that they touch, by row.

    ``at_rest`` marks the chunks that are all zero; the next two are registers and marks before the first step. Between
    tiles charges lie in the first ``due`` rows only, as many as the longest delay takes.
    """

    registers: AnyArray
    charge: AnyArray
    touched: AnyArray
    at_rest: AnyArray
    first_registers: AnyArray
    first_at_rest: AnyArray
    due: int


class Workspace(NamedTuple):
    """The spikes of a tile, as bits by row and chunk and as lists by node and row; and which rows were updated.

    The lists of node n begin at ``event[list_start[n]]``; behind them is room for all lanes of a chunk, which are
    written whether they spike or not. ``row_of`` has room for the rows of spikes that are delivered together.
    """

    masks: AnyArray
    event: AnyArray
    list_start: AnyArray
    begin: AnyArray
    updated: AnyArray
    row_of: AnyArray


class Paths(NamedTuple):
    """Where code lies that not every phase needs; 0 where this one does not, so that it need not be compiled."""

    by_lists: int | np.int64
    by_rows: int | np.int64


NO_PATHS = Paths(by_lists=0, by_rows=0)


class Memory(NamedTuple):
    """All that the loops write on their way, and where the rest of their code lies."""

    state: State
    work: Workspace
    paths: Paths


class Tile(NamedTuple):
    """``rows`` steps from ``step`` on; ``skip``: leave out what cannot change anything."""

    step: int | np.int64
    rows: int | np.int64
    skip: bool | np.bool_


class Arriving(NamedTuple):
    """Input events of a tile: those of row r and input m are ``line[first[r, m]:first[r + 1, m]]``."""

    first: AnyArray
    line: AnyArray


class KeptRegister(NamedTuple):
    """Rows (batch, rows, columns) of a register from step ``start`` on; column c goes to ``place[c]`` if not -1."""

    place: AnyArray
    start: int
    rows: AnyArray


class Kept(NamedTuple):
    """What to keep of registers; ``watched``: anything at all."""

    watched: bool
    u: KeptRegister
    v: KeptRegister
    potential: KeptRegister


class Written(NamedTuple):
    """What is written of a tile.

    ``spikes`` (rows, n) are 0 and 1; ``sent`` (lines + n,) counts what each sends, and ``active``
    (rows, pieces) the compartments that were busy. Registers are kept for number ``recording``.
    """

    spikes: AnyArray
    sent: AnyArray
    active: AnyArray
    recording: int | np.int64
    kept: packed.Packed[Kept]


NO_REGISTER = KeptRegister(np.empty(0, dtype=np.int64), 0, np.empty((1, 0, 0), dtype=np.int64))
NOTHING_KEPT = packed.pack(Kept(False, NO_REGISTER, NO_REGISTER, NO_REGISTER))


def first_state(layout: FastLayout, tile: int = TILE) -> State:
    """Return the state before the first step."""
    registers = layout.tables.chunks.registers.reshape(-1)
    at_rest = (layout.tables.chunks.registers[:, BIAS] == 0).min(axis=1)
    chunks = len(at_rest)
    due = len(layout.tables.links.due_late)
    charge = aligned((tile + due, chunks * LANES), registers.dtype)
    touched = np.zeros((tile + due, chunks), dtype=np.uint8)
    current = aligned(registers.shape, registers.dtype)
    current[:] = registers
    return State(current, charge, touched, at_rest.copy(), registers, at_rest, due)


def workspace(layout: FastLayout, tile: int = TILE) -> Workspace:
    """Return room for the spikes of a tile."""
    first_of_node = layout.tables.nodes.first
    nodes = len(first_of_node)
    return Workspace(
        masks=np.zeros((tile, len(layout.tables.chunks.node)), dtype=np.int32),
        event=np.empty(tile * layout.columns + LANES * nodes, dtype=np.int32),
        list_start=tile * first_of_node + LANES * np.arange(nodes),
        begin=np.zeros((tile + 1, nodes), dtype=np.int64),
        updated=np.zeros(tile, dtype=np.uint8),
        row_of=np.empty(MOST_LISTED + LANES, dtype=np.int32),
    )


@compiled
def reset(state):  # type: ignore[no-untyped-def]
    """Go back to before the first step."""
    # Loops: each assignment of a whole array would take a second to compile.
    for k in range(len(state.registers)):
        state.registers[k] = state.first_registers[k]
    for k in range(len(state.at_rest)):
        state.at_rest[k] = state.first_at_rest[k]
    for r in range(state.due):
        _clear(state.charge, r)
        _clear(state.touched, r)


@inner
def _clear(array, row):  # type: ignore[no-untyped-def]
    for k in range(array.shape[1]):
        array[row, k] = 0


@inner
def _move_row(array, row, to):  # type: ignore[no-untyped-def]
    """Move a row to another; return whether anything in it was not 0."""
    anything = False
    for k in range(array.shape[1]):
        anything |= array[row, k] != 0
        array[to, k] = array[row, k]
        array[row, k] = 0
    return anything


@absorbed
def move_on(state, rows):  # type: ignore[no-untyped-def]
    """Move what is due after a tile to the front; the rows behind it start empty. Charges of the tile are all taken."""
    for r in range(state.due):
        if _move_row(state.touched, r + rows, r):
            _move_row(state.charge, r + rows, r)
    for r in range(state.due, rows):
        _clear(state.touched, r)
