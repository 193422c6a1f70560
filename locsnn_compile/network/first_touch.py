"""Align recordings to their first touch: the first step with at least a given number of events.

Every function takes numpy arrays or torch tensors of 0 and 1. The reference uses the first, training the second.
"""

from typing import Any


def first_touch(recordings: Any, events: int) -> Any:
    """Return the first step of each recording (batch, steps, channels) with at least ``events`` events, (batch,).

    If there is no such step, it is the number of steps.
    """
    # The count of touched steps is 0 in exactly the steps before the first one.
    return (_touched(recordings, events) == 0).sum(1)


def from_first_touch(recordings: Any, events: int, *, moved: bool) -> Any:
    """Return recordings of the same shape without the events before the first touch.

    A recording without a touch becomes silent. If ``moved``, the first touch becomes step 0 and silence is added at the
    end; otherwise, every event keeps its step.
    """
    touched = _touched(recordings, events)
    if not moved:
        return recordings * (touched > 0)[:, :, None]
    # Numpy and torch name their ranges differently, but both have cumsum: row and step numbers are sums of ones.
    ones = touched >= 0
    recording = ones.cumsum(0) - 1
    step = ones.cumsum(1) - 1
    steps = recordings.shape[1]
    source_step = step + first_touch(recordings, events)[:, None]
    # The remainder keeps the index within the recording; the mask clears the steps that lie beyond its end.
    return recordings[recording, source_step % steps] * (source_step < steps)[:, :, None]


def _touched(recordings: Any, events: int) -> Any:
    """Return, for each step, how many steps up to it have at least ``events`` events, (batch, steps)."""
    return (recordings.sum(2) >= events).cumsum(1)
