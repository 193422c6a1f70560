"""Keep a transposed phase up to date while events arrive: only the steps from the first changed one on run again.

A recording is played to such a phase channel by channel, so an event changes the input of one step, and everything
after it. Charges, states after every step and spikes are kept. A block runs again from the first step whose charge has
changed; a spike that comes or goes changes charges of later steps by its weights, which starts the next block.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from hw_model.engine.chunks import (
    add_multiple,
    add_up,
    advance,
    advance_pair,
    copy_current_and_voltage,
    copy_state,
    pass_on,
)
from hw_model.engine.compiled import absorbed, compiled, entry, inner, trailing_zeros
from hw_model.engine.layout import (
    BIAS,
    BLOCKED,
    FIELDS,
    LANES,
    LIST,
    MATRIX,
    POTENTIAL,
    REFRACTORY,
    FastLayout,
    U,
    aligned,
)
from hw_model.mapping.graph import Input
from hw_model.streaming.time_phase import Read
from hw_model.values import AnyArray, ByteArray


class Visits(NamedTuple):
    """When the channels of every input are played: its first one, (inputs + 1,), and the ``rows`` it takes, (inputs,).

    ``step`` and ``first_line`` (channels of all inputs,): an event of row t is line ``first_line + t`` in that step.
    """

    first_channel: AnyArray
    step: AnyArray
    first_line: AnyArray
    rows: AnyArray


class Order(NamedTuple):
    """Chunks in the order of their updates, bundle by bundle, (members,) each; :class:`hw_model.engine.layout.Chunks`.

    ``parent`` is a member; ``forgets``: nothing is kept from step to step; ``never_rests``: there is a bias;
    ``is_pair``: the first of two dendrites whose sum is all that the third member is, and which keeps nothing;
    ``read``: its potentials are kept. Node n is the source of the links ``link[link_of[n]:link_of[n + 1]]``.
    """

    member: AnyArray
    begins: AnyArray
    parent: AnyArray
    sums: AnyArray
    forgets: AnyArray
    never_rests: AnyArray
    is_pair: AnyArray
    read: AnyArray
    link: AnyArray
    link_of: AnyArray


class History(NamedTuple):
    """Every step of a phase: ``charge`` (steps, slots), ``masks`` (steps, chunks) the spikes as bits.

    ``after`` (steps, members, :data:`KEPT`) are the registers after it; ``reached`` (steps, chunks) marks charges that
    ever changed; ``spikes`` (columns,) counts spikes, or holds the largest potential of a column that is read, of
    ``potential`` (steps, slots); ``changed`` (blocks,) is the first step with another charge, or the number of steps;
    ``run`` (1,) how many steps of blocks have been run; ``block_of`` (nodes,), ``slot`` (columns,).
    """

    charge: AnyArray
    after: AnyArray
    masks: AnyArray
    reached: AnyArray
    spikes: AnyArray
    changed: AnyArray
    run: AnyArray
    block_of: AnyArray
    potential: AnyArray
    slot: AnyArray


KEPT = (BLOCKED + 1 - U) * LANES
"""Numbers of a chunk's state: u, v, potential and blocked, which lie side by side."""
_ZERO, _ONE = np.int64(0), np.int64(1)
"""Of a type, as variables are: loops are compiled anew for each literal that they are called with."""
_LANES, _CHUNK, _STATE = np.uint64(LANES), np.uint64(FIELDS * LANES), np.uint64(U * LANES)
_POTENTIAL = np.uint64(POTENTIAL * LANES)


