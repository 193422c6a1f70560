"""Formats of single events: structured arrays, the five bytes of SLAYER and N-MNIST, and AEDAT4.

Readers return an :class:`~locsnn_compile.data.event_stream.EventStream`, writers the bytes of a file.
Structured arrays, as the library Tonic has them, have the fields ``t`` in microseconds, ``x``, ``y`` (optional) and
``p``. In the binary files of SLAYER and N-MNIST, an event takes five bytes:

- ``.bs1``: neuron number, 16 bits, high byte first; ``.bs2`` and ``.bin``: x, then y, 8 bits each
- all: polarity, 1 bit, and time in microseconds, 23 bits, so no event is later than 8.388607 s
- ``.bs1`` and ``.bs2`` belong to SLAYER, which rounds times to the nearest step; events of all other formats belong to
  the bin that they lie in

In a ``.bin`` of N-MNIST or N-Caltech101, an entry with y 240 is not an event: it shifts all later times by 8,192
microseconds (Orchard et al. 2015, and their Read_Ndataset). AEDAT4 is the format of iniVation's cameras, which the
package ``aedat`` reads: the first stream of events in a file.
"""

import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from hw_model.io.extras import needed
from hw_model.io.npy import load_npy
from hw_model.io.processor_time import processor_seconds, too_little_time
from hw_model.values import AnyArray, IntArray
from locsnn_compile.data.event_stream import (
    MAX_EVENTS,
    TIME_UNITS,
    Binning,
    EventStream,
    StepRule,
    TimeUnit,
    bin_streams,
    recording_events,
)
from locsnn_compile.data.event_tables import columns_of, is_table, order_words
from locsnn_compile.data.format_rows import EventsToWrite
from locsnn_compile.data.recordings import MAX_STEPS, Recordings
from locsnn_compile.errors import InputError, check_most, counted

_FIX = "Give the fields t (microseconds), x, y if there is one, and p (0 or 1)."
#: Largest x and y: far above any sensor.
MAX_PLACE = 1 << 20
#: Narrowest bin that is written: its middle, rounded down to whole microseconds, still lies in the bin.
MIN_EVENT_STEP_SECONDS = 2e-6
#: The fields that are written; readers accept any order and any size.
DTYPE = np.dtype([("t", "<i8"), ("x", "<i8"), ("p", "<i8")])
EVENT_BYTES = 5
"""Bytes of an event in the files of SLAYER and N-MNIST."""
OVERFLOW_ROW, OVERFLOW_MICROSECONDS = 240, 1 << 13
"""The y of an entry of a ``.bin`` file that shifts time, and by how much."""
MAX_MICROSECONDS = (1 << 23) - 1
"""The latest time that 23 bits hold."""
SLAYER_RULE: StepRule = "nearest"
"""How ``.bs1`` and ``.bs2`` files count steps: ``np.round(t / Ts)`` in slayerPytorch's and lava-dl's own readers."""
#: Columns of the grid for recordings without a shape of their own: each row holds the taxels of one fingertip.
COLUMNS = 39
_AEDAT4_CHILD = Path(__file__).with_name("aedat4_child.py")
"""The script that reads an AEDAT4 file in a process of its own."""
_AEDAT4_SECONDS = 60
"""Time by the clock after which that process is killed: generous, because a busy machine may let it wait."""
AEDAT4_OUT_OF_MEMORY = 3
"""The exit code of that process if it inherited a limit on memory that is too low for it."""
AEDAT4_CPU_SECONDS = 10
"""The processor time that it allows itself, unless it inherited a lower limit."""
OUT_OF_TIME_CODES = (-9, -24)
"""SIGKILL and SIGXCPU, by which the system ends a process whose processor time is used up."""


def holds_events(array: AnyArray) -> bool:
    """Return whether an array holds single events: in fields, or in the columns of a table."""
    return array.dtype.names is not None or is_table(array)


def parse_events(array: AnyArray, where: str, time_unit: TimeUnit | None = None) -> EventStream:
    """Return the events of a structured array, (events,), or of a table, (events, columns).

    Bin 0 begins at the first event. ``time_unit``: the unit of t, by default whole microseconds. Polarity -1 counts as
    0. Raises ``InputError`` for other fields, for a table whose columns cannot be told apart, and for numbers that are
    not times, places or polarities.
    """
    if array.dtype.names is None and is_table(array):
        columns = columns_of(array, where)
        order = order_words(columns)
        return replace(_events_of(columns, where, time_unit), column_order=order)
    names = array.dtype.names or ()
    if array.ndim != 1 or not {"t", "x", "p"} <= set(names) <= {"t", "x", "y", "p"}:
        shown = (
            f"fields {', '.join(names)}"[:80]
            if array.ndim == 1
            else counted(array.ndim, "axis", "axes")
        )
        raise InputError(where, "its values are not events", measured=shown, fix=_FIX)
    return _events_of({name: array[name] for name in names}, where, time_unit)


