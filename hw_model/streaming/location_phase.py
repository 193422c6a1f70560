"""Keep a transposed phase up to date while events arrive: only the steps from the first changed one on run again.

A recording is played to such a phase channel by channel, so an event changes the input of one step, and everything
after it. Charges, states after every step and spikes are kept. A block runs again from the first step whose charge has
changed; a spike that comes or goes changes charges of later steps by its weights, which starts the next block.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hw_model.engine import packed
from hw_model.engine.chunks import (
    add_multiple,
    advance,
    advance_pair,
    change_echo,
    copy_state,
    count_changes,
    list_flips,
    pass_on,
)
from hw_model.engine.compiled import absorbed, address, call_at, compiled, entry, inner, shared
from hw_model.engine.layout import (
    FIELDS,
    KEPT_FIELDS,
    LANES,
    MATRIX,
    POTENTIAL,
    WIDE_LIST,
    FastLayout,
    Tables,
    U,
    aligned,
)
from hw_model.engine.packed import Packed
from hw_model.mapping.graph import Input
from hw_model.streaming.time_phase import Read
from hw_model.values import AnyArray, ByteArray, IntArray


class Visits(NamedTuple):
    """When the channels of every input are played: its first one, (inputs + 1,), and the ``rows`` it takes, (inputs,).

    ``step`` and ``first_line`` (channels of all inputs,): an event of row t is line ``first_line + t`` in that step.
    """

    first_channel: AnyArray
    step: AnyArray
    first_line: AnyArray
    rows: AnyArray


class Order(NamedTuple):
    """How members, chunks in the order of their updates, are run: :class:`hw_model.engine.layout.Chunks`.

    ``parent`` (members,) is a member; ``is_pair`` (members,): the first of two dendrites whose sum is all that the
    third member is, and which keeps nothing; ``read_at`` (columns read,): where the potential of each lies in a state.
    Node n is the source of the links ``link[link_of[n]:link_of[n + 1]]``.
    """

    parent: AnyArray
    is_pair: AnyArray
    read_at: AnyArray
    link: AnyArray
    link_of: AnyArray


class History(NamedTuple):
    """Every step of a phase: ``charge`` (steps, slots), ``masks`` (steps, chunks) the spikes as bits.

    ``flips`` (steps, chunks): the spikes that came or went when its block last ran; ``event`` and ``row_of`` have room
    for those of a node as a list, by source, which is ``~source`` where it went, and step. ``before`` (steps + 1, state
    of all members) are the states before each step, and in the end; ``spikes`` (slots,) counts spikes, or holds the
    largest potential of a column that is read; ``changed`` (blocks,) is the first step with another charge, or the
    number of steps; ``run`` (1,) how many steps of blocks have been run; ``block_of`` (nodes,), ``slot`` (columns,).
    """

    charge: AnyArray
    before: AnyArray
    masks: AnyArray
    flips: AnyArray
    event: AnyArray
    row_of: AnyArray
    spikes: AnyArray
    changed: AnyArray
    run: AnyArray
    block_of: AnyArray
    slot: AnyArray


class _Phase(NamedTuple):
    """All that the loop over rows reads and writes; ``registers`` are those of the chunks, in the order of updates.

    ``by_pairs``: where the code of :func:`_run_pair` lies; 0 where there are no pairs, so that it need not be compiled.
    """

    visits: Visits
    read: Read
    tables: Packed[Tables]
    order: Order
    registers: AnyArray
    history: History
    by_pairs: int | np.int64


_LANES, _CHUNK, _STATE = np.uint64(LANES), np.uint64(FIELDS * LANES), np.uint64(U * LANES)
_NO_STEP = np.uint64(0)
_NONE = np.int64(0)
"""Of a type, as a variable is: loops are compiled anew for each literal that they are called with."""
_ONE_MORE, _KEPT = np.uint64(1), np.uint64(KEPT_FIELDS * LANES)


class Replay:
    """A phase of ``steps`` steps that starts with no event at all; rows of a recording are then added to it.

    ``inputs``: those of the phase, all of them transposed.
    """

    def __init__(self, layout: FastLayout, steps: int, inputs: Sequence[Input], read: Read) -> None:
        self._layout = layout
        self._steps = steps
        self._history = _empty_history(layout, steps)
        visits = _visits(inputs)
        chunks = layout.tables.chunks
        registers = aligned((chunks.registers.size,), chunks.registers.dtype)
        registers[:] = chunks.registers[chunks.member].reshape(-1)
        order = _order(layout, read)
        phase = _Phase(visits, read, layout.packed_tables, order, registers, self._history, 0)
        if order.is_pair.any():
            phase = phase._replace(by_pairs=_by_pairs(phase))
        self._phase = packed.pack(phase)
        # A row without events, and room for what is noted after it.
        self._silence = np.zeros((1, len(visits.step)), dtype=np.uint8)
        self._columns = np.zeros((1, layout.columns), dtype=np.int64)
        self._push = entry(_push, 0, self._silence, self._phase, self._columns, 0)
        self.reset()

    def reset(self) -> None:
        """Go back to before the first row."""
        self._start = 0
        # States are read only where a run has written them, and the first run writes all but the first, which are 0.
        for array in (self._history.charge, self._history.masks, self._history.spikes):
            array[:] = 0
        self._history.changed[:] = 0
        self.push(0, self._silence, self._columns, 0)
        self._history.run[0] = 0

    def wait(self, rows: ByteArray, counts: IntArray, low: int) -> None:
        """Leave rows out that come before the first one that is played, and note what every column gives so far."""
        self._start += len(rows)
        self._push(0, np.zeros_like(rows), self._phase, counts, low)

    def push(self, before: int, rows: ByteArray, counts: IntArray, low: int) -> None:
        """Add rows from row ``before`` on, (rows, channels), side by side in memory and writeable.

        Note what every column gives so far after each, its spikes or, if read, largest potential, in ``counts`` (rows,
        columns of all phases), from column ``low`` on.
        """
        self._push(before - self._start, rows, self._phase, counts, low)

    @property
    def replayed(self) -> tuple[int, int]:
        """Steps of blocks run so far, and how many it would be to run all of them again for a row."""
        return int(self._history.run[0]), self._steps * len(self._history.changed)

    def spikes(self) -> AnyArray:
        """Return the spikes of every step, (steps, columns) of 0 and 1."""
        lanes = (self._history.masks[:, :, None] >> np.arange(LANES)) & 1
        return lanes.reshape(self._steps, -1)[:, self._layout.slot].astype(np.uint8)


def _by_pairs(phase: _Phase) -> np.int64:
    """Return where the code of :func:`_run_pair` lies."""
    return address(_run_pair, _NO_STEP, np.int64(1), _NO_STEP, packed.pack(phase))


def _visits(inputs: Sequence[Input]) -> Visits:
    steps = [item.visits[0] for item in inputs]
    first_lines = [item.visits[1] for item in inputs]
    return Visits(
        first_channel=np.cumsum([0, *map(len, steps)]),
        step=np.concatenate(steps),
        first_line=np.concatenate(first_lines),
        rows=np.array([item.rows for item in inputs]),
    )


def _empty_history(layout: FastLayout, steps: int) -> History:
    """Return room for every step of a phase that was never run."""
    chunks = layout.tables.chunks
    dtype = chunks.registers.dtype
    chunk_count = len(chunks.node)
    slots = chunk_count * LANES
    # A node may spike everywhere in every step; lists are written a vector of lanes at a time.
    most_events = steps * int(layout.tables.nodes.size.max()) + LANES
    return History(
        charge=aligned((steps, slots), dtype),
        before=aligned((steps + 1, slots * KEPT_FIELDS), dtype),
        masks=np.zeros((steps, chunk_count), np.int32),
        flips=np.zeros((steps, chunk_count), np.int32),
        event=np.empty(most_events, np.int32),
        row_of=np.empty(most_events, np.int32),
        spikes=aligned((slots,), dtype),
        changed=np.zeros(len(chunks.feeds_itself), np.int64),
        run=np.zeros(1, np.int64),
        block_of=_block_of_node(layout),
        slot=layout.slot,
    )


def _block_of_node(layout: FastLayout) -> IntArray:
    """Return the block of chunks that runs each node, (nodes,); -1 for inputs."""
    chunks = layout.tables.chunks
    block_of = np.full(len(layout.tables.nodes.first), -1, dtype=np.int64)
    for block in range(len(chunks.feeds_itself)):
        low, high = chunks.bundle[chunks.of_block[block : block + 2]]
        block_of[chunks.node[chunks.member[low:high]]] = block
    return block_of


def _order(layout: FastLayout, read_columns: Read) -> Order:
    chunks = layout.tables.chunks
    links = layout.tables.links
    slot = layout.slot[read_columns.columns]
    members = len(chunks.member)
    # By chunk, which member it is. The last is that of no chunk: a parent of -1 is read there.
    member_of_chunk = np.full(members + 1, -1, dtype=np.int64)
    member_of_chunk[chunks.member] = np.arange(members)
    bundle_start = chunks.bundle[:-1]
    # A pair is run with what its spikes pass to it in the next step, not later, and without a potential.
    is_pair = chunks.pair & (len(chunks.echo) == len(chunks.node) * LANES)
    is_read = np.isin(chunks.member, slot // LANES)
    is_pair[bundle_start] &= ~np.maximum.reduceat(is_read, bundle_start)
    by_source = np.argsort(links.source, kind="stable")
    nodes = len(layout.tables.nodes.first)
    potential_field = member_of_chunk[slot // LANES] * KEPT_FIELDS + POTENTIAL - U
    return Order(
        parent=member_of_chunk[chunks.parent[chunks.member]],
        is_pair=is_pair,
        read_at=potential_field * LANES + slot % LANES,
        link=by_source,
        link_of=np.searchsorted(links.source[by_source], np.arange(nodes + 1)),
    )


@compiled
def _push(before, rows, phase, counts, low):  # type: ignore[no-untyped-def]  # noqa: C901 - a compiled loop, whose calls cost
    """Add rows from row ``before`` on, and note what every column gives after each in ``counts``."""
    visits = phase.visits
    read = phase.read
    order = phase.order
    history = phase.history
    tables = phase.tables
    steps = len(history.masks)
    for row in range(len(rows)):
        time = before + row
        for node in range(len(visits.rows)):
            events = _NONE
            for channel in range(visits.first_channel[node], visits.first_channel[node + 1]):
                if rows[row, channel] and time < visits.rows[node]:
                    history.event[events] = visits.first_line[channel] + time
                    history.row_of[events] = visits.step[channel]
                    events += 1
            for index in range(order.link_of[node], order.link_of[node + 1]):
                _change(np.uint64(order.link[index]), events, tables.links, history)
        ran = False
        for block in range(len(history.changed)):
            start = history.changed[block]
            if start < steps:
                _run_again(block, start, phase)
                ran = True
        if ran:
            for j in range(len(read.columns)):
                history.spikes[history.slot[read.columns[j]]] = _largest(
                    order.read_at[j], read.first[j], history
                )
        for column in range(len(history.slot)):
            counts[row, low + column] = history.spikes[history.slot[column]]


@absorbed
def _largest(at, first, history):  # type: ignore[no-untyped-def]
    """Return the largest potential, ``at`` a place of a state, from step ``first`` on; of no steps, 0."""
    steps = len(history.masks)
    largest = history.before[first + 1, at] if first < steps else 0
    for step in range(first + 1, steps):
        largest = max(largest, history.before[step + 1, at])
    return largest


@absorbed
def _change(link, events, links, history):  # type: ignore[no-untyped-def]
    """Add, or take away, the charges of the spikes listed, and note from where on the target has to run again."""
    block = np.uint64(history.block_of[links.target_node[link]])
    steps = len(history.masks)
    first = history.changed[block]
    offset = links.offset[link]
    form = _form_of(link, links)
    is_matrix = links.kind[link] == MATRIX
    stride = links.width[link] if is_matrix else 1
    width = np.uint64(links.width[link])
    low = np.uint64(links.target[link])
    delay = links.delay[link]
    for e in range(np.uint64(events)):
        event = np.int64(history.event[e])
        sign = np.int64(1 if event >= 0 else -1)
        source = offset + (event if event >= 0 else ~event) * stride
        if is_matrix:
            at = history.row_of[e] + 1 + delay
            if at < steps:
                due = np.uint64(at)
                begin = np.uint64(source)
                for j in range(np.uint64(0), width, _LANES):
                    add_multiple(history.charge, due, low + j, links.matrix, begin + j, sign)
                first = min(first, at)
            continue
        for k in range(
            np.uint64(links.list_start[source]), np.uint64(links.list_start[source + 1])
        ):
            late, slot, weight = _synapse(form, k, links)
            at = history.row_of[e] + 1 + late
            if at < steps:
                history.charge[np.uint64(at), slot] += sign * weight
                first = min(first, at)
    history.changed[block] = first


@absorbed
def _form_of(link, links):  # type: ignore[no-untyped-def]
    """Return how the lists of a link are held, for :func:`_synapse`: loops read it once."""
    return (
        links.kind[link] == WIDE_LIST, links.target[link], links.delay[link], links.slot_bits[link],
        links.late_bits[link], links.weight_shift[link],
    )  # fmt: skip


@absorbed
def _synapse(form, k, links):  # type: ignore[no-untyped-def]
    """Return delay, slot and weight of synapse k of a list."""
    is_wide, low, delay, slot_bits, late_bits, shift = form
    word = links.wide_word[k] if is_wide else np.int64(links.word[k])
    late = (word >> slot_bits) & ((1 << late_bits) - 1)
    slot = word & ((1 << slot_bits) - 1)
    return delay + late, np.uint64(low + slot), (word >> (slot_bits + late_bits)) << shift


@inner
def _run_again(block, start, phase):  # type: ignore[no-untyped-def]
    """Run a block from step ``start`` on; spikes that come or go change what is due later, here and elsewhere."""
    tables = phase.tables
    order = phase.order
    registers = phase.registers
    history = phase.history
    chunks = tables.chunks
    steps = len(history.masks)
    for member in range(
        chunks.bundle[chunks.of_block[block]], chunks.bundle[chunks.of_block[block + 1]]
    ):
        index = np.uint64(member)
        copy_state(registers, index * _CHUNK + _STATE, history.before, start, index * _KEPT)
    # A block that feeds itself goes step by step: what comes or goes in one changes the charges of the next.
    stride = 1 if chunks.feeds_itself[block] else steps - start
    for first in range(start, steps, stride):
        for bundle in range(chunks.of_block[block], chunks.of_block[block + 1]):
            low = np.uint64(chunks.bundle[bundle])
            high = np.uint64(chunks.bundle[bundle + 1])
            if order.is_pair[low]:
                call_at(phase.by_pairs, (np.uint64(first), stride, low, phase))
                continue
            for row in range(np.uint64(first), np.uint64(first + stride)):
                mask = np.int32(0)
                for each in range(low, high):
                    mask = _run_member(row, each, chunks, order, registers, history)
                _note(np.uint64(chunks.member[high - _ONE_MORE]), row, mask, chunks, history)
        for node in chunks.spiking_node[chunks.of_node[block] : chunks.of_node[block + 1]]:
            if order.link_of[node] < order.link_of[node + 1]:
                _pass_flips_on(node, first, first + stride, tables, order, history)
    history.changed[block] = steps
    history.run[0] += steps - start


@shared
def _run_pair(first, rows, index, phase):  # type: ignore[no-untyped-def]
    """Update two dendrites and their sum in ``rows`` steps, with what its spikes pass to them one step late."""
    chunks = phase.tables.chunks
    is_plain = chunks.plain[chunks.member[index]]
    if is_plain and chunks.plain[chunks.member[index + _ONE_MORE]]:
        _advance_pair(first, rows, index, phase, ())
    else:
        _advance_pair(first, rows, index, phase, chunks.widths)
    return 0


@absorbed
def _advance_pair(first, rows, index, phase, widths):  # type: ignore[no-untyped-def]
    """Do what :func:`_run_pair` says; without ``widths``, an empty tuple, both dendrites are plain."""
    chunks = phase.tables.chunks
    registers = phase.registers
    history = phase.history
    at = index * _KEPT
    last = np.uint64(chunks.member[index + _ONE_MORE + _ONE_MORE])
    slots_of_first = np.uint64(chunks.member[index]) * _LANES
    slots_of_second = np.uint64(chunks.member[index + _ONE_MORE]) * _LANES
    before = history.before
    charge = history.charge
    echo = chunks.echo
    spikes = history.masks[first - _ONE_MORE, last] if first > 0 else np.int32(0)
    advance_pair(
        registers, index * _CHUNK,
        before, first, at, before, first + _ONE_MORE, at,
        charge, first, slots_of_first, charge, first, slots_of_second,
        echo, slots_of_first, echo, slots_of_second,
        history.masks, first, last, history.flips, first, last, history.spikes, last * _LANES,
        spikes, rows, widths,
    )  # fmt: skip


@absorbed
def _run_member(step, index, chunks, order, registers, history):  # type: ignore[no-untyped-def]
    """Update one chunk in one step; return the spikes as bits."""
    k = np.uint64(chunks.member[index])
    at = index * _CHUNK
    mask = advance(registers, at, history.charge, step, k * _LANES, chunks.widths)[0]
    if order.parent[index] >= 0:
        pass_on(registers, at, registers, np.uint64(order.parent[index]) * _CHUNK)
    copy_state(history.before, step + _ONE_MORE, index * _KEPT, registers, at + _STATE)
    return mask


@absorbed
def _note(k, step, mask, chunks, history):  # type: ignore[no-untyped-def]
    """Note the spikes of a chunk in a step, count them, and change what those that came or went pass to a child."""
    flips = mask ^ history.masks[step, k]
    history.flips[step, k], history.masks[step, k] = flips, mask
    count_changes(history.spikes, k * _LANES, flips & mask, flips & ~mask)
    if chunks.echo_to[k] >= 0:
        to = np.uint64(chunks.echo_to[k]) * _LANES
        due = step + _ONE_MORE
        end = np.uint64(len(chunks.echo))
        at = to
        while at < end and due < np.uint64(len(history.masks)):
            change_echo(history.charge, due, to, chunks.echo, at, flips & mask, flips & ~mask)
            at = at + (np.uint64(history.charge.shape[1]) if flips else end)
            due = due + _ONE_MORE


@inner
def _pass_flips_on(node, low, high, tables, order, history):  # type: ignore[no-untyped-def]
    """List the spikes of a node that came or went in steps ``low..high``, and change what they make due.

    All of them first, without branches: which steps have any would be guessed wrong too often.
    """
    nodes = tables.nodes
    chunks = tables.chunks
    links = tables.links
    listed = _NONE
    base = nodes.first[node]
    for row in range(np.uint64(low), np.uint64(high)):
        for k in range(nodes.chunk[node], nodes.chunk[node + 1]):
            first = chunks.first_column[k] - base
            flips = history.flips[row, k]
            spikes = history.masks[row, k]
            listed += list_flips(
                history.event, listed, history.row_of, listed, row, first, flips, spikes
            )[0]
    for index in range(order.link_of[node], order.link_of[node + 1]):
        _change(np.uint64(order.link[index]), listed, links, history)
