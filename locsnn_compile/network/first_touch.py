"""Recordings from their first touch on; everything works with numpy arrays and torch tensors of 0 and 1."""

from typing import Any


def first_touch(recordings: Any, events: int) -> Any:
    """Return the first step of each recording (batch, steps, channels) with at least ``events`` events, (batch,).

    If there is no such step, it is the number of steps.
    """
    return (_touched(recordings, events) == 0).sum(1)


def from_first_touch(recordings: Any, events: int, *, moved: bool) -> Any:
    """Return recordings of the same shape without the events before the first touch; all go if there is no touch.

    ``moved``: the first touch becomes step 0, and silence is added at the end; otherwise, every event keeps its step.
    """
    touched = _touched(recordings, events)
    if not moved:
        return recordings * (touched > 0)[:, :, None]
    # Row and step numbers are sums of ones, because both libraries have cumsum.
    ones = touched >= 0
    recording, step = ones.cumsum(0) - 1, ones.cumsum(1) - 1
    source, steps = step + first_touch(recordings, events)[:, None], recordings.shape[1]
    return recordings[recording, source % steps] * (source < steps)[:, :, None]


def _touched(recordings: Any, events: int) -> Any:
    """Return how many steps, up to and including each one, have at least ``events`` events, (batch, steps)."""
    return (recordings.sum(2) >= events).cumsum(1)
