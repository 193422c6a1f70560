"""Keep a location phase up to date while a recording arrives, without running it from the start after every row.

A location phase plays a recording channel by channel, from the transpose buffer. A row of the recording is one time
step; its event on channel c adds a spike to the step of the phase in which channel c is played, and may change
everything after that step. So after each row the phase is *replayed*:

1. The events of the row change the charges that are due in some steps (:func:`_change_charges`).
2. Every block whose charges have changed runs again, from the first step with a changed charge on
   (:func:`_run_again`). Charges, states and spikes of every step are kept for that (:class:`History`).
3. A spike that appears or disappears (a *flip*) changes the charges of later steps by its weights, in this block and
   in blocks that follow.

The engine's words are used: a *chunk* is 16 compartments that are updated in vectors, whose *lanes* they are; its
*slots* are the places of their charges; a *bundle* is chunks that add their voltages into one another; a *block* is
groups that are run together; a *link* is the synapses from one node (an input or group) to another
(:mod:`hw_model.engine.layout`). Loops are compiled by numba.
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
from hw_model.streaming.time_phase import PotentialColumns
from hw_model.values import AnyArray, ByteArray, IntArray


class Visits(NamedTuple):
    """When the channels of each input are played. A visit is the step in which a channel is played.

    Input i has the channels ``first_channel[i]..first_channel[i + 1]`` and takes the first ``rows[i]`` rows of a
    recording. An event of channel c in row t is a spike of line ``first_line[c] + t`` in step ``step[c]``.
    """

    first_channel: AnyArray
    step: AnyArray
    first_line: AnyArray
    rows: AnyArray


class Order(NamedTuple):
    """How chunks are run. *Members* are the chunks in the order of their updates, children before their parents.

    - ``parent`` (members,): the member that a member adds its voltages to, or -1
    - ``is_pair`` (members,): whether this member and the next are two dendrites, and the member after them is just
      their sum, without a state of its own. The three are updated by one faster loop
    - ``read_at`` (columns of potentials,): where the potential of each such column lies in a state of the phase
    - ``link``, ``link_of``: node n is the source of the links ``link[link_of[n]:link_of[n + 1]]``
    """

    parent: AnyArray
    is_pair: AnyArray
    read_at: AnyArray
    link: AnyArray
    link_of: AnyArray


class History(NamedTuple):
    """What happened in every step of a phase, so that a run can start again at any step.

    - ``charge`` (steps, slots): the charge that is due in each step
    - ``state_before`` (steps + 1, state of all members): the state before each step, and after the last one
    - ``masks`` (steps, chunks): spikes, a bit per lane
    - ``flips`` (steps, chunks): the spikes that appeared or disappeared when the block last ran, a bit per lane
    - ``event_source``, ``event_step``: room to list the spikes of a node that appeared or disappeared. A spike of
      source s that disappeared is listed as ``~s``, which is negative
    - ``so_far`` (slots,): the count of spikes or, of a column that is read by its potential, the largest potential
    - ``first_changed`` (blocks,): the first step with a changed charge; the number of steps if there is none
    - ``steps_run`` (1,): how many steps of blocks were run, see :attr:`Replay.replayed`
    - ``block_of`` (nodes,): the block of each node; ``slot`` (columns,): the slot of each column
    """

    charge: AnyArray
    state_before: AnyArray
    masks: AnyArray
    flips: AnyArray
    event_source: AnyArray
    event_step: AnyArray
    so_far: AnyArray
    first_changed: AnyArray
    steps_run: AnyArray
    block_of: AnyArray
    slot: AnyArray


class _Phase(NamedTuple):
    """All that the loop over rows reads and writes.

    ``registers`` are the engine's registers of all chunks, in the order of members. ``by_pairs`` is the address of the
    code of :func:`_run_pair`, or 0 if there are no pairs, so that it does not have to be compiled.
    """

    visits: Visits
    potentials: PotentialColumns
    tables: Packed[Tables]
    order: Order
    registers: AnyArray
    history: History
    by_pairs: int | np.int64


# Offsets and sizes in the engine's registers, in numbers. Indices are uint64: numba adds code for negative indices to
# every access with a signed one.
_LANES = np.uint64(LANES)
_CHUNK = np.uint64(FIELDS * LANES)
"""The registers of a chunk."""
_STATE = np.uint64(U * LANES)
"""Where the state begins in them, after the parameters."""
_KEPT = np.uint64(KEPT_FIELDS * LANES)
"""The part of a chunk's registers that is its state."""
_ONE = np.uint64(1)
# Zeros with a type: numba would compile a loop anew for each Python literal that it is called with.
_NO_STEP = np.uint64(0)
_ZERO = np.int64(0)


