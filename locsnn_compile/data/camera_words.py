"""What the readers of cameras' binary files share: whole records, times that wrap, and the sensor.

These files (:mod:`.aedat`, :mod:`.prophesee`, :mod:`.prophesee_evt3`) are sequences of records of
equal size. Some records are not events: they set a time or a row, which holds for all events behind
them until the next record of that kind. All functions work on whole arrays of records at once,
because a file may have millions.
"""

import numpy as np

from hw_model.values import AnyArray, BoolArray, Frozen, IntArray
from locsnn_compile.data.event_stream import MAX_EVENTS, EventStream
from locsnn_compile.errors import InputError, check_most, counted

MOST_PIXELS_PER_SIDE = 1 << 15
"""The largest width and height of a sensor: coordinates have 15 bits at most."""


class SensorSize(Frozen):
    """The columns and rows of a sensor, in pixels; 0 if the file does not say them."""

    width: int = 0
    height: int = 0

    @property
    def is_known(self) -> bool:
        """Whether the file says both."""
        return self.width > 0 and self.height > 0


class CameraEvents(Frozen, eq=False):
    """Events in the order of their file, each array (events,).

    - ``times``: microseconds
    - ``x``, ``y``: column and row of the pixel, counted from 0
    - ``polarity``: 1 is brighter, 0 is darker
    - ``unplaced``: number of further events of the file that are not among these, because they precede
      its first time or place, or belong to further cameras
    """

    times: IntArray
    x: IntArray
    y: IntArray
    polarity: IntArray
    unplaced: int = 0


def records(body: bytes, layout: str, where: str) -> AnyArray:
    """Return the bytes behind a header as an array of records; ``layout`` is a numpy dtype such as ``<u4``.

    Raises ``InputError`` if the bytes end within a record.
    """
    record_bytes = np.dtype(layout).itemsize
    if len(body) % record_bytes:
        measured = f"{counted(len(body), 'byte')} behind its header, {record_bytes} per record"
        what = "it ends within a record"
        raise InputError(where, what, measured=measured, fix="Give a whole file.")
    return np.frombuffer(body, dtype=layout)


def check_event_count(events: int, where: str) -> None:
    """Refuse a file of more than :data:`~locsnn_compile.data.event_stream.MAX_EVENTS` events."""
    check_most(events, MAX_EVENTS, where, "it has too many events", fix="Give a part of it.")


def latest_set(values: IntArray, is_set: BoolArray, initial: int) -> IntArray:
    """Return for each record the value that was set last, (records,); ``initial`` before the first.

    Record i sets ``values[i]`` if ``is_set[i]``, and the value then holds from record i itself on.
    """
    # Position 0 stands for the initial value, so positions of records begin at 1.
    positions = np.arange(1, len(values) + 1)
    set_at = np.maximum.accumulate(np.where(is_set, positions, 0))
    return np.concatenate(([initial], values))[set_at]


def unwrapped(counter: IntArray, bits: int) -> IntArray:
    """Return a counter of ``bits`` bits continued beyond its wraps, (records,).

    A fall by half of its range or more is a wrap. A smaller fall is time that runs backward a little,
    as it does where a camera sends events out of order.
    """
    half_range = 1 << (bits - 1)
    is_wrap = np.diff(counter, prepend=counter[:1]) <= -half_range
    return counter + (np.cumsum(is_wrap) << bits)


def camera_stream(events: CameraEvents, size: SensorSize, where: str) -> EventStream:
    """Return the events of a camera as a stream whose step 0 begins at the first event.

    Raises ``InputError`` if there are no events, or if one lies outside of the sensor.
    """
    if not len(events.times):
        raise InputError(where, "it has no events", fix="Give a recording with events.")
    _check_on_sensor("x", events.x, size.width, where)
    _check_on_sensor("y", events.y, size.height, where)
    return EventStream(
        events.times,
        events.x,
        events.y,
        events.polarity,
        start=None,
        place=where,
        channels=2 * size.width * size.height if size.is_known else None,
        polarities=2,
        columns=size.width if size.is_known else None,
        elsewhere=events.unplaced,
    )


def _check_on_sensor(axis: str, coordinates: IntArray, pixels: int, where: str) -> None:
    """Refuse coordinates (events,) beyond a side of ``pixels`` pixels; 0 means that the size is unknown."""
    is_outside = coordinates >= pixels
    if pixels == 0 or not is_outside.any():
        return
    event = int(is_outside.argmax())
    measured = f"{axis} {coordinates[event]} of event {event} against 0..{pixels - 1}"
    what = "an event is outside of its sensor"
    raise InputError(where, what, measured=measured, fix="Correct the size in its header.")
