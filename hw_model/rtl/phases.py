"""The phases of a program as the core plays them.

The first phase of the core runs while a recording arrives. All others read its events from the
buffer (transpose.sv), in visits or by rows. A row is a step of the recording; a visit reads all
rows of one channel, in one step of the phase.

A *line* is an input of a phase: a channel or, where channels are visited, a row of a channel. The
core knows spikes by the number of their *source*, and each source has a list of synapses. The
channels of a recording are the first sources. What a phase reads from the buffer gets the numbers
after them, which are given out here.
"""

from dataclasses import field

import numpy as np

from hw_model.engine.playing import length_of
from hw_model.mapping.graph import Input, Phase
from hw_model.program.chip_program import ChipProgram
from hw_model.rtl.row_groups import rows_together
from hw_model.values import ByteArray, Frozen, IntArray

NO_ROW = 1 << 23
"""The first row of an aligned phase where no row has enough events: later than all rows of a
recording."""


class CorePhase(Frozen, eq=False):
    """A phase of the core, of ``steps`` steps.

    - ``name``: the phase of the program; empty for a first phase with nothing to do while the
      recording arrives
    - ``kept``: rows of a recording that the buffer keeps for it
    - ``rows``: rows of a channel that its visits play; the rows of the recording, if it is aligned
      and reads by rows
    - ``shared``: 2^shared rows of a visit are one source
    - ``row_source``: the source of channel 0, by rows; those of the other channels follow
    - ``by_rows``: whether a step reads its row of the recording, besides visits
    - ``align_events``: rows count from the first with as many events; None if the phase is not
      aligned
    - ``potentials_from``: the step from which potentials are read out
    - ``sources`` (lines,): the source of each line, or -1 if it shares the source of an earlier row
    - ``visits`` (3, n): step, channel, and the source of the first row, by step
    """

    name: str = ""
    steps: int = 0
    kept: int = 0
    rows: int = 0
    shared: int = 0
    row_source: int = 0
    by_rows: bool = False
    align_events: int | None = None
    potentials_from: int = 0
    sources: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    visits: IntArray = field(default_factory=lambda: np.empty((3, 0), dtype=np.int64))

    def origin(self, recording: ByteArray) -> int:
        """Return the row of a recording (rows, channels) from which the phase counts rows."""
        if self.align_events is None:
            return 0
        enough = np.flatnonzero(recording.sum(axis=1, dtype=np.int64) >= self.align_events)
        return int(enough[0]) if len(enough) else NO_ROW

    def span(self, recording: ByteArray) -> range:
        """Return the steps in which the core runs the phase, among the steps of a simulation.

        An aligned phase that reads by rows begins with its first row, and ends with the recording
        at the latest.
        """
        if self.align_events is None or not self.by_rows:
            return range(self.steps)
        start = min(self.origin(recording), self.rows)
        return range(start, min(start + self.steps, self.rows))


def core_phases(
    program: ChipProgram, rows: int, steps: int | None, groups: int
) -> tuple[tuple[CorePhase, ...], int]:
    """Return the phases of the core in order, and the first number after their sources.

    ``rows``: steps of a recording. ``steps``: the length of phases of no fixed length. ``groups``
    is the core's parameter GROUPS: 1 if rows share sources where they can, 0 if they never do.
    """
    streaming = next(
        (phase for phase in program.phases if _plays_as_it_arrives(program, phase)), None
    )
    # The first phase of the core is that of the arriving recording, even if it has nothing to do.
    phases = [] if streaming else [CorePhase()]
    next_source = sum(program.streams.values())  # after the channels
    for phase in sorted(program.phases, key=lambda phase: phase is not streaming):
        core_phase, next_source = _core_phase(
            program,
            phase,
            steps=length_of(program, phase, rows, steps),
            rows=rows,
            next_source=next_source,
            streams=phase is streaming,
            groups=groups,
        )
        phases.append(core_phase)
    return tuple(phases), next_source