class Replay:
    """A location phase of ``steps`` steps, to which the rows of a recording are added as they arrive.

    At any time, its state is what it would be if no further row had an event. ``inputs`` are the inputs of the phase,
    all of which go through the transpose buffer.
    """

    def __init__(
        self, layout: FastLayout, steps: int, inputs: Sequence[Input], potentials: PotentialColumns
    ) -> None:
        self._layout = layout
        self._steps = steps
        self._history = _empty_history(layout, steps)
        visits = _visits(inputs)
        chunks = layout.tables.chunks
        registers = aligned((chunks.registers.size,), chunks.registers.dtype)
        registers[:] = chunks.registers[chunks.member].reshape(-1)
        order = _order(layout, potentials)
        phase = _Phase(
            visits=visits,
            potentials=potentials,
            tables=layout.packed_tables,
            order=order,
            registers=registers,
            history=self._history,
            by_pairs=0,
        )
        if order.is_pair.any():
            phase = phase._replace(by_pairs=_by_pairs(phase))
        self._phase = packed.pack(phase)
        # A row without events, and room for the readings after it.
        self._silence = np.zeros((1, len(visits.step)), dtype=np.uint8)
        self._columns = np.zeros((1, layout.columns), dtype=np.int64)
        # Compile the loop for these types of arguments; their values do not matter.
        self._push = entry(_push, 0, self._silence, self._phase, self._columns, 0)
        self.reset()

    def reset(self) -> None:
        """Forget the recording: return to the state before the first row."""
        self._start = 0
        # `state_before` need not be cleared: its first row stays 0, and the run below writes all the others.
        for array in (self._history.charge, self._history.masks, self._history.so_far):
            array[:] = 0
        # Run all blocks once without events: biases alone may make neurons spike.
        self._history.first_changed[:] = 0
        self.push(before=0, rows=self._silence, readings=self._columns, low=0)
        self._history.steps_run[0] = 0

    def wait(self, rows: ByteArray, readings: IntArray, low: int) -> None:
        """Leave out rows before the first one of an aligned phase; write ``readings`` as :meth:`push` does."""
        self._start += len(rows)
        # Rows without events change nothing, but the readings after them are wanted.
        self._push(0, np.zeros_like(rows), self._phase, readings, low)

    def push(self, before: int, rows: ByteArray, readings: IntArray, low: int) -> None:
        """Add rows (rows, channels), a contiguous writeable array; ``before`` rows of the recording came before them.

        After each row, write the reading of every column so far into ``readings`` (rows, columns of all phases), from
        column ``low`` on. The reading is the count of spikes, or the largest potential of a column that is read by it.
        """
        self._push(before - self._start, rows, self._phase, readings, low)

    @property
    def replayed(self) -> tuple[int, int]:
        """The steps of blocks that were run so far, and the steps that a full run takes, which each row would cost."""
        return int(self._history.steps_run[0]), self._steps * len(self._history.first_changed)

    def spikes(self) -> AnyArray:
        """Return the spikes of every step, (steps, columns) of 0 and 1."""
        # Unpack the bits of the masks.
        lanes = (self._history.masks[:, :, None] >> np.arange(LANES)) & 1
        return lanes.reshape(self._steps, -1)[:, self._layout.slot].astype(np.uint8)


def _by_pairs(phase: _Phase) -> np.int64:
    """Return the address of the compiled code of :func:`_run_pair`; the arguments only give their types."""
    return address(_run_pair, _NO_STEP, np.int64(1), _NO_STEP, packed.pack(phase))


