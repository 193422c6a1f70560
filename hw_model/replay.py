"""Keep a transposed phase up to date while events arrive: only the steps from the first changed one on run again.

A recording is played to such a phase channel by channel, so an event changes the input of one step, and everything
after it. Charges, states after every step and spikes are kept. A block runs again from the first step whose charge has
changed; a spike that comes or goes changes charges of later steps by its weights, which starts the next block.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hw_model.compiled import absorbed, borrowed, compiled, trailing_zeros
from hw_model.fast_kernels import AnyArray, add_up, advance, first_state, pass_on
from hw_model.fast_layout import BIAS, BLOCKED, FIELDS, LANES, REFRACTORY, FastLayout, U


class History(NamedTuple):
    """Every step of a phase: ``after`` (steps, chunks, :data:`KEPT`) registers, ``masks`` (steps, chunks) spike bits.

    ``reached`` (steps, chunks) marks charges that ever changed; ``spikes`` (columns,) counts spikes; ``changed``
    (blocks,) is the first step with another charge, or the number of steps; ``run`` (1,) how many steps of blocks have
    been run; ``block_of`` (nodes,); ``forgets`` (chunks,): what keeps nothing from step to step; ``never_rests``.
    """

    after: AnyArray
    masks: AnyArray
    reached: AnyArray
    spikes: AnyArray
    changed: AnyArray
    run: AnyArray
    block_of: AnyArray
    forgets: AnyArray
    never_rests: AnyArray


KEPT = (BLOCKED + 1 - U) * LANES
"""Numbers of a chunk's state: u, v, potential and blocked, which lie side by side."""


class Replay:
    """A phase of ``steps`` steps that starts with no event at all; events of input ``node`` are then added to it."""

    def __init__(self, layout: FastLayout, steps: int) -> None:
        blocks, chunks = len(layout.chunks.feeds_itself), len(layout.chunks.node)
        block_of = np.full(len(layout.nodes.first), -1, dtype=np.int64)
        for block in range(blocks):
            bundles = layout.chunks.of_block[block : block + 2]
            low, high = layout.chunks.bundle[bundles]
            block_of[layout.chunks.node[layout.chunks.member[low:high]]] = block
        self._layout, self._steps = layout, steps
        self._state = first_state(layout, steps)
        registers = layout.chunks.registers
        self._history = History(
            after=np.zeros((steps, chunks, KEPT), dtype=np.int32),
            masks=np.zeros((steps, chunks), dtype=np.int32),
            reached=np.zeros((steps, chunks), dtype=np.uint8),
            spikes=np.zeros(layout.columns, dtype=np.int64),
            changed=np.zeros(blocks, dtype=np.int64),
            run=np.zeros(1, dtype=np.int64),
            block_of=block_of,
            forgets=layout.chunks.sums.astype(np.bool_) & (registers[:, REFRACTORY].max(axis=1) <= 1),
            never_rests=(registers[:, BIAS] != 0).max(axis=1),
        )
        none = np.empty(0, dtype=np.int64)
        self.push(none, none, none, np.zeros(2, dtype=np.int64))
        self._history.run[0] = 0

    def push(self, node: AnyArray, line: AnyArray, position: AnyArray, first: AnyArray) -> AnyArray:
        """Add events: of row r those from ``first[r]`` on; return the spike counts after each row, (rows, columns)."""
        layout = self._layout
        counts = np.empty((len(first) - 1, layout.columns), dtype=np.int64)
        _push(
            node, line, position, first, layout.nodes, layout.chunks, layout.links, self._state, self._history,
            counts,
        )  # fmt: skip
        return counts

    @property
    def steps_run(self) -> int:
        """Steps of blocks run so far; running all of them again for a row takes :attr:`steps_of_all`."""
        return int(self._history.run[0])

    @property
    def steps_of_all(self) -> int:
        """Steps of blocks in one run of the phase."""
        return self._steps * len(self._history.changed)

    def spikes(self) -> AnyArray:
        """Return the spikes of every step, (steps, columns) of 0 and 1."""
        lanes = (self._history.masks[:, :, None] >> np.arange(LANES)) & 1
        return lanes.reshape(self._steps, -1)[:, self._layout.slot].astype(np.uint8)


