"""The phases of a program as the core plays them: the first while a recording arrives, the others from its buffer."""

from dataclasses import field

import numpy as np

from hw_model.engine.playing import length_of
from hw_model.mapping.graph import Phase
from hw_model.program.chip_program import ChipProgram
from hw_model.rtl.row_groups import rows_together
from hw_model.values import ByteArray, Frozen, IntArray

NO_ROW = 1 << 23
"""The row that counts as the first where none has enough events: later than all of a recording."""


class CorePhase(Frozen, eq=False):
    """A phase of ``steps`` steps; one without a name has nothing to do while the recording arrives.

    ``kept``: rows of a recording that the buffer keeps for it. ``rows``: those that its visits tell of; where it is
    aligned and plays by rows, those of the recording. Of rows that visits tell of, two to the power of ``shared`` send
    as one. ``row_source``: what channel 0 sends as, by rows. ``sources`` (lines,): what its input lines send as, or -1
    if a line shares the source of the line before. ``visits`` (3, n): step, channel, and what its first row sends as.
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
        """Return the row of a recording (rows, channels) that counts as the first."""
        if self.align_events is None:
            return 0
        enough = np.flatnonzero(recording.sum(axis=1, dtype=np.int64) >= self.align_events)
        return int(enough[0]) if len(enough) else NO_ROW

    def span(self, recording: ByteArray) -> range:
        """Return the rows in which the phase runs, of those that a simulation gives."""
        if self.align_events is None or not self.by_rows:
            return range(self.steps)
        start = min(self.origin(recording), self.rows)
        return range(start, min(start + self.steps, self.rows))


def core_phases(
    program: ChipProgram, rows: int, steps: int | None, groups: int
) -> tuple[tuple[CorePhase, ...], int]:
    """Return the phases in order, for recordings of ``rows`` rows, and the first source after theirs.

    ``steps``: those of phases of no fixed length. ``groups``: 1 if rows share sources where they can.
    """
    plain = [phase for phase in program.phases if phase.align_events is None]
    streaming = next(
        (p for p in plain if all(item.positions is None for item in program.inputs_of(p.name))),
        None,
    )
    core_phases_so_far = [] if streaming else [CorePhase()]
    free = sum(program.streams.values())
    for phase in sorted(program.phases, key=lambda phase: phase is not streaming):
        length = length_of(program, phase, rows, steps)
        core_phase, free = _core_phase(
            program, phase, length, rows, free, phase is streaming, groups
        )
        core_phases_so_far.append(core_phase)
    return tuple(core_phases_so_far), free


def _core_phase(
    program: ChipProgram, phase: Phase, steps: int, rows: int, free: int, streams: bool, groups: int
) -> tuple[CorePhase, int]:
    inputs = program.inputs_of(phase.name)
    ends = np.cumsum([0, *program.streams.values()]).tolist()
    first_channel = dict(zip(program.streams, ends, strict=False))
    by_rows = not streams and any(item.positions is None for item in inputs)
    row_source = free if by_rows else 0
    free += ends[-1] if by_rows else 0
    sources = [CorePhase().sources]
    visits = [CorePhase().visits]
    shared = rows_together(program, phase.name) if groups else 0
    for item in inputs:
        channels = first_channel[item.stream] + np.arange(item.channels)
        if item.positions is None:
            sources.append(row_source + channels)
            continue
        of_line = np.arange(item.size)
        row = np.arange(item.size) % item.rows
        if shared:
            of_line = of_line // item.rows * -(-item.rows >> shared) + (row >> shared)
        visits.append(np.stack((item.positions, channels, free + of_line[item.visits[1]])))
        # Where rows share a source, the first of them has its list.
        sources.append(np.where(row % (1 << shared), -1, free + of_line))
        free += int(of_line[-1]) + 1
    table = np.hstack(visits)
    events = phase.align_events
    rows_of_visits = max((item.rows for item in inputs if item.positions is not None), default=0)
    rows_kept = max(
        0 if streams else rows_of_visits, steps if by_rows else 0, 0 if events is None else rows
    )
    rows_told = rows_of_visits if events is None or not by_rows else rows_kept
    first = program.readout.from_step if program.readout else {}
    from_step = min(
        max((first[name] for name in program.columns_of(phase.name) if name in first), default=0),
        NO_ROW,
    )
    lines = np.concatenate(sources)
    table = table[:, np.argsort(table[0], kind="stable")]
    return CorePhase(
        phase.name,
        steps,
        rows_kept,
        rows_told,
        shared,
        row_source,
        by_rows,
        events,
        from_step,
        lines,
        table,
    ), free
