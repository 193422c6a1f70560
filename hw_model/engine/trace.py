"""The input and output of an engine: a batch of recordings in one phase.

Columns are the compartments of the phase, group by group, as
:meth:`hw_model.program.chip_program.ChipProgram.columns_of` says.
"""

from functools import lru_cache
from typing import Literal, NamedTuple, get_args

import numpy as np

from hw_model.arithmetic.loihi import EVENTS as EVENTS
from hw_model.program.chip_program import ChipProgram
from hw_model.values import ByteArray, Frozen, Int32Array, IntArray

Register = Literal["u", "v", "potential"]
REGISTERS: tuple[Register, ...] = get_args(Register)
"""``u`` and ``v`` are registers after a step, so v is 0 after a spike; ``potential`` is v as it was compared with the
threshold."""

TOTALS = (
    "synaptic_ops_after_end",
    "neuron_updates",
    "neuron_updates_active",
    *EVENTS,
    "skipped_steps",
)
"""Counts that an engine adds up over all steps and compartments of a recording.

``synaptic_ops_after_end`` counts synapses of spikes that would act after the last step, and ``skipped_steps`` the steps
in which nothing had to be updated.
"""
SKIPPED = TOTALS.index("skipped_steps")
PLAYED = ("input_events", "transpose_events", "events_dropped", "aligned_steps")
"""Counts of input: events played as they came, events played through the transpose buffer, events not played, and rows
before the start of a phase that begins at the first touch."""


class Window(Frozen, eq=False):
    """The part of a register that an engine records: some ``columns``, in steps ``start..stop``."""

    columns: IntArray
    start: int
    stop: int

    def empty(self, batch: int) -> IntArray:
        """Return zeros of the recorded shape, (batch, steps, columns)."""
        return np.zeros((batch, self.stop - self.start, len(self.columns)), dtype=np.int64)


NOTHING = Window(np.empty(0, dtype=np.int64), start=0, stop=0)
"""A window that records nothing."""


class EventLists(NamedTuple):
    """The spikes of a batch as lists, as in a sparse matrix in CSR format.

    The spikes of recording b in row r are channels ``channel[first[b, r]:first[b, r + 1]]``, ascending. ``first`` is
    (batch, rows + 1) and ``channel`` (events,). Lists may leave out parts of ``channel``: several share it.
    """

    first: IntArray
    channel: Int32Array

    @property
    def rows(self) -> int:
        """Rows of every recording."""
        return int(self.first.shape[1]) - 1

    @property
    def events(self) -> IntArray:
        """Events of every recording, (batch,)."""
        return self.first[:, -1] - self.first[:, 0]

    def between(self, start: IntArray, stop: IntArray) -> "EventLists":
        """Return the lists without the spikes of rows before ``start`` and from ``stop`` on, (batch,) each."""
        recording = np.arange(len(self.first))
        first_kept = self.first[recording, np.minimum(start, self.rows)]
        end_of_kept = self.first[recording, np.minimum(stop, self.rows)]
        # Rows before `start` become empty rows at its first spike, and rows from `stop` on at its end.
        kept = np.clip(self.first, first_kept[:, None], end_of_kept[:, None])
        return EventLists(kept, self.channel)

    def moved(self, rows: IntArray) -> "EventLists":
        """Return the lists without the first ``rows`` (batch,) of each recording, padded with empty rows behind."""
        source = np.minimum(np.arange(self.rows + 1) + rows[:, None], self.rows)
        return EventLists(np.take_along_axis(self.first, source, axis=1), self.channel)


class PhaseInput(NamedTuple):
    """The spikes of a phase's input lines.

    - ``steps``: rows of all lists and of the arrays of the phase
    - ``sizes``: the number of lines of each input
    - ``events``: the lists of each input, whose channels are its lines
    - ``counts`` (:data:`PLAYED`, batch)
    - ``start``, ``stop`` (batch,): each recording runs in steps ``start..stop``, without ``stop``
    """

    steps: int
    sizes: tuple[int, ...]
    events: tuple[EventLists, ...]
    counts: IntArray
    start: IntArray
    stop: IntArray

    def part(self, recordings: slice) -> "PhaseInput":
        """Return the input of some recordings."""
        events = tuple(EventLists(lists.first[recordings], lists.channel) for lists in self.events)
        counts = self.counts[:, recordings]
        start = self.start[recordings]
        stop = self.stop[recordings]
        return PhaseInput(self.steps, self.sizes, events, counts, start, stop)

    def lines(self, recording: int) -> ByteArray:
        """Return the spikes of a recording as a matrix (steps, lines) of 0 and 1, inputs side by side."""
        dense = np.zeros((self.steps, sum(self.sizes)), dtype=np.uint8)
        offset = 0
        for events, size in zip(self.events, self.sizes, strict=True):
            first = events.first[recording]
            rows = np.repeat(np.arange(self.steps), np.diff(first))
            dense[rows, offset + events.channel[first[0] : first[-1]]] = 1
            offset += size
        return dense