def _plays_as_it_arrives(program: ChipProgram, phase: Phase) -> bool:
    """Return whether a phase can play arriving recordings: not aligned, and without visits."""
    inputs = program.inputs_of(phase.name)
    return phase.align_events is None and all(item.positions is None for item in inputs)


def _core_phase(  # noqa: PLR0913 - results of earlier steps, each used once
    program: ChipProgram,
    phase: Phase,
    *,
    steps: int,
    rows: int,
    next_source: int,
    streams: bool,
    groups: int,
) -> tuple[CorePhase, int]:
    """Return a phase of the core, and the first number after its sources.

    Its sources are numbered from ``next_source`` on. ``streams``: it plays rows as they arrive,
    from channels, which are sources already.
    """
    inputs = program.inputs_of(phase.name)
    ends = np.cumsum([0, *program.streams.values()]).tolist()
    first_channel = dict(zip(program.streams, ends, strict=False))
    # An input without positions is read as it comes. Positions are steps of the phase, in each of
    # which one channel is visited.
    by_rows = not streams and any(item.positions is None for item in inputs)
    row_source = 0
    if by_rows:
        row_source = next_source
        next_source += ends[-1]

    sources = [CorePhase().sources]  # empty, so that there is something to concatenate
    visits = [CorePhase().visits]
    # 2^shared rows share a source.
    shared = rows_together(program, phase.name) if groups else 0
    for item in inputs:
        channels = first_channel[item.stream] + np.arange(item.channels)
        if item.positions is None:
            # While the recording arrives, row_source is 0: its channels are sources already.
            sources.append(row_source + channels)
            continue
        source_of_line, row_of_line = _sources_of_lines(item, shared)
        visit_steps, first_lines = item.visits
        first_sources = next_source + source_of_line[first_lines]
        visits.append(np.stack((visit_steps, channels, first_sources)))
        # Where rows share a source, its list of synapses is that of the first of them.
        has_list = row_of_line % (1 << shared) == 0
        sources.append(np.where(has_list, next_source + source_of_line, -1))
        next_source += int(source_of_line[-1]) + 1
    visit_table = np.hstack(visits)

    # All visited inputs of a phase have as many rows (refused.py); a phase that plays the arriving
    # recording has none.
    rows_of_visits = max((item.rows for item in inputs if item.positions is not None), default=0)
    is_aligned = phase.align_events is not None
    # The buffer keeps the rows that visits read, a row per step by rows, and all rows of a
    # recording for an aligned phase, as any of them may be the first.
    kept = max(
        rows_of_visits,
        steps if by_rows else 0,
        rows if is_aligned else 0,
    )
    from_step = program.readout.from_step if program.readout else {}
    populations = program.columns_of(phase.name)
    # The populations of a phase are read from the same step: refused.py refuses others.
    first_steps = {from_step[name] for name in populations if name in from_step}
    core_phase = CorePhase(
        name=phase.name,
        steps=steps,
        kept=kept,
        rows=kept if is_aligned and by_rows else rows_of_visits,
        shared=shared,
        row_source=row_source,
        by_rows=by_rows,
        align_events=phase.align_events,
        # A step later than any phase has is cut to one that fits the core's field of 24 bits.
        potentials_from=min(max(first_steps, default=0), NO_ROW),
        sources=np.concatenate(sources),
        visits=visit_table[:, np.argsort(visit_table[0], kind="stable")],  # by step
    )
    return core_phase, next_source


def _sources_of_lines(item: Input, shared: int) -> tuple[IntArray, IntArray]:
    """Return the source of each line of a transposed input, counted from 0, and its row.

    A line is a row of a channel, and the lines of a channel follow each other. 2^shared rows have
    one source.
    """
    line = np.arange(item.size)
    row = line % item.rows
    if not shared:
        return line, row
    sources_per_channel = -(-item.rows >> shared)
    channel = line // item.rows
    return channel * sources_per_channel + (row >> shared), row