@compiled
def _push(  # type: ignore[no-untyped-def]
    node, line, position, first, nodes, chunks, links, state, history, counts
):
    node, line, position, nodes, chunks, links, state, history = borrowed(
        (node, line, position, nodes, chunks, links, state, history)
    )
    steps = len(history.masks)
    for row in range(len(counts)):
        for e in range(first[row], first[row + 1]):
            for link in range(len(links.source)):
                if links.source[link] == node[e]:
                    _change(link, line[e], position[e], 1, chunks, links, state, history)
        for block in range(len(history.changed)):
            start = history.changed[block]
            if start < steps:
                history.changed[block] = steps
                _run_again(block, start, nodes, chunks, links, state, history)
        counts[row] = history.spikes


@absorbed
def _change(link, source, step, sign, chunks, links, state, history):  # type: ignore[no-untyped-def]
    """Add, or take away, the charges of a spike in ``step``, and note from where on the target has to run again."""
    block = history.block_of[links.target_node[link]]
    if links.dense[link]:
        at = step + 1 + links.delay[link]
        if at < len(history.masks):
            begin = np.uint64(links.offset[link] + source * links.width[link])
            low = np.uint64(links.target[link])
            for j in range(np.uint64(links.width[link])):
                state.charge[at, low + j] += sign * links.matrix[begin + j]
            history.changed[block] = min(history.changed[block], at)
            for chunk in range(low // np.uint64(LANES), (low + np.uint64(links.width[link])) // np.uint64(LANES)):
                history.reached[at, chunk] = 1
    else:
        row = links.offset[link] + source
        for k in range(links.list_start[row], links.list_start[row + 1]):
            at = step + 1 + links.late[k]
            if at < len(history.masks):
                state.charge[at, links.slot[k]] += sign * links.weight[k]
                history.changed[block] = min(history.changed[block], at)
                history.reached[at, links.slot[k] // LANES] = 1


@compiled
def _run_again(block, start, nodes, chunks, links, state, history):  # type: ignore[no-untyped-def]
    """Run a block from step ``start`` on; spikes that come or go change what is due later, here and elsewhere."""
    low, high = chunks.bundle[chunks.of_block[block]], chunks.bundle[chunks.of_block[block + 1]]
    at_rest = state.at_rest
    for index in range(low, high):
        k = chunks.member[index]
        _load(state.registers, k, history.after[max(start - 1, 0), k], start > 0)
        at_rest[k] = False
    steps = len(history.masks)
    for step in range(start, steps):
        stirred = False
        for index in range(low, high):
            k = np.uint64(chunks.member[index])
            at = np.uint64(k * np.uint64(FIELDS * LANES))
            stirred &= not chunks.begins[index]
            mask = np.int32(0)
            if not at_rest[k] or history.reached[step, k] or stirred:
                if chunks.sums[k]:
                    mask, _, restless = add_up(state.registers, at)
                    at_rest[k] = restless == 0
                else:
                    mask, remains = advance(state.registers, at, state.charge, np.uint64(step), k * np.uint64(LANES))
                    at_rest[k] = remains == 0 and not history.never_rests[k]
                    stirred |= not at_rest[k]
                if chunks.parent[k] >= 0:
                    pass_on(state.registers, at, np.uint64(chunks.parent[k] * FIELDS * LANES))
            if not history.forgets[k]:
                for i in range(np.uint64(KEPT)):
                    history.after[step, k, i] = state.registers[at + np.uint64(U * LANES) + i]
            flipped = np.uint64(np.uint32(mask ^ history.masks[step, k]))
            history.masks[step, k] = mask
            while flipped:
                lane = trailing_zeros(flipped)
                flipped &= flipped - np.uint64(1)
                sign = 1 if (mask >> lane) & 1 else -1
                column = chunks.first_column[k] + lane
                history.spikes[column] += sign
                node = chunks.node[k]
                for link in range(len(links.source)):
                    if links.source[link] == node:
                        _change(link, column - nodes.first[node], step, sign, chunks, links, state, history)
    history.changed[block] = steps
    history.run[0] += steps - start


@absorbed
def _load(registers, k, kept, any_step):  # type: ignore[no-untyped-def]
    """Set the state of a chunk to what it was after a step, or to rest before the first."""
    at = np.uint64(k * FIELDS * LANES + U * LANES)
    for i in range(np.uint64(KEPT)):
        registers[at + i] = kept[i] if any_step else 0
