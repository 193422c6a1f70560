"""Binary events of five bytes each: SLAYER's ``.bs1`` and ``.bs2``, and ``.bin`` of N-MNIST and N-Caltech101.

``.bs1``: neuron number, 16 bits, high byte first. ``.bs2`` and ``.bin``: x, then y, 8 bits each. All: polarity, 1 bit,
and time in microseconds, 23 bits, so nothing is later than 8.388607 s; but in a ``.bin``, what has y 240 is no event:
from it on, times are 8,192 microseconds later (Orchard et al. 2015, and their Read_Ndataset).
"""

import numpy as np

from hw_model.values import IntArray
from locsnn_compile.data.event_stream import EventStream
from locsnn_compile.errors import InputError

EVENT_BYTES = 5
OVERFLOW_ROW, OVERFLOW_MICROSECONDS = 240, 1 << 13
MAX_MICROSECONDS = (1 << 23) - 1
#: Columns of the grid that a recording without a shape of its own is laid out in: the taxels of a fingertip a row.
COLUMNS = 39


def parse_slayer_events(data: bytes, suffix: str, where: str) -> EventStream:
    """Return the events of the bytes of such a file, in its order; any five bytes are an event.

    Raises ``InputError`` for bytes that end within an event.
    """
    if len(data) % EVENT_BYTES:
        measured = f"{len(data)} bytes, {EVENT_BYTES} an event"
        raise InputError(where, "it ends within an event", measured=measured, fix="Give a whole file.")
    fields = np.frombuffer(data, dtype=np.uint8).reshape(-1, EVENT_BYTES).astype(np.int64).T
    times = (fields[2] & 0x7F) << 16 | fields[3] << 8 | fields[4]
    if suffix == ".bs1":
        x, y = fields[0] << 8 | fields[1], np.zeros_like(times)
    else:
        x, y = fields[0], fields[1]
    polarity = fields[2] >> 7
    if suffix == ".bin":
        overflow = y == OVERFLOW_ROW
        times = times + OVERFLOW_MICROSECONDS * np.cumsum(overflow)
        times, x, y, polarity = (values[~overflow] for values in (times, x, y, polarity))
    return EventStream(times, x, y, polarity)


def pack_slayer_events(times: IntArray, x: IntArray, y: IntArray | None, polarity: IntArray, where: str) -> bytes:
    """Return the bytes of a ``.bs1`` file, or of ``.bs2`` where ``y`` is given; times in microseconds.

    Raises ``InputError`` for what the fields cannot hold.
    """
    for name, values, limit in (
        ("microsecond", times, MAX_MICROSECONDS),
        ("x", x, 0xFF if y is not None else 0xFFFF),
        ("y", times[:0] if y is None else y, 0xFF),
        ("polarity", polarity, 1),
    ):
        if len(values) and not 0 <= values.min() <= values.max() <= limit:
            measured = f"{int(values.max())} against {limit}"
            raise InputError(where, f"an event's {name} does not fit its bits", measured=measured, fix="Write .npz.")
    fields = np.empty((len(times), EVENT_BYTES), dtype=np.uint8)
    fields[:, 0], fields[:, 1] = (x >> 8, x & 0xFF) if y is None else (x, y)
    fields[:, 2], fields[:, 3], fields[:, 4] = polarity << 7 | times >> 16, times >> 8 & 0xFF, times & 0xFF
    return fields.tobytes()
