"""Recordings from their first touch on: the same for numpy arrays and torch tensors, of 0 and 1."""

from typing import Any

from hw_model.mapping.graph import Readout as Readout


def first_touch(recordings: Any, events: int) -> Any:
    """Return the first step of recordings (batch, steps, channels) with at least so many events, (batch,).

    That is the number of steps where there is none.
    """
    return (_touched(recordings, events) == 0).sum(1)


def from_first_touch(recordings: Any, events: int, *, moved: bool) -> Any:
    """Return recordings of the same shape without what lies before the first touch; all of it, where there is none.

    ``moved``: the first touch becomes step 0, and silence follows the last one; else every event keeps its step.
    """
    touched = _touched(recordings, events)
    if not moved:
        return recordings * (touched > 0)[:, :, None]
    # Numbers of rows and steps, as sums of ones: both libraries have them.
    ones = touched >= 0
    recording, step = ones.cumsum(0) - 1, ones.cumsum(1) - 1
    source, steps = step + first_touch(recordings, events)[:, None], recordings.shape[1]
    return recordings[recording, source % steps] * (source < steps)[:, :, None]


def _touched(recordings: Any, events: int) -> Any:
    """Return how many steps up to each one had so many events, (batch, steps)."""
    return (recordings.sum(2) >= events).cumsum(1)
