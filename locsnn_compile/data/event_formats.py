"""Formats of single events: structured arrays as Tonic has them, five bytes of SLAYER and N-MNIST, NeuTouch text.

Structured arrays have the fields ``t`` in microseconds, ``x``, ``y`` if there is one, ``p``. Of five bytes, ``.bs1``
has: neuron number, 16 bits, high byte first; ``.bs2`` and ``.bin``: x, then y, 8 bits each; all: polarity, 1 bit, and
time in microseconds, 23 bits, so nothing is later than 8.388607 s. But in a ``.bin`` of N-MNIST or N-Caltech101, what
has y 240 is no event: from it on, times are 8,192 microseconds later (Orchard et al. 2015, and their Read_Ndataset).

Raw NeuTouch text, ``.tact``, has one event a line: ``polarity cell_index timestamp_seconds``. VT_SNN's own files have
whole seconds, and nanoseconds after them. Of the 80 cells, numbered from 1, numbers 17 and 49 do not exist; the other
78 are the taxels of two fingertips, 39 each. Assumed here, for the files do not say it: cells 1..40 are the first
fingertip and 41..80 the second, taxels in the order of their cells; polarity 1 is rising pressure (polarity 0 of a
taxel), 0 or -1 falling (polarity 1).
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw_model.values import AnyArray, ByteArray, FloatArray, IntArray
from locsnn_compile.data.event_stream import MAX_EVENTS, STEP_SECONDS, Binning, EventStream, bin_streams
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError, check_most

_FIX = "Give the fields t (microseconds), x, y where there is one, and p (0 or 1)."
#: Largest x and y.
MAX_PLACE = 1 << 20
#: The fields that are written; readers take them in any order and of any size.
DTYPE = np.dtype([("t", "<i8"), ("x", "<i8"), ("p", "<i8")])
EVENT_BYTES = 5
OVERFLOW_ROW, OVERFLOW_MICROSECONDS = 240, 1 << 13
MAX_MICROSECONDS = (1 << 23) - 1
#: Columns of the grid that a recording without a shape of its own is laid out in: the taxels of a fingertip a row.
COLUMNS = 39


def parse_structured(array: AnyArray, where: str) -> EventStream:
    """Return the events of a structured array, (events,); polarity -1 counts as 0.

    Raises ``InputError`` for other fields, and for numbers that are no times, places or polarities.
    """
    names = array.dtype.names or ()
    if array.ndim != 1 or not {"t", "x", "p"} <= set(names) <= {"t", "x", "y", "p"}:
        shown = f"fields {', '.join(names)}"[:80] if array.ndim == 1 else f"{array.ndim} axes"
        raise InputError(where, "its values are not events", measured=shown, fix=_FIX)
    times = _whole(array, "t", 0, 2**53, where)
    x = _whole(array, "x", 0, MAX_PLACE, where)
    y = _whole(array, "y", 0, MAX_PLACE, where) if "y" in names else np.zeros_like(x)
    return EventStream(times, x, y, (_whole(array, "p", -1, 1, where) > 0).astype(np.int64))


def _whole(array: AnyArray, name: str, low: int, high: int, where: str) -> IntArray:
    values = array[name]
    if values.ndim != 1 or values.dtype.kind not in "biuf":
        raise InputError(where, f"its field {name!r} is not one number", measured=f"{values.dtype}", fix=_FIX)
    # Written so that NaN is refused too.
    bad = ~((values >= low) & (values <= high) & (values == np.floor(values)))
    if bad.any():
        at = int(bad.argmax())
        measured = f"{values[at]} of event {at} against whole numbers {low}..{high}"
        raise InputError(where, f"its field {name!r} is out of range", measured=measured, fix=_FIX)
    return values.astype(np.int64)


def structured_events(times: IntArray, x: IntArray, polarity: IntArray) -> NDArray[np.void]:
    """Return the structured array of events."""
    events = np.empty(len(times), dtype=DTYPE)
    events["t"], events["x"], events["p"] = times, x, polarity
    return events


def parse_slayer_events(data: bytes, suffix: str, where: str) -> EventStream:
    """Return the events of the bytes of a ``.bs1``, ``.bs2`` or ``.bin`` file, in its order; any five are an event.

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


def from_tonic(
    dataset: Any, *, step_seconds: float | None = None, threshold: int | None = None, steps: int | None = None
) -> Recordings:
    """Return the recordings of a data set of the package Tonic, or of any sequence of (events, label).

    Tonic is not imported, only what it returns is read.
    Events are structured arrays of ``t`` (microseconds), ``x``, (``y``,) ``p``, and become bins as in
    :class:`locsnn_compile.data.event_stream.Binning`. ``sensor_size`` of the data set, (columns, rows, polarities),
    says which channels there are, and ``classes`` names them. Raises ``InputError`` for anything else.
    """
    where, source = f"data set {type(dataset).__name__!r}", type(dataset).__name__
    places = [f"{where}, recording {index}" for index in range(len(dataset))]
    streams, labels, events = [], [], 0
    for index, place in enumerate(places):
        array, label = dataset[index]
        streams.append(parse_structured(np.asarray(array), place))
        labels.append(label)
        events += len(array)
        check_most(events, MAX_EVENTS, where, "it has too many events", fix="Give a part of it.")
    columns, rows, polarities = getattr(dataset, "sensor_size", None) or (None, None, None)
    channels = None if columns is None else columns * rows * polarities
    binning = Binning(step_seconds, threshold, channels, steps, polarities, columns)
    spikes, width, binned = bin_streams(streams, places, where, binning)
    if not all(isinstance(label, int | np.integer) for label in labels):
        raise InputError(where, "its labels are not class numbers", fix="Give a target_transform that makes them so.")
    names = getattr(dataset, "classes", None)
    named = None if names is None else tuple(map(str, names))
    return Recordings(spikes, np.array(labels), width, source, binned=binned, class_names=named)


