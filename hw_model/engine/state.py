"""The memory of the fast engine's loops: state between steps, workspace, and the inputs and outputs of a tile.

A *tile* is a run of consecutive steps, its *rows*. :mod:`hw_model.engine.layout` explains the other
words. Charges are in units of 64, as in :mod:`hw_model.arithmetic.loihi`.
"""

from typing import NamedTuple

import numpy as np

from hw_model.engine import packed
from hw_model.engine.compiled import absorbed, compiled, inner
from hw_model.engine.layout import BIAS, LANES, FastLayout, aligned
from hw_model.values import AnyArray

TILE = 64
"""Steps that one block runs before the next block does, so that their charges stay in the cache; chosen by hand
(``docs/development/decisions/0006-blocks-over-tiles.md``)."""
MOST_LISTED = 1 << 14
"""The most spikes that are delivered in one loop: all that 256 sources can send in a tile. It limits the memory for
their rows to 64 KiB; chosen by hand."""


class State(NamedTuple):
    """The state of a phase between two steps.

    - ``registers``: those of all chunks, flat: chunk by chunk, field by field, lane by lane
    - ``charge`` (rows, slots): the charges that are due in each row of the tile and, behind them, after it
    - ``touched`` (rows, chunks): whether a charge may be due in a chunk
    - ``at_rest`` (chunks,): whether the state of a chunk is 0 and it has no bias, so that only charges can change it
    - ``first_registers`` and ``first_at_rest``: the same before the first step
    - ``due``: rows that the longest delay reaches beyond a tile. Between tiles only the first ``due`` rows hold charges
    """

    registers: AnyArray
    charge: AnyArray
    touched: AnyArray
    at_rest: AnyArray
    first_registers: AnyArray
    first_at_rest: AnyArray
    due: int


class Workspace(NamedTuple):
    """Arrays that are only used within a tile.

    - ``masks`` (rows, chunks): the spikes of each chunk as bits
    - ``event``, ``list_start``, ``begin``: lists of spikes. Those of node n in row r are ``event[list_start[n] + e]``
      with ``begin[r, n] <= e < begin[r + 1, n]``, numbers of compartments within the node
    - ``updated`` (rows,): whether anything could change in a row
    - ``row_of``: the row of each spike, for spikes that are delivered in one loop
    """

    masks: AnyArray
    event: AnyArray
    list_start: AnyArray
    begin: AnyArray
    updated: AnyArray
    row_of: AnyArray


class Paths(NamedTuple):
    """Addresses of loops that not every phase needs, or 0: what a phase does not need is not compiled."""

    by_lists: int | np.int64
    by_rows: int | np.int64


NO_PATHS = Paths(by_lists=0, by_rows=0)


class Memory(NamedTuple):
    """Everything that the loops write to besides their results, and the addresses of further loops."""

    state: State
    work: Workspace
    paths: Paths


class Tile(NamedTuple):
    """A tile: ``rows`` steps from ``step`` on. With ``skip``, updates that cannot change anything are left out."""

    step: int | np.int64
    rows: int | np.int64
    skip: bool | np.bool_


class Arriving(NamedTuple):
    """Input events of a tile: those of row r and input i are ``line[first[r, i]:first[r + 1, i]]``."""

    first: AnyArray
    line: AnyArray


class KeptRegister(NamedTuple):
    """Where a register is recorded: its value in column c at step t goes to ``rows[recording, t - start, place[c]]``.

    ``rows`` is (batch, steps, recorded columns). A column with place -1, and steps outside, are not recorded.
    """

    place: AnyArray
    start: int
    rows: AnyArray


class Kept(NamedTuple):
    """Which registers are recorded; ``watched``: whether any is."""

    watched: bool
    u: KeptRegister
    v: KeptRegister
    potential: KeptRegister


class Written(NamedTuple):
    """The results of a tile of one recording, whose number in the batch is ``recording``.

    ``spikes`` (rows, n) are 0 and 1; ``sent`` (lines + n,) counts the spikes of each source, and
    ``active`` (rows, pieces) the compartments that had anything to work on.
    """

    spikes: AnyArray
    sent: AnyArray
    active: AnyArray
    recording: int | np.int64
    kept: packed.Packed[Kept]


NO_REGISTER = KeptRegister(np.empty(0, dtype=np.int64), 0, np.empty((1, 0, 0), dtype=np.int64))
NOTHING_KEPT = packed.pack(Kept(watched=False, u=NO_REGISTER, v=NO_REGISTER, potential=NO_REGISTER))


def first_state(layout: FastLayout, tile: int = TILE) -> State:
    """Return the state before the first step."""
    registers = layout.tables.chunks.registers.reshape(-1)
    at_rest = (layout.tables.chunks.registers[:, BIAS] == 0).min(axis=1)
    chunks = len(at_rest)
    due = len(layout.tables.links.due_late)
    charge = aligned((tile + due, chunks * LANES), registers.dtype)
    touched = np.zeros((tile + due, chunks), dtype=np.uint8)
    # A copy, at a cache line: the loops change it, and `reset` needs the original.
    registers_now = aligned(registers.shape, registers.dtype)
    registers_now[:] = registers
    return State(registers_now, charge, touched, at_rest.copy(), registers, at_rest, due)


def workspace(layout: FastLayout, tile: int = TILE) -> Workspace:
    """Return room for the spikes of a tile."""
    first_of_node = layout.tables.nodes.first
    nodes = len(first_of_node)
    # A node lists at most a spike per compartment and row. A list is written a whole chunk of lanes at a time, spiking
    # or not, so there are LANES entries of room behind each node's.
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
    """Set a state back to before the first step."""
    # Loops instead of whole-array assignments, each of which would take a second to compile.
    for k in range(len(state.registers)):
        state.registers[k] = state.first_registers[k]
    for k in range(len(state.at_rest)):
        state.at_rest[k] = state.first_at_rest[k]
    for r in range(state.due):
        _clear(state.charge, r)
        _clear(state.touched, r)


@inner
def _clear(array, row):  # type: ignore[no-untyped-def]
    """Set a row to 0."""
    for k in range(array.shape[1]):
        array[row, k] = 0


@inner
def _move_row(array, row, to):  # type: ignore[no-untyped-def]
    """Move a row to another; return whether any_nonzero in it was not 0."""
    any_nonzero = False
    for k in range(array.shape[1]):
        any_nonzero |= array[row, k] != 0
        array[to, k] = array[row, k]
        array[row, k] = 0
    return any_nonzero


@absorbed
def move_on(state, rows):  # type: ignore[no-untyped-def]
    """Prepare for the next tile: move the charges due after this tile to the front, and clear the rows behind them.

    The updates of the tile have set all its charges to 0.
    """
    for r in range(state.due):
        # Rows without a touched chunk have no charges: there is nothing to move.
        if _move_row(state.touched, r + rows, r):
            _move_row(state.charge, r + rows, r)
    for r in range(state.due, rows):
        _clear(state.touched, r)
