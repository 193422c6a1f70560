"""The peak event rates of recordings, for which a report states the worst case of energy and time."""

import hw_model as hw
from hw_model.values import ByteArray, Frozen


class EventPeaks(Frozen):
    """The largest number of events in a step, and in the transpose buffer, of any recording.

    - ``of_step``: events in one step
    - ``of_buffer``: events in the transpose buffer, which keeps a recording for location neurons until they read it
      channel by channel; None if a phase begins at the first touch, since earlier steps are not buffered
    - ``stated``: events in one step that the user expects at most; None if the user states no rate
    """

    of_step: int
    of_buffer: int | None
    stated: int | None = None


def event_peaks(
    program: hw.ChipProgram, recordings: ByteArray, stated: int | None = None
) -> EventPeaks:
    """Return the peaks of recordings (samples, steps, channels), next to the ``stated`` rate."""
    events_per_step = recordings.sum(axis=2, dtype="int64")
    is_aligned = any(phase.align_events is not None for phase in program.phases)
    # Only the first steps are buffered, as many as the lines of a channel; without location inputs, none.
    buffered_steps = max(
        (item.rows for item in program.inputs if item.positions is not None), default=0
    )
    of_buffer = None
    if not is_aligned:
        of_buffer = int(events_per_step[:, :buffered_steps].sum(axis=1).max())
    return EventPeaks(int(events_per_step.max()), of_buffer, stated)
