"""Single events, and how they become recordings in bins.

A reader of a format turns a file into an :class:`EventStream`: times, pixels and polarities of events.
:func:`bin_streams` puts the events of several streams into bins: bin (step, channel) of a recording is
1 if more events than a threshold fall into it, else 0, where
``channel = polarities * (columns * y + x) + polarity``.

How many polarities and columns the sensor has is stated by options, by the format, or by the model
that takes the recordings. If none of them does, the events decide: the sensor is taken to be as large
as the highest pixel that has an event. A taxel is a pixel of a tactile sensor: it has a number, and no
row and column.
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
"""Width of a bin where nothing states one."""
MICROSECONDS = 1_000_000
"""In a second."""
ROUNDING_SLACK = 1e-6
"""A number of bins, or a width of a bin in microseconds, that is this near to a whole number is taken
for that number: float64 cannot hold 0.3 ms or its quotients exactly, but errs by far less than this.
"""
_APART = "Keep them apart by --polarities 2, or merge them by --merge-polarities."
MAX_EVENTS = 20_000_000
"""Events of one set of recordings, at most."""

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
    """How events are put into bins, as far as options or a model decide it.

    A field that is None is decided by the file's format if it says, or else by the events.

    - ``step_seconds``: width of a bin. None: that of the format if it has one (1 ms for the slips of NeuTouch), else
      ``usual_step_seconds``, else 0.02 s
    - ``threshold``: a bin with more events than this is 1, by default 0
    - ``channels``, ``steps``: size of every recording. Later events are cut off, events of other channels are refused.
    - ``most_steps``: longer recordings are cut to this length; ``model_channels``: channels that a model expects, and
      ``model_inputs``: the pixels that they are, if it knows them
    - ``polarities`` of the sensor, and whether to ``merge_polarities``; ``columns``: width of a grid of x and y
    - ``axes``: the order of the axes of arrays, which hold bins already
    - ``start``: the seconds at which step 0 begins, or ``first``: at the first event of each recording
    - ``time_unit`` of times whose format has none: by default microseconds, and seconds in HDF5
    - ``max_steps``: recordings of more steps are refused, unless ``steps`` is given
    - ``usual_times``: the start and the time unit of the model's training, used where no option gives
      one and the format does not fix it
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
        """The unit of times whose format has none: that of the option, else that of the training.

        None if neither gives one; then each reader uses the usual unit of its format.
        """
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
    """The events of one recording, as a reader of its format returns them.

    - ``times`` in microseconds, ``x``, ``y``, and ``polarity`` 0 or 1, each (events,), in file order. Without ``y``, x
      counts taxels; without ``polarity`` as well, it counts channels, and no grid's columns bound it.
    - ``start``: the time in microseconds at which bin 0 begins; None: that of the first event
    - ``span_seconds``: the length of the recording; None if it ends with its last event
    - ``channels``, ``polarities``, ``columns``: those of the format; None if it does not fix them
    - ``step_seconds``: the width of a bin that its format has, if any; ``step_rule``: which bin an event is in
    - ``place``: the name of the recording in errors
    - ``elsewhere``: the number of events of its file that are not read, because they belong to other streams or
      precede the first time in the file
    - ``if_too_long``: the fix that an error suggests if the recording has too many bins
    - ``column_order``: what the columns of its table were taken as, in words; empty for events that are not in a table
    - ``start_is_fixed``: whether its format says when a recording begins, whatever an option says
    - ``unit_is_open``: whether its format leaves the unit of times open
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
    """Recordings in bins, and what is known of them.

    - ``spikes``: (samples, steps, channels) of 0 and 1
    - ``step_seconds``: width of a bin, None if unknown
    - ``binned``: what binning left out, None if the files hold bins
    - ``channels``: the pixels that the channels are, None if the file only numbers its channels
    - ``assumed``: the assumptions made where nothing stated a fact, as sentences for the user
    """

    spikes: ByteArray
    step_seconds: float | None
    binned: Binned | None
    channels: Channels | None
    assumed: tuple[str, ...] = ()


def bin_streams(streams: Sequence[EventStream], where: str, binning: Binning) -> Bins:
    """Return the recordings of one or more streams in bins; ``where`` names them together in errors.

    All recordings get as many channels and steps as the largest needs. Raises ``InputError`` if there are no events and
    no size is given, and for sizes above the limits.
    """
    binning.check()
    # Before the next line, which replaces the starts that were assumed.
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
        threshold=binning.threshold or 0,
        events=events + elsewhere,
        outside=lost.outside,
        below=lost.below,
        elsewhere=elsewhere,
        step_is_default=stated_width is None,
    )
    only_number_channels = all(stream.polarity is None for stream in streams)
    return Bins(
        spikes=spikes.reshape(len(streams), steps, channels),
        step_seconds=width,
        binned=binned,
        channels=None if only_number_channels else sensor,
        assumed=assumed,
    )


class _Placed(Frozen, eq=False):
    """The bin of every event of a recording: its ``step``, a whole number or infinite, and its ``channel``."""

    step: FloatArray
    channel: IntArray


class _Lost(Sums):
    """Numbers of events that no bin shows: those ``outside`` the steps, and those in bins ``below`` the threshold.

    ``Sums`` lets two of them be added field by field.
    """

    outside: int = 0
    below: int = 0


def _highest_channel(placed: Sequence[_Placed]) -> int:
    """Return the highest channel on which there is an event; -1 without any."""
    return max((int(recording.channel.max(initial=-1)) for recording in placed), default=-1)


def _channel_count(
    streams: Sequence[EventStream],
    placed: Sequence[_Placed],
    sensor: Channels,
    binning: Binning,
) -> int:
    """Return the number of channels: that of the options, that of the format, or as many as the events need.

    Of a pixel that has an event of one polarity, all polarities are channels.
    """
    if binning.channels is not None:
        return binning.channels
    reached_channels = _highest_channel(placed) + 1
    reached_pixels = -(-reached_channels // sensor.polarities)
    channels_of_pixels = reached_pixels * sensor.polarities
    return max((stream.channels or channels_of_pixels for stream in streams), default=0)


def _fill(row: ByteArray, placed: _Placed, steps: int, channels: int, threshold: int) -> _Lost:
    """Set to 1 the bins of a recording, ``row`` (steps * channels,), that hold more events than the threshold.

    Return how many events no bin shows.
    """
    is_inside = (placed.step >= 0) & (placed.step < steps)
    bin_of_event = placed.step[is_inside].astype(np.int64) * channels + placed.channel[is_inside]
    bins, counts = np.unique(bin_of_event, return_counts=True)
    row[bins[counts > threshold]] = 1
    return _Lost(
        outside=len(is_inside) - int(is_inside.sum()),
        below=int(counts[counts <= threshold].sum()),
    )


def _starting(stream: EventStream, binning: Binning) -> EventStream:
    """Return the stream with the start that an option states, or else that of the model's training."""
    start = binning.start
    if start is None and not stream.start_is_fixed:
        start = binning.usual_times.start
    if start is None:
        return stream
    if isinstance(start, str):  # "first"
        return replace(stream, start=None)
    return replace(stream, start=start * MICROSECONDS)