class Replay:
    """A phase of ``steps`` steps that starts with no event at all; rows of a recording are then added to it.

    ``inputs``: those of the phase, all of them transposed.
    """

    def __init__(self, layout: FastLayout, steps: int, inputs: Sequence[Input], read: Read) -> None:
        chunks, blocks = layout.chunks, len(layout.chunks.feeds_itself)
        slots = len(chunks.node) * LANES
        block_of = np.full(len(layout.nodes.first), -1, dtype=np.int64)
        for block in range(blocks):
            low, high = chunks.bundle[chunks.of_block[block : block + 2]]
            block_of[chunks.node[chunks.member[low:high]]] = block
        self._layout, self._steps = layout, steps
        dtype = chunks.registers.dtype
        self._history = History(
            charge=aligned((steps, slots), dtype), after=aligned((steps, len(chunks.node), KEPT), dtype),
            masks=np.zeros((steps, len(chunks.node)), np.int32), reached=np.zeros((steps, len(chunks.node)), np.uint8),
            spikes=np.zeros(layout.columns, np.int64), changed=np.zeros(blocks, np.int64), run=np.zeros(1, np.int64),
            block_of=block_of, potential=np.zeros((steps if len(read.columns) else 0, slots), dtype), slot=layout.slot,
        )  # fmt: skip
        visits, registers = _visits(inputs), aligned((chunks.registers.size,), dtype)
        registers[:] = chunks.registers[chunks.member].reshape(-1)
        self._played = (
            visits, read, layout.nodes, chunks, layout.links, _order(layout, read),
            registers, np.zeros(len(chunks.member), dtype=np.bool_), self._history,
        )  # fmt: skip
        self._silence = np.zeros((1, len(visits.step)), dtype=np.uint8)
        self._push = entry(_push, 0, self._silence, *self._played, np.zeros((1, layout.columns), dtype=np.int64))
        self.reset()

    def reset(self) -> None:
        """Go back to before the first row."""
        self._start = 0
        # Registers after a step are read only where a run has written them, and the first run writes all.
        for array in (self._history.charge, self._history.masks, self._history.reached, self._history.spikes):
            array[:] = 0
        self._history.changed[:] = 0
        self.push(0, self._silence)
        self._history.run[0] = 0

    def wait(self, rows: ByteArray) -> AnyArray:
        """Leave rows out that come before the first one that is played, and return what every column gives so far."""
        self._start += len(rows)
        return self._add(0, np.zeros_like(rows))

    def push(self, before: int, rows: ByteArray) -> AnyArray:
        """Add rows from row ``before`` on, (rows, channels), side by side in memory and writeable.

        Return what every column gives so far after each, (rows, columns): its spikes or, if read, largest potential.
        """
        return self._add(before - self._start, rows)

    def _add(self, time: int, rows: ByteArray) -> AnyArray:
        counts = np.empty((len(rows), self._layout.columns), dtype=np.int64)
        self._push(time, rows, *self._played, counts)
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


def _visits(inputs: Sequence[Input]) -> Visits:
    steps = [np.zeros(0, dtype=np.int64) if item.positions is None else item.positions for item in inputs]
    lines = [
        np.zeros(item.channels, dtype=np.int64) if item.first_lines is None else item.first_lines for item in inputs
    ]
    return Visits(
        first_channel=np.cumsum([0, *map(len, steps)]),
        step=np.concatenate(steps),
        first_line=np.concatenate(lines),
        rows=np.array([item.rows for item in inputs]),
    )


