"""How dense the events of recordings are: the rate that bounds are stated for."""

import hw_model as hw
from hw_model.values import ByteArray, Frozen


class EventPeaks(Frozen):
    """The most events in a step of any recording, and the most that the transpose buffer held.

    The latter is None where a phase begins at the first touch, as rows before it are not kept.
    ``stated`` are the most events in a step of what the user expects, None if nothing is said.
    """

    of_step: int
    of_buffer: int | None
    stated: int | None = None


def event_peaks(
    program: hw.ChipProgram, recordings: ByteArray, stated: int | None = None
) -> EventPeaks:
    """Return the peaks of recordings (samples, steps, channels), next to the rate that is stated."""
    of_steps = recordings.sum(axis=2, dtype="int64")
    aligned = any(phase.align_events is not None for phase in program.phases)
    kept_rows = max((item.rows for item in program.inputs if item.positions is not None), default=0)
    of_buffer = None if aligned else int(of_steps[:, :kept_rows].sum(axis=1).max())
    return EventPeaks(int(of_steps.max()), of_buffer, stated)
