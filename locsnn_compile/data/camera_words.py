"""What the readers of cameras' binary events share: whole records, times that wrap, and the sensor.

Records that only set a time or a place hold for all that follow, until the next one of their kind.
"""

import numpy as np

from hw_model.values import AnyArray, Frozen, IntArray
from locsnn_compile.data.event_stream import EventStream
from locsnn_compile.errors import InputError, counted

MOST_PIXELS_PER_SIDE = 1 << 15
"""The largest width and height of a sensor: coordinates have 15 bits at most."""


class SensorSize(Frozen):
    """The columns and rows of a sensor; 0 if the file does not say them."""

    width: int = 0
    height: int = 0


class CameraEvents(Frozen, eq=False):
    """Events in the order of their file, each (events,): ``times`` in microseconds, places, polarity.

    ``unplaced`` counts those before the first time or place of the file, which have none.
    """

    times: IntArray
    x: IntArray
    y: IntArray
    polarity: IntArray
    unplaced: int = 0


def records(body: bytes, kind: str, where: str) -> AnyArray:
    """Return the records of a numpy ``kind`` in bytes; ``InputError`` if they end within one."""
    size = np.dtype(kind).itemsize
    if len(body) % size:
        measured = f"{counted(len(body), 'byte')} behind its header, {size} per record"
        what = "it ends within a record"
        raise InputError(where, what, measured=measured, fix="Give a whole file.")
    return np.frombuffer(body, dtype=kind)


def held(values: IntArray, is_set: AnyArray, before: int) -> IntArray:
    """Return at each record the value that was set last, ``before`` until there is one."""
    positions = np.arange(1, len(values) + 1)
    last_set = np.maximum.accumulate(np.where(is_set, positions, 0))
    return np.concatenate(([before], values))[last_set]


def unwrapped(counter: IntArray, bits: int) -> IntArray:
    """Return a counter of so many bits without its wraps: it wraps where it falls by half or more."""
    wraps = np.diff(counter, prepend=counter[:1]) <= -(1 << (bits - 1))
    return counter + (np.cumsum(wraps) << bits)


def camera_stream(events: CameraEvents, size: SensorSize, where: str) -> EventStream:
    """Return events as a stream that starts with the first; refuse none, and any off the sensor."""
    if not len(events.times):
        raise InputError(where, "it has no events", fix="Give a recording with events.")
    for name, places, limit in (("x", events.x, size.width), ("y", events.y, size.height)):
        if limit and places.max() >= limit:
            event = int((places >= limit).argmax())
            measured = f"{name} {places[event]} of event {event} against 0..{limit - 1}"
            fix = "Correct the size in its header."
            what = "an event is outside of its sensor"
            raise InputError(where, what, measured=measured, fix=fix)
    is_known = size.width > 0 and size.height > 0
    return EventStream(
        events.times,
        events.x,
        events.y,
        events.polarity,
        start=None,
        place=where,
        channels=2 * size.width * size.height if is_known else None,
        polarities=2,
        columns=size.width if is_known else None,
        elsewhere=events.unplaced,
    )