def _visits(inputs: Sequence[Input]) -> Visits:
    """Return the visits of all inputs, one input after the other."""
    steps = [item.visits[0] for item in inputs]
    first_lines = [item.visits[1] for item in inputs]
    return Visits(
        first_channel=np.cumsum([0, *map(len, steps)]),
        step=np.concatenate(steps),
        first_line=np.concatenate(first_lines),
        rows=np.array([item.rows for item in inputs]),
    )


def _empty_history(layout: FastLayout, steps: int) -> History:
    """Return arrays for every step of a phase that has not run yet."""
    chunks = layout.tables.chunks
    dtype = chunks.registers.dtype
    chunk_count = len(chunks.node)
    slots = chunk_count * LANES
    # Every source of a node may spike in every step. Lists are written in vectors, which may reach beyond the end.
    most_events = steps * int(layout.tables.nodes.size.max()) + LANES
    return History(
        charge=aligned((steps, slots), dtype),
        state_before=aligned((steps + 1, slots * KEPT_FIELDS), dtype),
        masks=np.zeros((steps, chunk_count), np.int32),
        flips=np.zeros((steps, chunk_count), np.int32),
        event_source=np.empty(most_events, np.int32),
        event_step=np.empty(most_events, np.int32),
        so_far=aligned((slots,), dtype),
        first_changed=np.zeros(len(chunks.feeds_itself), np.int64),
        steps_run=np.zeros(1, np.int64),
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


def _order(layout: FastLayout, potentials: PotentialColumns) -> Order:
    """Return the order in which the chunks of a phase are run."""
    chunks = layout.tables.chunks
    links = layout.tables.links
    slot = layout.slot[potentials.columns]
    members = len(chunks.member)
    # The extra element at the end stays -1: a parent of -1 (none) indexes it, and gives member -1.
    member_of_chunk = np.full(members + 1, -1, dtype=np.int64)
    member_of_chunk[chunks.member] = np.arange(members)
    bundle_start = chunks.bundle[:-1]
    # The loop for pairs passes spikes back to the dendrites in the next step only, not later, and keeps no potentials.
    # So it is not used if echoes have longer delays, or if a potential of the bundle is read.
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
def _push(before, rows, phase, readings, low):  # type: ignore[no-untyped-def]  # noqa: C901 - a compiled loop, whose calls cost
    """Add rows from row ``before`` on; write the reading of every column after each row into ``readings``."""
    visits = phase.visits
    potentials = phase.potentials
    order = phase.order
    history = phase.history
    tables = phase.tables
    steps = len(history.masks)
    for row in range(len(rows)):
        time = before + row
        # The events of this row become spikes of input lines, each in the step that plays its channel.
        for node in range(len(visits.rows)):
            events = _ZERO
            for channel in range(visits.first_channel[node], visits.first_channel[node + 1]):
                if rows[row, channel] and time < visits.rows[node]:
                    history.event_source[events] = visits.first_line[channel] + time
                    history.event_step[events] = visits.step[channel]
                    events += 1
            for index in range(order.link_of[node], order.link_of[node + 1]):
                _change_charges(np.uint64(order.link[index]), events, tables.links, history)
        # Blocks are in topological order, so a block's flips change only charges of itself and of later blocks.
        has_run = False
        for block in range(len(history.first_changed)):
            start = history.first_changed[block]
            if start < steps:
                _run_again(block, start, phase)
                has_run = True
        if has_run:
            for j in range(len(potentials.columns)):
                history.so_far[history.slot[potentials.columns[j]]] = _largest(
                    order.read_at[j], potentials.first_step[j], history
                )
        for column in range(len(history.slot)):
            readings[row, low + column] = history.so_far[history.slot[column]]


@absorbed
def _largest(at, first, history):  # type: ignore[no-untyped-def]
    """Return the largest potential at place ``at`` of a state, over steps from ``first`` on; 0 if there are none."""
    # state_before[t + 1] is the state after step t.
    steps = len(history.masks)
    largest = history.state_before[first + 1, at] if first < steps else 0
    for step in range(first + 1, steps):
        largest = max(largest, history.state_before[step + 1, at])
    return largest


@absorbed
def _change_charges(link, events, links, history):  # type: ignore[no-untyped-def]
    """Add or subtract the charges that the first ``events`` listed spikes send through a link.

    Update the first step from which the target's block has to run again.
    """
    block = np.uint64(history.block_of[links.target_node[link]])
    steps = len(history.masks)
    first = history.first_changed[block]
    offset = links.offset[link]
    form = _form_of(link, links)
    is_matrix = links.kind[link] == MATRIX
    stride = links.width[link] if is_matrix else 1
    width = np.uint64(links.width[link])
    low = np.uint64(links.target[link])
    delay = links.delay[link]
    for e in range(np.uint64(events)):
        event = np.int64(history.event_source[e])
        # `~source` is listed for a spike that disappeared: its charges are subtracted.
        sign = np.int64(1 if event >= 0 else -1)
        source = offset + (event if event >= 0 else ~event) * stride
        # A spike of step t is due in step t + 1 + delay. Charges that are due after the phase's end are dropped.
        if is_matrix:
            due_step = history.event_step[e] + 1 + delay
            if due_step < steps:
                due = np.uint64(due_step)
                begin = np.uint64(source)
                for j in range(np.uint64(0), width, _LANES):
                    add_multiple(history.charge, due, low + j, links.matrix, begin + j, sign)
                first = min(first, due_step)
            continue
        for k in range(
            np.uint64(links.list_start[source]), np.uint64(links.list_start[source + 1])
        ):
            synapse_delay, slot, weight = _synapse(form, k, links)
            due_step = history.event_step[e] + 1 + synapse_delay
            if due_step < steps:
                history.charge[np.uint64(due_step), slot] += sign * weight
                first = min(first, due_step)
    history.first_changed[block] = first


@absorbed
def _form_of(link, links):  # type: ignore[no-untyped-def]
    """Return how synapses are packed in the lists of a link, for :func:`_synapse`; read once, outside the loops."""
    return (
        links.kind[link] == WIDE_LIST, links.target[link], links.delay[link], links.slot_bits[link],
        links.late_bits[link], links.weight_shift[link],
    )  # fmt: skip


@absorbed
def _synapse(form, k, links):  # type: ignore[no-untyped-def]
    """Return the delay, slot and weight of synapse k, unpacked from its word, see ``Links`` of the engine's layout."""
    is_wide, low, delay, slot_bits, late_bits, shift = form
    word = links.wide_word[k] if is_wide else np.int64(links.word[k])
    late = (word >> slot_bits) & ((1 << late_bits) - 1)
    slot = word & ((1 << slot_bits) - 1)
    return delay + late, np.uint64(low + slot), (word >> (slot_bits + late_bits)) << shift


@inner
def _run_again(block, start, phase):  # type: ignore[no-untyped-def]
    """Run a block from step ``start`` to the end; its flips change the charges of later steps, here and elsewhere."""
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
        copy_state(registers, index * _CHUNK + _STATE, history.state_before, start, index * _KEPT)
    # A block that feeds itself runs step by step, since a flip changes charges of its next steps. Any other block runs
    # all steps of a bundle before the next bundle, which is faster.
    stride = 1 if chunks.feeds_itself[block] else steps - start
    for first in range(start, steps, stride):
        for bundle in range(chunks.of_block[block], chunks.of_block[block + 1]):
            low = np.uint64(chunks.bundle[bundle])
            high = np.uint64(chunks.bundle[bundle + 1])
            if order.is_pair[low]:
                call_at(phase.by_pairs, (np.uint64(first), stride, low, phase))
                continue
            for step in range(np.uint64(first), np.uint64(first + stride)):
                # Children come first and do not spike: the mask of the last member is the bundle's.
                mask = np.int32(0)
                for member_of_bundle in range(low, high):
                    mask = _run_member(step, member_of_bundle, chunks, order, registers, history)
                _record_spikes(np.uint64(chunks.member[high - _ONE]), step, mask, chunks, history)
        for node in chunks.spiking_node[chunks.of_node[block] : chunks.of_node[block + 1]]:
            if order.link_of[node] < order.link_of[node + 1]:
                _pass_flips_on(node, first, first + stride, tables, order, history)
    history.first_changed[block] = steps
    history.steps_run[0] += steps - start


@shared
def _run_pair(first, rows, index, phase):  # type: ignore[no-untyped-def]
    """Update two dendrites and the neuron that is their sum, for ``rows`` steps.

    The neuron's spikes are passed back to the dendrites, one step later. ``index`` is the first dendrite's member.
    """
    chunks = phase.tables.chunks
    is_plain = chunks.plain[chunks.member[index]]
    if is_plain and chunks.plain[chunks.member[index + _ONE]]:
        _advance_pair(first, rows, index, phase, ())
    else:
        _advance_pair(first, rows, index, phase, chunks.widths)
    return 0


@absorbed
def _advance_pair(first, rows, index, phase, widths):  # type: ignore[no-untyped-def]
    """Do the work of :func:`_run_pair`.

    If ``widths`` is an empty tuple, both dendrites are plain (no bias, nothing refractory or able to wrap), for which
    numba compiles a shorter loop.
    """
    chunks = phase.tables.chunks
    registers = phase.registers
    history = phase.history
    at = index * _KEPT
    last = np.uint64(chunks.member[index + _ONE + _ONE])
    slots_of_first = np.uint64(chunks.member[index]) * _LANES
    slots_of_second = np.uint64(chunks.member[index + _ONE]) * _LANES
    state_before = history.state_before
    charge = history.charge
    echo = chunks.echo
    spikes = history.masks[first - _ONE, last] if first > 0 else np.int32(0)
    advance_pair(
        registers, index * _CHUNK,
        state_before, first, at, state_before, first + _ONE, at,
        charge, first, slots_of_first, charge, first, slots_of_second,
        echo, slots_of_first, echo, slots_of_second,
        history.masks, first, last, history.flips, first, last, history.so_far, last * _LANES,
        spikes, rows, widths,
    )  # fmt: skip


@absorbed
def _run_member(step, index, chunks, order, registers, history):  # type: ignore[no-untyped-def]
    """Update one chunk in one step, save its state, and return its spikes, a bit per lane."""
    k = np.uint64(chunks.member[index])
    at = index * _CHUNK
    mask = advance(registers, at, history.charge, step, k * _LANES, chunks.widths)[0]
    if order.parent[index] >= 0:
        pass_on(registers, at, registers, np.uint64(order.parent[index]) * _CHUNK)
    copy_state(history.state_before, step + _ONE, index * _KEPT, registers, at + _STATE)
    return mask


@absorbed
def _record_spikes(k, step, mask, chunks, history):  # type: ignore[no-untyped-def]
    """Record the spikes of chunk k in a step, count them, and change what its flips add to a child (their *echo*)."""
    flips = mask ^ history.masks[step, k]
    history.flips[step, k] = flips
    history.masks[step, k] = mask
    count_changes(history.so_far, k * _LANES, flips & mask, flips & ~mask)
    if chunks.echo_to[k] >= 0:
        to = np.uint64(chunks.echo_to[k]) * _LANES
        due = step + _ONE
        end = np.uint64(len(chunks.echo))
        at = to
        while at < end and due < np.uint64(len(history.masks)):
            change_echo(history.charge, due, to, chunks.echo, at, flips & mask, flips & ~mask)
            # Without flips nothing changes: end the loop after one round. A test before the loop would be a branch
            # that the processor often guesses wrong.
            at = at + (np.uint64(history.charge.shape[1]) if flips else end)
            due = due + _ONE


@inner
def _pass_flips_on(node, low, high, tables, order, history):  # type: ignore[no-untyped-def]
    """List the flips of a node in steps ``low..high``, and change the charges that they send through its links.

    All flips are listed first, without branches: the processor would guess wrong too often which steps have any.
    """
    nodes = tables.nodes
    chunks = tables.chunks
    links = tables.links
    listed = _ZERO
    base = nodes.first[node]
    for step in range(np.uint64(low), np.uint64(high)):
        for k in range(nodes.chunk[node], nodes.chunk[node + 1]):
            first = chunks.first_column[k] - base
            flips = history.flips[step, k]
            spikes = history.masks[step, k]
            listed += list_flips(
                history.event_source, listed, history.event_step, listed, step, first, flips, spikes
            )[0]
    for index in range(order.link_of[node], order.link_of[node + 1]):
        _change_charges(np.uint64(order.link[index]), listed, links, history)