class PhaseTrace(NamedTuple):
    """What a batch did in a phase of n columns.

    - ``spikes`` (batch, steps, n): 0 and 1
    - ``sent`` (batch, lines + n): spikes of every source over all steps, input lines first
    - ``active`` (batch, steps, pieces): compartments with anything to work on, by piece
      (:class:`hw_model.program.pieces.Pieces`)
    - ``events`` (batch, 3, n): how often each compartment met each of :data:`EVENTS`
    - ``totals`` (batch, :data:`TOTALS`)
    - ``registers``: the recorded windows
    """

    spikes: ByteArray
    sent: IntArray
    active: IntArray
    events: IntArray
    totals: IntArray
    registers: dict[Register, IntArray]

    @property
    def fired(self) -> IntArray:
        """Spikes of every compartment over all steps, (batch, n)."""
        return self.sent[:, self.sent.shape[1] - self.spikes.shape[2] :]

    def part(self, recordings: slice) -> "PhaseTrace":
        """Return the trace of some recordings. Its arrays are views: writing to them writes to this trace."""
        return PhaseTrace(
            spikes=self.spikes[recordings],
            sent=self.sent[recordings],
            active=self.active[recordings],
            events=self.events[recordings],
            totals=self.totals[recordings],
            registers={kind: rows[recordings] for kind, rows in self.registers.items()},
        )

    @classmethod
    def empty(
        cls, played: PhaseInput, n: int, pieces: int, windows: dict[Register, Window]
    ) -> "PhaseTrace":
        """Return a trace of zeros, for an engine to write to."""
        batch = len(played.start)
        return cls(
            spikes=np.zeros((batch, played.steps, n), np.uint8),
            sent=np.zeros((batch, sum(played.sizes) + n), np.int64),
            active=np.zeros((batch, played.steps, pieces), np.int64),
            events=np.zeros((batch, len(EVENTS), n), np.int64),
            totals=np.zeros((batch, len(TOTALS)), np.int64),
            registers={kind: window.empty(batch) for kind, window in windows.items()},
        )


@lru_cache(maxsize=8)
def due_late(program: ChipProgram, phase: str) -> IntArray:
    """Return how many synapses of each source have a delay of at least d, (longest delay + 1, lines + columns)."""
    cores = program.cores_of(phase)
    longest = max((int(core.axons.delay.max(initial=0)) for core in cores), default=0)
    lines = sum(item.size for item in program.inputs_of(phase))
    counts = np.zeros(
        (longest + 1, lines + sum(core.compartments for core in cores)), dtype=np.int64
    )
    for core in cores:
        # No two input axons of a core have the same sender, so `+=` adds to each sender once.
        axons = core.axons
        cell = axons.delay * axons.input_axons + axons.axon_of_synapse
        sizes = np.bincount(cell, minlength=(longest + 1) * axons.input_axons)
        with_delay = sizes.reshape(longest + 1, axons.input_axons)
        with_delay_or_more = with_delay[::-1].cumsum(axis=0)[::-1]
        counts[:, program.senders[core.number]] += with_delay_or_more
    return counts


def added_up(program: ChipProgram, phase: str, played: PhaseInput, trace: PhaseTrace) -> PhaseTrace:
    """Fill in ``sent`` and ``totals`` of a trace, but not its skipped steps, from its other arrays; return the trace.

    A spike d steps before the last step has no effect through synapses with a delay of d or more.
    """
    table = due_late(program, phase)
    for recording, (start, stop) in enumerate(zip(played.start, played.stop, strict=True)):
        sent = np.hstack((played.lines(recording), trace.spikes[recording]))
        trace.sent[recording] = sent.sum(axis=0, dtype=np.int64)
        # The last rows in reverse: row d of the table belongs to d steps before the last.
        last_rows = sent[max(start, stop - len(table)) : stop][::-1]
        trace.totals[recording, 0] = (last_rows * table[: len(last_rows)]).sum()
    updates = (played.stop - played.start) * trace.spikes.shape[2]
    trace.totals[:, 1:SKIPPED] = np.column_stack(
        (updates, trace.active.sum(axis=(1, 2)), trace.events.sum(axis=2))
    )
    return trace
