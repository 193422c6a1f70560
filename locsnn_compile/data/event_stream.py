"""Single events, and how they become bins of 0 or 1 in channel ``polarities * (columns * y + x) + polarity``.

How many polarities and columns there are is told by options, by the format, or by the model that takes the recordings;
else the events show it.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np

from hw_model.io.records import between, check_fields
from hw_model.values import AnyArray, ByteArray, FloatArray, Frozen, IntArray, Sums
from locsnn_compile.data.channels import Channels
from locsnn_compile.data.recordings import (
    MAX_ELEMENTS,
    MAX_STEPS,
    MOST_STEPS,
    Binned,
    EventTimes,
    check_size,
)
from locsnn_compile.errors import InputError, check_known, check_most, counted, listed

STEP_SECONDS = 0.02
MICROSECONDS = 1_000_000
_APART = "Keep them apart by --polarities 2, or merge them by --merge-polarities."
#: Most events of one set of recordings.
MAX_EVENTS = 20_000_000

StepRule = Literal["floor", "nearest"]
"""Which step an event at time t belongs to, with steps of width w: ``floor``, the bin that t lies in, [k w, (k + 1) w);
``nearest``, round(t / w), half to even, as SLAYER and lava-dl do.
"""

TimeUnit = Literal["ns", "us", "ms", "s"]
TIME_UNITS: Mapping[str, float] = {"ns": 1e-3, "us": 1.0, "ms": 1e3, "s": 1e6}
"""Units of time in microseconds."""
FIRST = "first"
"""The start of recordings at their first events."""


class Binning(Frozen):
    """What files of events leave open. None: as the format defines it, or else as the events require.

    - ``step_seconds``: width of a bin. None: that of the format if it has one (a slip of NeuTouch: 1 ms), else
      ``usual_step_seconds``, else 0.02 s
    - ``threshold``: a bin with more events is 1, by default 0
    - ``channels``, ``steps``: size of every recording. Later events are cut off, events of other channels are refused.
    - ``most_steps``: longer recordings are cut to this length; ``model_channels``: channels that a model expects, and
      ``model_inputs``: the pixels that they are, if it knows them
    - ``polarities`` of the sensor, and whether to ``merge_polarities``; ``columns``: width of a grid of x and y
    - ``axes``: the order of the axes of arrays, which hold bins already
    - ``start``: the seconds at which step 0 begins, or ``first``: at the first event of each recording
    - ``time_unit`` of times whose format has none: by default microseconds, and seconds in HDF5
    - ``max_steps``: recordings of more steps are refused, unless ``steps`` is given
    - ``usual_times``: start and unit where neither of both is given, nor fixed by the format
    """

    step_seconds: Annotated[float | None, between(1e-6, 1e3)] = None
    threshold: Annotated[int | None, between(0, MAX_EVENTS)] = None
    channels: Annotated[int | None, between(1, MAX_ELEMENTS)] = None
    steps: Annotated[int | None, between(1, MOST_STEPS)] = None
    polarities: Annotated[int | None, between(1, 2)] = None
    columns: Annotated[int | None, between(1, 1_000_000)] = None
    most_steps: int | None = None
    model_channels: int | None = None
    model_inputs: Channels | None = None
    merge_polarities: bool = False
    axes: tuple[str, ...] | None = None
    usual_step_seconds: float | None = None
    start: float | str | None = None
    time_unit: TimeUnit | None = None
    max_steps: Annotated[int, between(1, MOST_STEPS)] = MAX_STEPS
    usual_times: EventTimes = EventTimes()

    where = "recordings"

    @property
    def unit(self) -> TimeUnit | None:
        """The unit of times whose format has none: as asked for, or as usual; None: that of the format."""
        if self.time_unit is not None:
            return self.time_unit
        return self.usual_times.time_unit  # type: ignore[return-value]  # one of TIME_UNITS

    def check(self) -> None:
        """Refuse numbers that are out of range, and unknown names."""
        check_known("time_unit", f"{self.time_unit!r} is not known", self.time_unit, TIME_UNITS)
        is_time = isinstance(self.start, int | float) and math.isfinite(self.start)
        if not (is_time or self.start in (None, FIRST)):
            fix = "Give the seconds at which step 0 begins, or first."
            measured = f"got {self.start!r}"
            raise InputError("start", "it is neither a time nor first", measured=measured, fix=fix)
        check_fields(self)


class EventStream(Frozen, eq=False):
    """The events of one recording: ``times`` in microseconds, ``x``, ``y``, and ``polarity`` 0 or 1, each (events,).

    Without ``y``, x counts taxels; without ``polarity`` as well, it counts channels. A grid's columns do not bound it.
    ``start`` is the time at which bin 0 begins, None for that of the first event. ``span_seconds`` is the length of the
    recording, None if it ends with its last event. ``channels``, ``polarities`` and ``columns`` are those of the
    format, None if it does not fix them.
    ``step_seconds`` is the width of a bin that its format has, if any, ``step_rule`` says which bin an event is in, and
    ``place`` names the recording in errors. ``elsewhere`` counts events of its file that belong to other streams, or
    precede its first time, which are not read.
    ``if_too_long`` is the way out if it has too many bins. ``column_order``: what the columns of its
    table were taken as, in words; empty for events that are not in a table. ``start_is_fixed``: its format says when a
    recording begins, whatever is asked for; ``unit_is_open``: its format has no unit of times.
    """

    times: AnyArray
    x: IntArray
    y: IntArray | None
    polarity: IntArray | None
    start: float | None = 0.0
    span_seconds: float | None = None
    channels: int | None = None
    polarities: int | None = None
    columns: int | None = None
    step_seconds: float | None = None
    place: str = ""
    elsewhere: int = 0
    if_too_long: str = "Give wider bins, or allow more with --max-steps."
    step_rule: StepRule = "floor"
    column_order: str = ""
    start_is_fixed: bool = False
    unit_is_open: bool = False

    @property
    def first_event(self) -> float:
        """The time of its first event, 0 without any."""
        return float(self.times.min()) if len(self.times) else 0.0

    @property
    def began(self) -> float:
        """The time at which bin 0 begins."""
        return self.first_event if self.start is None else self.start


class Bins(Frozen, eq=False):
    """Recordings in bins: ``spikes`` (samples, steps, channels) of 0 and 1, and what is known of them.

    ``step_seconds`` is the width of a bin, None if unknown; ``binned`` is what binning left out, None if the files hold
    bins. ``channels`` are the pixels of the recordings, None if these only number their channels. ``assumed``: what was
    taken where nothing said it, as sentences.
    """

    spikes: ByteArray
    step_seconds: float | None
    binned: Binned | None
    channels: Channels | None
    assumed: tuple[str, ...] = ()


def bin_streams(streams: Sequence[EventStream], where: str, binning: Binning) -> Bins:
    """Return recordings in bins.

    All recordings get as many channels and steps as the largest needs. Raises ``InputError`` if there are no events and
    no size is given, and for sizes above the limits.
    """
    binning.check()
    assumed = tuple(_assumed(streams, where, binning))
    streams = [_starting(stream, binning) for stream in streams]
    stated_width = _stated_width(streams, binning)
    width = STEP_SECONDS if stated_width is None else stated_width
    events = sum(len(stream.times) for stream in streams)
    check_most(events, MAX_EVENTS, where, "it has too many events", fix="Give fewer recordings.")
    sensor = _sensor(streams, where, binning)
    placed = [_Placed(_bins(stream, width), _channels(stream, sensor)) for stream in streams]
    lengths = [
        _length(stream, events_of_recording, width, binning)
        for stream, events_of_recording in zip(streams, placed, strict=True)
    ]
    steps = max(lengths, default=0)
    channels = _channel_count(streams, placed, sensor, binning)
    _check_sizes(where, len(streams), steps, channels, _highest_channel(placed))
    spikes = np.zeros((len(streams), steps * channels), dtype=np.uint8)
    lost = _Lost()
    for row, events_of_recording in zip(spikes, placed, strict=True):
        lost += _fill(row, events_of_recording, steps, channels, binning.threshold or 0)
    elsewhere = sum(stream.elsewhere for stream in streams)
    binned = Binned(
        binning.threshold or 0,
        events + elsewhere,
        lost.outside,
        lost.below,
        elsewhere,
        step_is_default=stated_width is None,
    )
    known = None if all(stream.polarity is None for stream in streams) else sensor
    return Bins(spikes.reshape(len(streams), steps, channels), width, binned, known, assumed)


class _Placed(Frozen, eq=False):
    """The events of a recording: the ``step`` of each, a whole number or infinite, and its ``channel``, (events,)."""

    step: FloatArray
    channel: IntArray


class _Lost(Sums):
    """Events that are in no bin: ``outside`` the steps, or ``below`` the threshold."""

    outside: int = 0
    below: int = 0


def _highest_channel(placed: Sequence[_Placed]) -> int:
    """Return the highest channel on which there is an event; -1 without any."""
    return max((int(of.channel.max(initial=-1)) for of in placed), default=-1)


def _channel_count(
    streams: Sequence[EventStream],
    placed: Sequence[_Placed],
    sensor: Channels,
    binning: Binning,
) -> int:
    """Return the number of channels: that asked for, that of the format, or what the events reach, in whole pixels."""
    if binning.channels is not None:
        return binning.channels
    reached = _highest_channel(placed) + 1
    whole_pixels = -(-reached // sensor.polarities) * sensor.polarities
    return max((stream.channels or whole_pixels for stream in streams), default=0)


def _fill(row: ByteArray, placed: _Placed, steps: int, channels: int, threshold: int) -> _Lost:
    """Set the bins of a recording, (steps * channels,), that hold more events than the threshold."""
    inside = (placed.step >= 0) & (placed.step < steps)
    of_event = placed.step[inside].astype(np.int64) * channels + placed.channel[inside]
    bins, counts = np.unique(of_event, return_counts=True)
    row[bins[counts > threshold]] = 1
    outside = len(inside) - int(inside.sum())
    below = int(counts[counts <= threshold].sum())
    return _Lost(outside, below)


def _starting(stream: EventStream, binning: Binning) -> EventStream:
    """Return the stream with the start that is asked for, or else the usual one: seconds, or ``first``."""
    start = binning.start
    if start is None and not stream.start_is_fixed:
        start = binning.usual_times.start
    if start is None:
        return stream
    if isinstance(start, str):
        return replace(stream, start=None)
    return replace(stream, start=start * MICROSECONDS)


def _assumed(streams: Sequence[EventStream], where: str, binning: Binning) -> Iterator[str]:
    """Yield what is taken of times and columns, because neither the format nor an option says it."""
    orders = sorted({stream.column_order for stream in streams if stream.column_order})
    if orders:
        unit = "" if binning.unit else ", with t in microseconds (--time-unit)"
        yield f"The columns of {where} were taken as {listed(orders, 'or')}{unit}."
    usual = binning.usual_times
    if binning.time_unit is None and usual.time_unit and any(s.unit_is_open for s in streams):
        yield f"Times were read in {usual.time_unit}, as in the training (--time-unit)."
    starts_open = not all(stream.start_is_fixed for stream in streams)
    if binning.start is None and usual.start is not None and starts_open:
        begin = "at their first event"
        if not isinstance(usual.start, str):
            begin = f"at {usual.start:g} s of their files"
        yield f"Recordings start {begin}, as in the training (--start)."
        return
    latest = max((stream.began for stream in streams if stream.start is None), default=0.0)
    if binning.start is None and latest > 0:
        seconds = f"{latest / MICROSECONDS:g} s"
        yield (
            f"Recordings start at their first event, up to {seconds} after time 0 of their files (--start)."
        )


def _sensor(streams: Sequence[EventStream], where: str, binning: Binning) -> Channels:
    """Return the pixels that events belong to: as asked for, or as the format, the model or the events say."""
    widest = [one.columns or 1 + int(one.x.max()) for one in streams if one.columns or len(one.x)]
    columns = binning.columns or max(widest, default=1)
    polarities, polarity = _polarities(streams, where, binning, columns)
    if binning.columns is None and binning.channels is not None:
        _check_columns(streams, where, binning.channels, columns, polarities)
    of_format = max((one.channels or 0 for one in streams), default=0)
    count = binning.channels or of_format or None
    if any(one.y is not None for one in streams):
        highest = max(
            (int(one.y.max()) for one in streams if one.y is not None and len(one.y)), default=0
        )
        stated = count is not None and (binning.columns is not None or of_format > 0)
        if stated and count is not None:
            rows = -(-count // (columns * polarities))
            return Channels(columns, rows, polarities, polarity=polarity)
        return Channels(columns, 1 + highest, polarities, reached=True, polarity=polarity)
    places = columns if count is None else -(-count // polarities)
    return Channels(places, 1, polarities, reached=count is None, polarity=polarity)


def _stated_width(streams: Sequence[EventStream], binning: Binning) -> float | None:
    """Return the width of a bin in seconds that an option, the format or the model states; None if none does."""
    if binning.step_seconds is not None:
        return binning.step_seconds
    widths = [stream.step_seconds for stream in streams if stream.step_seconds is not None]
    return min(widths, default=binning.usual_step_seconds)


def _polarities(
    streams: Sequence[EventStream], where: str, binning: Binning, columns: int
) -> tuple[int, int | None]:
    """Return the number of polarities and, if events of one do not say how many the sensor has, that polarity."""
    occurring = sorted(
        {int(p) for one in streams if one.polarity is not None for p in np.unique(one.polarity)}
    )
    if binning.merge_polarities:
        return 1, None
    told = binning.polarities
    if told is None and any(one.polarities == 2 for one in streams):
        told = 2
    whose, fix = "the sensor has one", _APART
    if told is None and binning.model_inputs is not None:
        told = min(binning.model_inputs.polarities, 2)
        whose, fix = "the model takes one", "Merge them by --merge-polarities."
    if told == 1 and len(occurring) > 1:
        raise InputError(where, f"its events have two polarities, but {whose}", fix=fix)
    if told is not None:
        return told, None
    if len(occurring) > 1:
        return 2, None
    _check_one_polarity(streams, where, binning.model_channels, columns)
    return 1, next(iter(occurring), None)


def _check_one_polarity(
    streams: Sequence[EventStream], where: str, channels: int | None, columns: int
) -> None:
    """Refuse events of one polarity that do not tell taxels from the channels of a model."""
    cells = [_cells(one, columns) for one in streams if one.polarity is not None and len(one.x)]
    highest = max((int(own.max()) for own in cells), default=None)
    if (
        channels is not None
        and channels % 2 == 0
        and highest is not None
        and 2 * highest < channels
    ):
        # As taxels, their channels would be twice as high.
        measured = f"up to {highest} of {counted(channels, 'channel')}"
        fix = "Give --polarities 2 (taxels) or 1 (channels)."
        what = "its events have one polarity, so x may count taxels or channels"
        raise InputError(where, what, measured=measured, fix=fix)


def _check_columns(
    streams: Sequence[EventStream], where: str, channels: int, columns: int, polarities: int
) -> None:
    """Refuse a width that is only that of the events, unless they fill the channels: other files have other widths."""
    guessed = [
        one.y for one in streams if one.columns is None and one.y is not None and one.y.any()
    ]
    rows = 1 + max((int(y.max()) for y in guessed), default=0)
    if guessed and columns * rows * polarities != channels:
        what = "the width of its grid is not known"
        measured = f"up to {columns} x {rows} in {counted(channels, 'channel')}"
        fix = "Give --grid WxH of the sensor."
        raise InputError(where, what, measured=measured, fix=fix)


def _bins(stream: EventStream, width_seconds: float) -> FloatArray:
    """Return the step of every event, as whole numbers; absurd times overflow to infinity, which is outside."""
    width = width_seconds * MICROSECONDS
    if abs(width - round(width)) < 1e-6:
        # 0.0003 s is not quite 300 microseconds in floats, and an event at 300 belongs to the second bin.
        width = round(width)
    with np.errstate(over="ignore"):
        since_start = stream.times - stream.began
        if stream.step_rule == "nearest":
            # Milliseconds first, as SLAYER divides: quotients near a half depend on it.
            return np.rint(since_start / 1000 / (width / 1000))
        return np.floor(since_start / width)


def _length(one: EventStream, placed: _Placed, width_seconds: float, binning: Binning) -> int:
    """Return the number of steps of a recording; 0 if it has no events and no span."""
    if binning.steps is not None:
        return binning.steps
    bins = placed.step
    most = binning.most_steps
    if one.span_seconds is not None:
        # Whole bins only; the small addend makes up for a quotient that rounds below a whole number.
        last = one.span_seconds / width_seconds - 1 + 1e-6
    else:
        last = float(bins.max()) if len(bins) else -1.0
    if most is not None and not last < most:
        return most
    if not last < binning.max_steps:
        # In bins first: absurd times overflow to infinity there already.
        span = (
            last * width_seconds
            if math.isinf(last)
            else float(one.times.max() - one.began) / MICROSECONDS
        )
        measured = f"{span:g} s in bins of {width_seconds:g} s against {binning.max_steps} bins"
        lasts_seconds = float(one.times.max() - one.first_event) / MICROSECONDS
        begins_late = one.start is not None and one.first_event > one.start
        fix = one.if_too_long
        if begins_late and lasts_seconds < width_seconds * binning.max_steps:
            fix = "Start it at its first event with --start first."
        raise InputError(one.place, "it lasts too long for its bins", measured=measured, fix=fix)
    return math.floor(last) + 1


def _channels(one: EventStream, sensor: Channels) -> IntArray:
    """Return the channel of every event; the polarities of a sensor that has one are all the same."""
    if one.polarity is None:
        return one.x
    columns = sensor.columns
    if one.y is not None and int(one.x.max(initial=0)) >= columns:
        measured = f"x {int(one.x.max())} against {columns} columns"
        raise InputError(
            one.place, "an event lies outside the grid", measured=measured, fix="Give more columns."
        )
    cells = _cells(one, columns)
    return cells if sensor.polarities == 1 else sensor.polarities * cells + one.polarity


def _cells(one: EventStream, columns: int) -> IntArray:
    return one.x if one.y is None else columns * one.y + one.x


def _check_sizes(where: str, samples: int, steps: int, channels: int, highest: int) -> None:
    """Refuse events beyond the ``channels``, and recordings of no size or too large a one."""
    if highest >= channels:
        measured = f"channel {highest} against 0..{channels - 1}"
        fix = "Give events of this sensor, or more channels."
        raise InputError(
            where,
            "it has events on channels that the sensor does not have",
            measured=measured,
            fix=fix,
        )
    if steps == 0 or channels == 0:
        raise InputError(where, "no events inside", fix="Give a recording with events.")
    check_size(samples, steps, channels, where)


def recording_events(
    spikes: ByteArray, polarities: int, step_seconds: float, step_rule: StepRule = "floor"
) -> tuple[IntArray, IntArray, IntArray]:
    """Return (microseconds, cell, polarity) of the events of one recording (steps, channels), in order of time.

    Each event lies where its format's ``step_rule`` puts it back into its step, if only the width of a bin is known: in
    the middle of its bin (the first one at its start), or at the time of its step, which readers that take the floor
    read alike.
    """
    steps, channels = np.nonzero(spikes)
    width = step_seconds * MICROSECONDS
    if step_rule == "nearest":
        times = np.ceil(steps * width)
    else:
        times = np.floor((steps + 0.5) * width)
        # Readers may start at the first event: then it lies at the start of its bin.
        times[:1] = np.ceil(steps[:1] * width)
    return times.astype(np.int64), channels // polarities, channels % polarities