def _order(layout: FastLayout, of: Read) -> Order:
    chunks = layout.chunks
    member, count = chunks.member, len(chunks.member)
    place = np.full(count + 1, -1, dtype=np.int64)  # the last is the place of no chunk
    place[member] = np.arange(count)
    parent, sums = place[chunks.parent[member]], chunks.sums[member].astype(np.bool_)
    read = np.isin(member, layout.slot[of.columns] // LANES)
    forgets = sums & (chunks.registers[member][:, REFRACTORY].max(axis=1) <= 1)
    is_pair = chunks.pair.copy()
    for low, high in pairwise(chunks.bundle.tolist()):
        is_pair[low] &= not read[low:high].any()  # a pair is run without a potential of its own
    never_rests = (chunks.registers[member][:, BIAS] != 0).max(axis=1)
    link = np.argsort(layout.links.source, kind="stable")
    link_of = np.searchsorted(layout.links.source[link], np.arange(len(layout.nodes.first) + 1))
    return Order(member, chunks.begins, parent, sums, forgets, never_rests, is_pair, read, link, link_of)


@compiled
def _push(  # type: ignore[no-untyped-def]
    before, rows, visits, read, nodes, chunks, links, order, registers, at_rest, history, counts
):
    steps = len(history.masks)
    for row in range(len(rows)):
        time = before + row
        for node in range(len(visits.rows)):
            for channel in range(visits.first_channel[node], visits.first_channel[node + 1]):
                if rows[row, channel] and time < visits.rows[node]:
                    line = visits.first_line[channel] + time
                    for index in range(order.link_of[node], order.link_of[node + 1]):
                        _change(np.uint64(order.link[index]), line, visits.step[channel], _ONE, links, history)
        ran = False
        for block in range(len(history.changed)):
            start = history.changed[block]
            if start < steps:
                history.changed[block] = steps
                _run_again(block, start, nodes, chunks, links, order, registers, at_rest, history)
                ran = True
        if ran:
            for j in range(len(read.columns)):
                history.spikes[read.columns[j]] = _largest(read.columns[j], read.first[j], history)
        for column in range(counts.shape[1]):
            counts[row, column] = history.spikes[column]


@absorbed
def _largest(column, first, history):  # type: ignore[no-untyped-def]
    """Return the largest potential of a column from step ``first`` on; of no steps, 0."""
    slot, steps = history.slot[column], len(history.potential)
    largest = history.potential[first, slot] if first < steps else 0
    for step in range(first + 1, steps):
        largest = max(largest, history.potential[step, slot])
    return largest


@absorbed
def _change(link, source, step, sign, links, history):  # type: ignore[no-untyped-def]
    """Add, or take away, the charges of a spike in ``step``, and note from where on the target has to run again."""
    block = np.uint64(history.block_of[links.target_node[link]])
    steps = len(history.masks)
    if links.kind[link] == MATRIX:
        at = step + 1 + links.delay[link]
        if at < steps:
            due = np.uint64(at)
            begin = np.uint64(links.offset[link] + source * links.width[link])
            low, many = np.uint64(links.target[link]), np.uint64(links.width[link])
            for j in range(np.uint64(0), many, _LANES):
                add_multiple(history.charge, due, low + j, links.matrix, begin + j, sign)
            history.changed[block] = min(history.changed[block], at)
            for chunk in range(low // _LANES, (low + many) // _LANES):
                history.reached[due, chunk] = 1
    else:
        row, form = links.offset[link] + source, _form_of(link, links)
        for k in range(np.uint64(links.list_start[row]), np.uint64(links.list_start[row + 1])):
            late, slot, weight = _synapse(form, k, links)
            at = step + 1 + late
            if at < steps:
                due = np.uint64(at)
                history.charge[due, slot] += sign * weight
                history.changed[block] = min(history.changed[block], at)
                history.reached[due, slot // _LANES] = 1


@absorbed
def _form_of(link, links):  # type: ignore[no-untyped-def]
    """Return how the lists of a link are held, for :func:`_synapse`: loops read it once."""
    return (
        links.kind[link] != LIST, links.target[link], links.delay[link], links.slot_bits[link],
        links.late_bits[link], links.weight_shift[link],
    )  # fmt: skip


@absorbed
def _synapse(form, k, links):  # type: ignore[no-untyped-def]
    """Return delay, slot and weight of synapse k of a list."""
    packed, low, delay, slot_bits, late_bits, shift = form
    if not packed:
        return np.int64(links.late[k]), np.uint64(links.slot[k]), np.int64(links.weight[k])
    word = np.int64(links.packed[k])
    late, slot = (word >> slot_bits) & ((1 << late_bits) - 1), word & ((1 << slot_bits) - 1)
    return delay + late, np.uint64(low + slot), (word >> (slot_bits + late_bits)) << shift


@inner
def _run_again(  # type: ignore[no-untyped-def]
    block, start, nodes, chunks, links, order, registers, at_rest, history
):
    """Run a block from step ``start`` on; spikes that come or go change what is due later, here and elsewhere."""
    low, high = chunks.bundle[chunks.of_block[block]], chunks.bundle[chunks.of_block[block + 1]]
    for member in range(low, high):
        index = np.uint64(member)
        if start > 0:
            copy_state(registers, index * _CHUNK + _STATE, history.after, start - 1, index, _ZERO)
        else:
            for i in range(np.uint64(KEPT)):
                registers[index * _CHUNK + _STATE + i] = 0
        at_rest[index] = False
    for row in range(start, len(history.masks)):
        step = np.uint64(row)
        stirred = False
        member = low
        while member < high:
            index = np.uint64(member)
            if order.is_pair[index]:
                mask = _run_pair(step, index, chunks.widths, order, registers, at_rest, history)
                member += 3
            else:
                stirred &= not order.begins[index]
                mask, stirred = _run_member(step, index, stirred, chunks.widths, order, registers, at_rest, history)
                member += 1
            k = np.uint64(order.member[np.uint64(member - 1)])
            if mask != history.masks[step, k]:
                _flip(row, k, mask, nodes, chunks, links, order, history)
    history.changed[block] = len(history.masks)
    history.run[0] += len(history.masks) - start


@absorbed
def _run_pair(step, index, widths, order, registers, at_rest, history):  # type: ignore[no-untyped-def]
    """Update two dendrites and their sum in one step; return the spikes as bits."""
    one, other = np.uint64(order.member[index]), np.uint64(order.member[index + np.uint64(1)])
    at = index * _CHUNK
    mask = np.int32(0)
    if not at_rest[index] or history.reached[step, one] or history.reached[step, other]:
        mask, remains = advance_pair(
            registers, at, history.charge, step, one * _LANES, history.charge, step, other * _LANES, widths
        )
        at_rest[index] = remains == 0 and not order.never_rests[index] and not order.never_rests[index + np.uint64(1)]
    copy_current_and_voltage(history.after, step, index, _ZERO, registers, at + _STATE)
    copy_current_and_voltage(history.after, step, index + np.uint64(1), _ZERO, registers, at + _CHUNK + _STATE)
    return mask


@absorbed
def _run_member(step, index, stirred, widths, order, registers, at_rest, history):  # type: ignore[no-untyped-def]
    """Update one chunk in one step; return the spikes as bits, and whether its bundle is stirred now."""
    k, at = np.uint64(order.member[index]), index * _CHUNK
    mask = np.int32(0)
    runs = not at_rest[index] or history.reached[step, k] or stirred
    if runs:
        if order.sums[index]:
            mask, _, remains = add_up(registers, at)
        else:
            mask, remains = advance(registers, at, history.charge, step, k * _LANES, widths)
        at_rest[index] = remains == 0 and not order.never_rests[index]
        stirred = True
        if order.parent[index] >= 0:
            pass_on(registers, at, registers, np.uint64(order.parent[index]) * _CHUNK)
    if order.read[index]:
        for i in range(_LANES):
            history.potential[step, k * _LANES + i] = registers[at + _POTENTIAL + i] if runs else 0
    if not order.forgets[index]:
        copy_state(history.after, step, index, _ZERO, registers, at + _STATE)
    return mask, stirred


@absorbed
def _flip(step, k, mask, nodes, chunks, links, order, history):  # type: ignore[no-untyped-def]
    """Note the spikes of a chunk in a step, and change what those that came or went make due."""
    flipped = np.uint64(np.uint32(mask ^ history.masks[step, k]))
    history.masks[step, k] = mask
    node = chunks.node[k]
    first_link, end = order.link_of[node], order.link_of[node + 1]
    while flipped:
        lane = trailing_zeros(flipped)
        flipped &= flipped - np.uint64(1)
        sign = 1 if (mask >> lane) & 1 else -1
        column = chunks.first_column[k] + lane
        history.spikes[column] += sign
        for index in range(first_link, end):
            _change(np.uint64(order.link[index]), column - nodes.first[node], step, sign, links, history)
