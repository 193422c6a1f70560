"""What an engine is asked for and hands back: a batch of recordings in one phase.

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
"""``u`` and ``v`` are registers after the step (v is 0 on a spike row); ``potential`` is v as the threshold saw it."""

TOTALS = (
    "synaptic_ops_after_end",
    "neuron_updates",
    "neuron_updates_active",
    *EVENTS,
    "skipped_steps",
)
"""Counts that an engine adds up over all steps and compartments; steps in which nothing had to be updated are last."""
SKIPPED = TOTALS.index("skipped_steps")
PLAYED = ("input_events", "transpose_events", "events_dropped", "aligned_steps")
"""Counts of what is played: as it came, through the transpose buffer, not at all; and rows before the start."""


class Window(Frozen, eq=False):
    """What to keep of a register: ``columns``, in rows ``start..stop``."""

    columns: IntArray
    start: int
    stop: int

    def empty(self, batch: int) -> IntArray:
        """Return room for it, (batch, rows, columns)."""
        return np.zeros((batch, self.stop - self.start, len(self.columns)), dtype=np.int64)


NOTHING = Window(np.empty(0, dtype=np.int64), 0, 0)


class EventLists(NamedTuple):
    """Spikes of a batch as lists: those of recording b in row r are channels ``channel[first[b, r]:first[b, r + 1]]``.

    ``first`` (batch, rows + 1), ``channel`` (events,), ascending within a row.
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
        row_numbers = np.arange(len(self.first))
        ends = (
            self.first[row_numbers, np.minimum(row, self.rows)][:, None] for row in (start, stop)
        )
        return EventLists(np.clip(self.first, *ends), self.channel)

    def moved(self, rows: IntArray) -> "EventLists":
        """Return the lists without the first ``rows`` (batch,) of each recording, and as many empty ones behind."""
        source = np.minimum(np.arange(self.rows + 1) + rows[:, None], self.rows)
        return EventLists(np.take_along_axis(self.first, source, axis=1), self.channel)


class PhaseInput(NamedTuple):
    """Spikes of a phase's input lines, as the buffer leaves them, one :class:`EventLists` of ``steps`` rows an input.

    ``sizes``: lines of each input. ``counts`` (:data:`PLAYED`, batch). Each recording runs from step ``start`` to
    before step ``stop``, (batch,).
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
        """Return the rows of a recording, (steps, lines) of 0 and 1, inputs one after the other."""
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

    ``spikes`` (batch, steps, n); ``sent`` (batch, lines + n): spikes of every source over all steps, input lines first;
    ``active`` (batch, steps, pieces): compartments of each piece (:class:`hw_model.program.pieces.Pieces`) with
    anything to work on;
    ``events`` (batch, 3, n): how often each compartment met each of :data:`EVENTS`; ``totals`` (batch,
    :data:`TOTALS`); ``registers``: the windows asked for.
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
        """Return views of some recordings: what is written to them is written here."""
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
        """Return room for a trace, all 0."""
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
    """Return how many synapses each source, lines and then columns, has with a delay of d or more, (longest + 1, n)."""
    cores = program.cores_of(phase)
    longest = max((int(core.axons.delay.max(initial=0)) for core in cores), default=0)
    lines = sum(item.size for item in program.inputs_of(phase))
    counts = np.zeros(
        (longest + 1, lines + sum(core.compartments for core in cores)), dtype=np.int64
    )
    for core in cores:
        # Each input axon of a core has a sender of its own.
        axons = core.axons
        shape = (longest + 1, core.axons.input_axons)
        by_delay = np.bincount(
            axons.delay * shape[1] + axons.axon_of_synapse, minlength=shape[0] * shape[1]
        )
        counts[:, program.senders[core.number]] += by_delay.reshape(shape)[::-1].cumsum(axis=0)[
            ::-1
        ]
    return counts


def added_up(program: ChipProgram, phase: str, played: PhaseInput, trace: PhaseTrace) -> PhaseTrace:
    """Return a trace that skips nothing with what was sent and the totals, of spikes and the rest that it holds.

    A spike d steps before the end is too late for a delay of d or more.
    """
    table = due_late(program, phase)
    for b, (start, stop) in enumerate(zip(played.start, played.stop, strict=True)):
        sent = np.hstack((played.lines(b), trace.spikes[b]))
        trace.sent[b] = sent.sum(axis=0, dtype=np.int64)
        late = sent[max(start, stop - len(table)) : stop][::-1]
        trace.totals[b, 0] = (late * table[: len(late)]).sum()
    updates = (played.stop - played.start) * trace.spikes.shape[2]
    trace.totals[:, 1:SKIPPED] = np.column_stack(
        (updates, trace.active.sum(axis=(1, 2)), trace.events.sum(axis=2))
    )
    return trace
