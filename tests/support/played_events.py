"""Work out which steps of a phase run and which events reach its input lines, event by event, from the graph alone.

This is the independent answer for the parts of ``hw_model`` that play recordings, with which it shares no code.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hw_model.mapping.graph import CompartmentGraph, Input, Phase

Recording = Mapping[str, np.ndarray]
"""Spikes (rows, channels) of each stream, all of equally many rows."""


def inputs_of(graph: CompartmentGraph, phase: Phase) -> list[Input]:
    """Return the inputs of a phase."""
    return [item for item in graph.inputs if item.phase == phase.name]


def extent(
    graph: CompartmentGraph, phase: Phase, recording: Recording, steps: int | None
) -> tuple[int, int, int]:
    """Return the first row of the touch, the first step that a phase runs, and the step after its last.

    The touch is the first row with ``phase.align_events`` events. A time phase skips the rows before it; a location phase
    runs all its steps, but its lines count rows from the touch on. ``steps`` is the length of phases that do not state
    theirs.
    """
    rows = len(next(iter(recording.values())))
    length = _length(graph, phase, rows, steps)
    if phase.align_events is None:
        return 0, 0, length
    touch = _first_touch(graph, phase, recording, rows)
    if phase.axis == "location":
        return touch, 0, length
    end_of_rows = max(length, rows)
    begin = touch if touch < rows else end_of_rows  # without a touch no step runs
    return touch, begin, min(begin + length, end_of_rows)


def rows_of(graph: CompartmentGraph, phase: Phase, rows: int, steps: int | None) -> int:
    """Return the number of rows of a phase's recorded registers.

    A time phase that a touch begins has at least the rows of the recording, since its steps keep their row numbers.
    """
    length = _length(graph, phase, rows, steps)
    if phase.align_events is not None and phase.axis == "time":
        return max(length, rows)
    return length


def _length(graph: CompartmentGraph, phase: Phase, rows: int, steps: int | None) -> int:
    """Return the steps of a phase: its own, else the given ones, else as many as its rows and visits need."""
    if phase.steps:
        return phase.steps
    if steps:
        return steps
    steps_needed = []
    for item in inputs_of(graph, phase):
        steps_needed.append(rows if item.positions is None else int(max(item.positions)) + 1)
    return max(steps_needed)


def _first_touch(graph: CompartmentGraph, phase: Phase, recording: Recording, rows: int) -> int:
    """Return the first row in which the streams of a phase together have enough events, or the number of rows."""
    streams = {item.stream for item in inputs_of(graph, phase)}
    for row in range(rows):
        events_in_row = sum(int(recording[name][row].sum()) for name in streams)
        if events_in_row >= phase.align_events:
            return row
    return rows


def played(
    graph: CompartmentGraph, item: Input, phase: Phase, recording: Recording, steps: int | None
) -> list[tuple[int, int]]:
    """Return (step, line) of every event of a recording that an input plays.

    A direct input plays a row per step. A transposed input plays a channel c at step ``positions[c]``: row number r,
    counted from the touch, on line ``first_lines[c] + r``. Rows for which it has no lines are dropped.
    """
    touch, begin, end = extent(graph, phase, recording, steps)
    events = np.argwhere(recording[item.stream]).tolist()
    if item.positions is None:
        return [(row, channel) for row, channel in events if begin <= row < end]
    first_lines = [0] * item.channels if item.first_lines is None else item.first_lines.tolist()
    rows_heard = item.size - max(first_lines)
    steps_and_lines = []
    for row, channel in events:
        step = int(item.positions[channel])
        row_since_touch = row - touch
        if step < end and 0 <= row_since_touch < rows_heard:
            steps_and_lines.append((step, first_lines[channel] + row_since_touch))
    return steps_and_lines