CELLS = 80
MISSING_CELLS = (17, 49)
#: The phases whose times a ``.startend`` file gives, in this order; of slip, the first four.
PHASES = ("start", "reaching", "reached", "grasping", "lifting", "holding")
SLIP_PHASES = len(PHASES) - 2
#: Classes of slip in their published order.
SLIP_CLASSES = ("stable", "rotate")
#: How long grasp, lift and hold last together, from ``grasping`` on, and a slip from ``reaching`` on.
GRASP_SECONDS, SLIP_SECONDS = 6.5, 0.15
SLIP_STEP_SECONDS = 0.001

_TAXEL_OF_CELL = {
    cell: taxel for taxel, cell in enumerate(cell for cell in range(1, CELLS + 1) if cell not in MISSING_CELLS)
}
#: Channels of a file: two fingertips of two polarities.
CHANNELS = 2 * len(_TAXEL_OF_CELL)


def parse_tact(data: bytes, where: str, startend: bytes | None, startend_where: str) -> EventStream:
    """Return the events of the bytes of a ``.tact`` file, times in seconds; x counts taxels.

    With the bytes of a ``.startend`` file the recording is the 6.5 s from "grasping", or of the four times of a slip
    the 0.15 s from "reaching", in bins of 1 ms by default; without, it runs from the first event to the last. Raises
    ``InputError`` with the line number of a line that is no event.
    """
    channels, seconds = _parse(data, where)
    start, span_seconds = float(seconds.min()), None
    if startend is not None:
        start, span_seconds = _stretch(startend, startend_where)
    places = channels // 2, np.zeros_like(channels), channels % 2
    width = SLIP_STEP_SECONDS if span_seconds == SLIP_SECONDS else STEP_SECONDS
    return EventStream(seconds, *places, 1, start, span_seconds, CHANNELS, polarities=2, step_seconds=width)


def tact_text(spikes: ByteArray, step_seconds: float) -> bytes:
    """Return the ``.tact`` lines of one recording, (steps, 156): an event a bin, from 0 s on."""
    steps, channels = np.nonzero(spikes)
    cell_of = list(_TAXEL_OF_CELL)
    lines: list[str] = []
    for step, channel in zip(steps.tolist(), channels.tolist(), strict=True):
        # In the middle of the bin, so that rounding moves no event into another one; but where nothing else says when
        # the recording begins, its first event does.
        seconds = (step + (0.5 if lines or step else 0.0)) * step_seconds
        lines.append(f"{1 - channel % 2} {cell_of[channel // 2]} {seconds:.9f}\n")
    return "".join(lines).encode()


def _parse(data: bytes, where: str) -> tuple[IntArray, FloatArray]:
    """Return (channel, seconds) of every event."""
    channels: list[int] = []
    seconds: list[float] = []
    for number, line in enumerate(data.split(b"\n"), start=1):
        fields = line.split()
        if not fields:
            continue
        try:
            polarity, cell, time, *rest = (field.decode("ascii") for field in fields)
            (nanoseconds,) = rest or ("0",)
            event = (int(polarity), int(cell), float(time) + float(nanoseconds) / 1e9)
        except ValueError:
            shown = line.decode("ascii", "replace").strip()[:40]
            raise _fault(where, number, "it is not an event", f"{shown!r}") from None
        if event[0] not in (-1, 0, 1):
            raise _fault(where, number, "its polarity is not 1, 0 or -1", event[0])
        if event[1] not in _TAXEL_OF_CELL:
            cells = f"1..{CELLS} without {MISSING_CELLS[0]} and {MISSING_CELLS[1]}"
            raise _fault(where, number, "there is no such cell", f"{event[1]} against {cells}")
        if not math.isfinite(event[2]):
            raise _fault(where, number, "its time is not finite", event[2])
        channels.append(2 * _TAXEL_OF_CELL[event[1]] + (0 if event[0] == 1 else 1))
        seconds.append(event[2])
    if not seconds:
        raise InputError(where, "no events inside", fix="Give a recording with events.")
    return np.array(channels, dtype=np.int64), np.array(seconds, dtype=np.float64)


def _fault(where: str, line: int, what: str, got: object) -> InputError:
    fix = "Write 'polarity cell_index timestamp_seconds' on it."
    return InputError(f"{where}, line {line}", what, measured=f"got {got}", fix=fix)


def _stretch(data: bytes, where: str) -> tuple[float, float]:
    """Return when a recording begins and how long it is: of lines ``grasping <seconds>``, or of six or four numbers."""
    words = data.decode("ascii", "replace").replace(",", " ").replace(":", " ").split()
    times: list[float] = []
    named: dict[str, float] = {}
    for index, word in enumerate(words):
        try:
            times.append(float(word))
        except ValueError:
            continue
        if index and words[index - 1].lower() in PHASES:
            named[words[index - 1].lower()] = times[-1]
    if len(times) == SLIP_PHASES and not named and math.isfinite(times[1]):
        return times[1], SLIP_SECONDS
    grasping = named.get("grasping", times[3] if len(times) == len(PHASES) and not named else math.nan)
    if not math.isfinite(grasping):
        fix = f"Give the times of {', '.join(PHASES)}."
        raise InputError(where, "it does not give the time of 'grasping'", measured=f"{len(times)} numbers", fix=fix)
    return grasping, GRASP_SECONDS