def _events_of(
    columns: Mapping[str, AnyArray], where: str, time_unit: TimeUnit | None
) -> EventStream:
    """Return the events in columns called t, x, y (optional) and p."""
    times = _microseconds(columns["t"], time_unit, where)
    x = _whole(columns["x"], "x", 0, MAX_PLACE, where)
    y = _whole(columns["y"], "y", 0, MAX_PLACE, where) if "y" in columns else None
    polarity = (_whole(columns["p"], "p", low=-1, high=1, where=where) > 0).astype(np.int64)
    return EventStream(times, x, y, polarity, start=None, place=where, unit_is_open=True)


def _microseconds(values: AnyArray, unit: TimeUnit | None, where: str) -> IntArray:
    """Return times as whole microseconds; refuse fractions whose unit is not given."""
    if values.ndim == 1 and values.dtype.kind in "biuf":
        if unit is not None:
            values = np.rint(values.astype(np.float64) * TIME_UNITS[unit])
        fractions = np.isfinite(values) & (values != np.floor(values))
        if fractions.any():
            event = int(fractions.argmax())
            what = "its times are not in whole microseconds"
            fix = "Give their unit: --time-unit ms or s."
            raise InputError(where, what, measured=f"{values[event]:g} of event {event}", fix=fix)
    return _whole(values, "t", 0, 2**53, where)  # Above 2**53, float64 does not hold every integer.


def _whole(values: AnyArray, name: str, low: int, high: int, where: str) -> IntArray:
    """Return a field as int64; ``InputError`` if it has a number that is not whole or not in low..high."""
    if values.ndim != 1 or values.dtype.kind not in "biuf":
        raise InputError(
            where, f"its field {name!r} is not one number", measured=f"{values.dtype}", fix=_FIX
        )
    # Written so that NaN is refused as well.
    bad = ~((values >= low) & (values <= high) & (values == np.floor(values)))
    if bad.any():
        at = int(bad.argmax())
        measured = f"{values[at]} of event {at} against whole numbers {low}..{high}"
        raise InputError(where, f"its field {name!r} is out of range", measured=measured, fix=_FIX)
    return values.astype(np.int64)


def structured_events(times: IntArray, x: IntArray, polarity: IntArray) -> AnyArray:
    """Return the structured array of events."""
    events = np.empty(len(times), dtype=DTYPE)
    events["t"], events["x"], events["p"] = times, x, polarity
    return events


def parse_slayer_events(data: bytes, suffix: str, where: str) -> EventStream:
    """Return the events in the bytes of a ``.bs1``, ``.bs2`` or ``.bin`` file, in file order.

    Any five bytes are a valid event. Raises ``InputError`` for bytes that end within an event.
    """
    if len(data) % EVENT_BYTES:
        measured = f"{counted(len(data), 'byte')}, {EVENT_BYTES} per event"
        raise InputError(
            where, "it ends within an event", measured=measured, fix="Give a whole file."
        )
    fields = np.frombuffer(data, dtype=np.uint8).reshape(-1, EVENT_BYTES).astype(np.int64).T
    times = (fields[2] & 0x7F) << 16 | fields[3] << 8 | fields[4]
    polarity = fields[2] >> 7
    if suffix == ".bs1":
        neuron = fields[0] << 8 | fields[1]
        return EventStream(
            times, neuron, y=None, polarity=polarity, place=where, step_rule=SLAYER_RULE
        )
    x, y = fields[0], fields[1]
    if suffix == ".bs2":
        return EventStream(times, x, y, polarity, place=where, step_rule=SLAYER_RULE)
    # An entry in the overflow row shifts the times of all entries behind it, and is no event itself.
    overflow = y == OVERFLOW_ROW
    times = times + OVERFLOW_MICROSECONDS * np.cumsum(overflow)
    times, x, y, polarity = (values[~overflow] for values in (times, x, y, polarity))
    return EventStream(times, x, y, polarity, place=where)


def parse_aedat4(data: bytes, where: str) -> EventStream:
    """Return the events in the bytes of an ``.aedat4`` file, with two polarities; time starts at the first event.

    The package does not survive all damage, so a separate process reads a copy, within 10 seconds of processor time and
    2 GiB. Raises ``InputError`` for a file that it cannot read, for one without events, and if the package is missing.
    """
    needed(package="aedat", extra="aedat", where=where)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.aedat4"
        path.write_bytes(data)
        command = [sys.executable, "-P", str(_AEDAT4_CHILD), str(path), str(MAX_EVENTS)]
        # Every thread of OpenBLAS reserves memory, of which the child allows itself little.
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        try:
            done = subprocess.run(
                command, env=environment, capture_output=True, timeout=_AEDAT4_SECONDS, check=True
            )
        except subprocess.SubprocessError as error:
            check_child_was_free(getattr(error, "returncode", None))
            fix = "Give a whole AEDAT4 file with events."
            raise InputError(where, "it is damaged, truncated or has no events", fix=fix) from None
    size, array = done.stdout.split(b"\n", maxsplit=1)
    width, height, elsewhere = map(int, size.split())
    stream = parse_events(load_npy(array, where), where)
    return replace(
        stream,
        channels=2 * width * height,
        polarities=2,
        columns=width,
        elsewhere=elsewhere,
    )