def _assumed(streams: Sequence[EventStream], where: str, binning: Binning) -> Iterator[str]:
    """Yield a sentence for each assumption about times and columns that neither format nor option states."""
    orders = sorted({stream.column_order for stream in streams if stream.column_order})
    if orders:
        unit = "" if binning.unit else ", with t in microseconds (--time-unit)"
        yield f"The columns of {where} were taken as {listed(orders, 'or')}{unit}."
    usual = binning.usual_times
    units_open = any(stream.unit_is_open for stream in streams)
    if binning.time_unit is None and usual.time_unit and units_open:
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
    """Return the pixels of the sensor: as the options state them, or else as format, model or events show them.

    A sensor whose events have rows is a grid, any other a row of taxels. ``reached`` is set if only
    the events show its size, because the real sensor may then be larger.
    """
    columns = binning.columns or max(map(_columns, streams), default=1)
    polarities, polarity = _polarities(streams, where, binning, columns)
    if binning.columns is None and binning.channels is not None:
        _check_columns(streams, where, binning.channels, columns, polarities)
    channels_of_format = max((stream.channels or 0 for stream in streams), default=0)
    channels = binning.channels or channels_of_format or None
    # Divisions round up (-(-a // b)): a last pixel or row that is not full still exists.
    if any(stream.y is not None for stream in streams):
        is_grid_stated = binning.columns is not None or channels_of_format > 0
        if channels is not None and is_grid_stated:
            rows = -(-channels // (columns * polarities))
            return Channels(columns, rows, polarities, polarity=polarity)
        rows = max(map(_rows, streams))
        return Channels(columns, rows, polarities, reached=True, polarity=polarity)
    taxels = columns if channels is None else -(-channels // polarities)
    return Channels(taxels, 1, polarities, reached=channels is None, polarity=polarity)


def _columns(stream: EventStream) -> int:
    """Return the columns that the format has, or else those that the events reach; 1 without events."""
    return stream.columns or 1 + int(stream.x.max(initial=0))


def _rows(stream: EventStream) -> int:
    """Return the rows that the events reach; 1 without events, or if they have no rows."""
    if stream.y is None:
        return 1
    return 1 + int(stream.y.max(initial=0))


def _stated_width(streams: Sequence[EventStream], binning: Binning) -> float | None:
    """Return the width of a bin in seconds that an option, the format or the model states; None if none does."""
    if binning.step_seconds is not None:
        return binning.step_seconds
    widths = [stream.step_seconds for stream in streams if stream.step_seconds is not None]
    return min(widths, default=binning.usual_step_seconds)


def _polarities(
    streams: Sequence[EventStream], where: str, binning: Binning, columns: int
) -> tuple[int, int | None]:
    """Return (the number of polarities of the sensor, the only polarity that occurs or None).

    The second is not None only if nothing states the number of polarities and all events have the
    same one: then the sensor may have another, without events in these recordings.
    """
    if binning.merge_polarities:
        return 1, None
    occurring: set[int] = set()
    for stream in streams:
        if stream.polarity is not None:
            occurring |= {int(polarity) for polarity in np.unique(stream.polarity)}
    # First the options, then the format, then the model: the error names the one that is contradicted.
    stated = binning.polarities
    if stated is None and any(stream.polarities == 2 for stream in streams):
        stated = 2
    contradiction = "the sensor has one"
    fix = _APART
    if stated is None and binning.model_inputs is not None:
        # A network over images may have more input planes than the two polarities that events can have.
        stated = min(binning.model_inputs.polarities, 2)
        contradiction = "the model takes one"
        fix = "Merge them by --merge-polarities."
    if stated == 1 and len(occurring) > 1:
        raise InputError(where, f"its events have two polarities, but {contradiction}", fix=fix)
    if stated is not None:
        return stated, None
    if len(occurring) > 1:
        return 2, None
    _check_one_polarity(streams, where, binning.model_channels, columns)
    return 1, next(iter(occurring), None)


def _check_one_polarity(
    streams: Sequence[EventStream], where: str, channels: int | None, columns: int
) -> None:
    """Refuse events of one polarity whose x may count either taxels or the channels of a model.

    If the model has 2 n channels, x may be one of n taxels with two polarities each, or directly one
    of the 2 n channels. Only an x of n or more decides it.
    """
    pixels_by_stream = [
        _pixels(stream, columns)
        for stream in streams
        if stream.polarity is not None and len(stream.x)
    ]
    if channels is None or channels % 2 == 1 or not pixels_by_stream:
        return
    highest = max(int(pixels.max()) for pixels in pixels_by_stream)
    # Taxel x would have channels 2 x and 2 x + 1. If these are within the model, x may be a taxel.
    if 2 * highest < channels:
        measured = f"up to {highest} of {counted(channels, 'channel')}"
        fix = "Give --polarities 2 (taxels) or 1 (channels)."
        what = "its events have one polarity, so x may count taxels or channels"
        raise InputError(where, what, measured=measured, fix=fix)


def _check_columns(
    streams: Sequence[EventStream], where: str, channels: int, columns: int, polarities: int
) -> None:
    """Refuse a grid whose width only the events show, unless they fill the stated channels exactly.

    Another file might reach fewer or more columns, and its pixels would then get other channels.
    """
    rows = 1
    for stream in streams:
        if stream.columns is None:
            rows = max(rows, _rows(stream))
    is_width_guessed = rows > 1
    if is_width_guessed and columns * rows * polarities != channels:
        what = "the width of its grid is not known"
        measured = f"up to {columns} x {rows} in {counted(channels, 'channel')}"
        fix = "Give --grid WxH of the sensor."
        raise InputError(where, what, measured=measured, fix=fix)


def _bins(stream: EventStream, width_seconds: float) -> FloatArray:
    """Return the step of every event, (events,), whole numbers in float64.

    Absurdly late times overflow to infinity, which lies outside the steps like any late event.
    """
    width = width_seconds * MICROSECONDS
    if abs(width - round(width)) < ROUNDING_SLACK:
        # 0.0003 s is not quite 300 microseconds in floats, and an event at 300 belongs to bin 1, not 0.
        width = round(width)
    with np.errstate(over="ignore"):
        since_start = stream.times - stream.began
        if stream.step_rule == "nearest":
            # Both in milliseconds, as SLAYER divides: where the quotient is near a half, the rounding
            # of the division decides which step an event is in.
            return np.rint(since_start / 1000 / (width / 1000))
        return np.floor(since_start / width)


def _length(stream: EventStream, placed: _Placed, width_seconds: float, binning: Binning) -> int:
    """Return the number of steps of a recording; 0 if it has neither events nor a span."""
    if binning.steps is not None:
        return binning.steps
    last_step = _last_step(stream, placed, width_seconds)
    # "Not below" rather than "at least", so that nan counts as too long as well.
    if binning.most_steps is not None and not last_step < binning.most_steps:
        return binning.most_steps
    if not last_step < binning.max_steps:
        raise _too_long(stream, last_step, width_seconds, binning.max_steps)
    return math.floor(last_step) + 1


def _last_step(stream: EventStream, placed: _Placed, width_seconds: float) -> float:
    """Return the last step of a recording, which the caller rounds down: -1 for none, infinite for absurd times."""
    if stream.span_seconds is not None:
        # Whole bins only; the slack makes up for a quotient that rounds below a whole number.
        return stream.span_seconds / width_seconds - 1 + ROUNDING_SLACK
    return float(placed.step.max(initial=-1.0))


def _too_long(
    stream: EventStream, last_step: float, width_seconds: float, max_steps: int
) -> InputError:
    """Return the error of a recording of more than ``max_steps`` bins."""
    if math.isinf(last_step):
        # Absurd times overflow to infinity once they are counted in bins.
        span_seconds = last_step * width_seconds
    else:
        span_seconds = float(stream.times.max() - stream.began) / MICROSECONDS
    event_span_seconds = float(stream.times.max() - stream.first_event) / MICROSECONDS
    begins_late = stream.start is not None and stream.first_event > stream.start
    fix = stream.if_too_long
    # Often the times of a file count from 1970, or from the start of the computer that recorded it.
    if begins_late and event_span_seconds < width_seconds * max_steps:
        fix = "Start it at its first event with --start first."
    return InputError(
        stream.place,
        "it lasts too long for its bins",
        measured=f"{span_seconds:g} s in bins of {width_seconds:g} s against {max_steps} bins",
        fix=fix,
    )


def _channels(stream: EventStream, sensor: Channels) -> IntArray:
    """Return the channel of every event, (events,); on a sensor of one polarity, the polarity does not matter."""
    if stream.polarity is None:
        return stream.x  # It counts channels already.
    columns = sensor.columns
    if stream.y is not None and int(stream.x.max(initial=0)) >= columns:
        raise InputError(
            stream.place,
            "an event lies outside the grid",
            measured=f"x {int(stream.x.max())} against {columns} columns",
            fix="Give more columns.",
        )
    pixels = _pixels(stream, columns)
    if sensor.polarities == 1:
        return pixels
    return sensor.polarities * pixels + stream.polarity


def _pixels(stream: EventStream, columns: int) -> IntArray:
    """Return the pixel of every event, counted row by row; without rows, x counts pixels."""
    if stream.y is None:
        return stream.x
    return columns * stream.y + stream.x


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
    """Return (microseconds, pixel, polarity) of events that make up one recording (steps, channels), sorted by time.

    This is the inverse of binning: every bin of 1 becomes one event. Its time is chosen so that a
    reader of the format that knows the width of a bin puts it back into the same step:

    - ``floor``: the middle of its bin, except that the first event lies at the start of its bin
    - ``nearest``: the start of its step, which readers that round down put into the same step
    """
    steps, channels = np.nonzero(spikes)  # in order of steps, so of time
    width = step_seconds * MICROSECONDS
    if step_rule == "nearest":
        times = np.ceil(steps * width)
    else:
        times = np.floor((steps + 0.5) * width)
        # Readers may take the time of the first event for the start of bin 0, so this one may not lie
        # in the middle of its bin: all others would be half a bin early.
        times[:1] = np.ceil(steps[:1] * width)
    return times.astype(np.int64), channels // polarities, channels % polarities
