"""Which steps of a phase run, and which spikes reach its lines in them: event by event, from the graph alone.

Shares no code with what plays recordings in ``hw_model``.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hw_model.mapping.graph import CompartmentGraph, Input, Phase

Recording = Mapping[str, np.ndarray]
"""Spikes (rows, channels) of each stream, all of equally many rows."""


def inputs_of(graph: CompartmentGraph, phase: Phase) -> list[Input]:
    """The inputs that a phase hears."""
    return [item for item in graph.inputs if item.phase == phase.name]


def extent(
    graph: CompartmentGraph, phase: Phase, recording: Recording, steps: int | None
) -> tuple[int, int, int]:
    """The first row of the touch, and the first step that a phase runs and the one after its last.

    ``steps`` are asked for, of phases that do not say theirs.
    """
    rows = len(next(iter(recording.values())))
    length = _length(graph, phase, rows, steps)
    if phase.align_events is None:
        return 0, 0, length
    touch = _first_touch(graph, phase, recording, rows)
    if phase.axis == "location":
        return touch, 0, length
    last = max(length, rows)
    begin = touch if touch < rows else last
    return touch, begin, min(begin + length, last)


def rows_of(graph: CompartmentGraph, phase: Phase, rows: int, steps: int | None) -> int:
    """Rows that registers are kept for: steps, and those of the recording where a touch begins the phase."""
    length = _length(graph, phase, rows, steps)
    if phase.align_events is not None and phase.axis == "time":
        return max(length, rows)
    return length


def _length(graph: CompartmentGraph, phase: Phase, rows: int, steps: int | None) -> int:
    """Steps of a phase: its own, those asked for, or what its rows and visits need."""
    if phase.steps or steps:
        return phase.steps or steps
    visits = [item.positions for item in inputs_of(graph, phase)]
    return max(rows if at is None else int(max(at)) + 1 for at in visits)


def _first_touch(graph: CompartmentGraph, phase: Phase, recording: Recording, rows: int) -> int:
    """The first row in which the streams of a phase have enough events together."""
    streams = {item.stream for item in inputs_of(graph, phase)}
    for row in range(rows):
        if sum(int(recording[name][row].sum()) for name in streams) >= phase.align_events:
            return row
    return rows


def played(
    graph: CompartmentGraph, item: Input, phase: Phase, recording: Recording, steps: int | None
) -> list[tuple[int, int]]:
    """Step and line of every event that an input plays."""
    touch, begin, end = extent(graph, phase, recording, steps)
    events = np.argwhere(recording[item.stream]).tolist()
    if item.positions is None:
        return [(row, channel) for row, channel in events if begin <= row < end]
    first = [0] * item.channels if item.first_lines is None else item.first_lines.tolist()
    lines = [(int(item.positions[c]), first[c] + row - touch, row - touch) for row, c in events]
    return [
        (step, line)
        for step, line, row in lines
        if step < end and 0 <= row < item.size - max(first)
    ]