def check_child_was_free(exit_code: int | None) -> None:
    """Raise an error if the child failed because of a limit that this process inherited, not because of the file."""
    if exit_code == AEDAT4_OUT_OF_MEMORY:
        raise MemoryError
    seconds = processor_seconds()
    if seconds is not None and seconds < AEDAT4_CPU_SECONDS and exit_code in OUT_OF_TIME_CODES:
        raise too_little_time(seconds)


def timed_events(
    events: EventsToWrite, step_rule: StepRule = "floor"
) -> tuple[IntArray, IntArray, IntArray]:
    """Return (microseconds, cells, polarities) of the events of a recording.

    Raises ``InputError`` if its bins are too narrow for times in whole microseconds.
    """
    width = events.step_seconds
    if width < MIN_EVENT_STEP_SECONDS:
        what = "its bins are too narrow for times in microseconds"
        measured = f"{width:g} s against {MIN_EVENT_STEP_SECONDS:g}"
        raise InputError(events.where, what, measured=measured, fix="Write .npz.")
    return recording_events(events.spikes, events.polarities, width, step_rule)


def slayer_file(events: EventsToWrite, suffix: str) -> dict[str, bytes]:
    """Return the ``.bs1`` or ``.bs2`` file of one recording."""
    times, cell, polarity = timed_events(events, SLAYER_RULE)
    y, x = (None, cell) if suffix == ".bs1" else np.divmod(cell, events.columns)
    content = pack_slayer_events(times, x, y, polarity, events.where)
    return {f"{events.stem}{suffix}": content}


def pack_slayer_events(
    times: IntArray, x: IntArray, y: IntArray | None, polarity: IntArray, where: str
) -> bytes:
    """Return the bytes of a ``.bs1`` file, or of a ``.bs2`` file if ``y`` is given; times in microseconds.

    Raises ``InputError`` for numbers that do not fit their fields.
    """
    for name, values, limit in (
        ("microsecond", times, MAX_MICROSECONDS),
        ("x", x, 0xFF if y is not None else 0xFFFF),
        ("y", times[:0] if y is None else y, 0xFF),
        ("polarity", polarity, 1),
    ):
        if len(values) and not 0 <= values.min() <= values.max() <= limit:
            measured = f"{int(values.max())} against {limit}"
            raise InputError(
                where,
                f"an event's {name} does not fit its bits",
                measured=measured,
                fix="Write .npz.",
            )
    fields = np.empty((len(times), EVENT_BYTES), dtype=np.uint8)
    if y is None:
        fields[:, 0] = x >> 8
        fields[:, 1] = x & 0xFF
    else:
        fields[:, 0] = x
        fields[:, 1] = y
    fields[:, 2] = polarity << 7 | times >> 16
    fields[:, 3] = times >> 8 & 0xFF
    fields[:, 4] = times & 0xFF
    return fields.tobytes()


def from_tonic(
    dataset: Any,
    *,
    step_seconds: float | None = None,
    threshold: int | None = None,
    steps: int | None = None,
    start: float | str | None = None,
    max_steps: int = MAX_STEPS,
) -> Recordings:
    """Return the recordings of a Tonic data set, or of any sequence of (events, label). Tonic is not imported.

    Events are structured arrays of ``t`` (microseconds), ``x``, ``y`` (optional) and ``p``. They become bins as in
    :class:`locsnn_compile.data.event_stream.Binning`. The attribute ``sensor_size`` of the data set, (columns, rows,
    polarities), determines the channels, and ``classes`` names the classes. Raises ``InputError`` for anything else.
    """
    source = type(dataset).__name__
    where = f"data set {source!r}"
    streams = []
    labels = []
    events = 0
    for index in range(len(dataset)):
        array, label = dataset[index]
        streams.append(parse_events(np.asarray(array), f"{where}, recording {index}"))
        labels.append(label)
        events += len(array)
        check_most(events, MAX_EVENTS, where, "it has too many events", fix="Give a part of it.")
    columns, rows, polarities = getattr(dataset, "sensor_size", None) or (None, None, None)
    channels = None if columns is None else columns * rows * polarities
    binning = Binning(
        step_seconds=step_seconds,
        threshold=threshold,
        channels=channels,
        steps=steps,
        polarities=polarities,
        columns=columns,
        start=start,
        max_steps=max_steps,
    )
    bins = bin_streams(streams, where, binning)
    if not all(isinstance(label, int | np.integer) for label in labels):
        raise InputError(
            where,
            "its labels are not class numbers",
            fix="Give a target_transform that gives them.",
        )
    names = getattr(dataset, "classes", None)
    class_names = None if names is None else tuple(map(str, names))
    return Recordings(
        bins.spikes,
        np.array(labels),
        step_seconds=bins.step_seconds,
        source=source,
        binned=bins.binned,
        class_names=class_names,
        channels=bins.channels,
        assumed=bins.assumed,
    )
