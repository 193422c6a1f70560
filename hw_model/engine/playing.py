"""Turn recordings into spikes on the input lines of a phase.

Some inputs play a recording as it is: channel c at step t is line c at step t. *Transposed* inputs
go through the transpose buffer, which keeps the recording and plays it channel by channel: location
neurons step over channels, and each step *visits* one or several. A phase may also wait for the
first touch: the first row in which its streams together have some number of events.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np

from hw_model.arithmetic.whole import REAL_KINDS
from hw_model.engine.trace import PLAYED, EventLists, PhaseInput
from hw_model.errors import InputError
from hw_model.io.arguments import as_array
from hw_model.mapping.graph import Input, Phase
from hw_model.values import AnyArray, ArrayLike, ByteArray, Frozen, IntArray

Spikes = ArrayLike | Mapping[str, ArrayLike]
"""Recordings as users pass them: an array, or one for each stream by name."""


class HasInputs(Protocol):
    """What this module needs of a program: its recordings and its inputs. Programs of every arithmetic have them."""

    @property
    def streams(self) -> Mapping[str, int]:
        """The number of channels of every recording that the program takes, by name."""

    def inputs_of(self, phase: str) -> tuple[Input, ...]:
        """Return the inputs of a phase."""


def read_streams(
    program: HasInputs, spikes: Spikes, listed: bool = False
) -> tuple[dict[str, ByteArray], bool]:
    """Return every stream as (batch, steps, channels) of 0 and 1, and whether the caller passed a batch axis.

    ``listed``: the caller will list the events, which refuses bytes other than 0 and 1. They are not
    checked here then. Raises ``InputError``.
    """
    expected = program.streams
    # Arrays first, because `isinstance` is slow with Mapping, an abstract class.
    if isinstance(spikes, np.ndarray) or not isinstance(spikes, Mapping):
        spikes = {name: spikes for name in list(expected)[:1]}
    if spikes.keys() != expected.keys():
        what = "its streams are not the program's inputs"
        names = ", ".join(sorted(expected))
        raise InputError(
            "spikes", what, measured=names, fix="Give a mapping with one array for each."
        )
    arrays: dict[str, ByteArray] = {}
    for name, channels in expected.items():
        arrays[name] = _stream(name, spikes[name], channels, listed)
    shapes = [array.shape[:-1] for array in arrays.values()]
    if any(shape != shapes[0] for shape in shapes):
        raise InputError(
            "spikes", "the streams differ in batch or steps", fix="Give arrays of equal length."
        )
    is_batch = len(shapes[0]) == 2
    if not is_batch:
        arrays = {name: array[None] for name, array in arrays.items()}
    return arrays, is_batch


def _stream(name: str, given: ArrayLike, channels: int, listed: bool) -> ByteArray:
    """Check one stream, and return it as bytes."""
    where = f"spikes of {name!r}"
    array: AnyArray = given if isinstance(given, np.ndarray) else as_array(where, given)
    if array.ndim not in (2, 3) or array.shape[-1] != channels:
        measured = f"{array.shape} against (steps, {channels}) or (batch, steps, {channels})"
        raise InputError(
            where, "the shape does not fit", measured=measured, fix="Give one column per channel."
        )
    if array.dtype != np.uint8:
        is_real = array.dtype.kind in REAL_KINDS
        is_binary = is_real and bool(((array == 0) | (array == 1)).all())
    else:
        is_binary = listed or array.max(initial=0) <= 1
    if not is_binary:
        raise not_binary(name)
    return array.astype(np.uint8, copy=False)


def not_binary(name: str) -> InputError:
    """Return the error for a stream with values other than 0 and 1."""
    fix = "Binarise the events; graded spikes do not exist here."
    return InputError(f"spikes of {name!r}", "values other than 0 and 1", fix=fix)


def list_events(name: str, recordings: ByteArray) -> EventLists:
    """Return the spikes of a stream's recordings, bytes (batch, rows, channels), as lists.

    :func:`hw_model.engine.events.list_events` is the compiled version.
    """
    batch, rows, channels = recordings.shape
    if recordings.max(initial=0) > 1:
        raise not_binary(name)
    # Rows of all recordings, numbered one recording after the other. `max` avoids a division by 0 without channels.
    row, channel = divmod(np.flatnonzero(recordings), max(channels, 1))
    starts = np.searchsorted(row, np.arange(batch * rows + 1))
    # Each recording repeats the start of the next one as its own end: rows + 1 numbers.
    first_row = np.arange(batch) * rows
    first = starts[np.add.outer(first_row, np.arange(rows + 1))]
    return EventLists(first, channel.astype(np.int32))


def transpose(events: EventLists, item: Input, steps: int) -> EventLists:
    """Return what the transpose buffer plays to an input in ``steps`` steps: lists of that many rows.

    An event (step t, channel c) becomes a spike of line ``first_lines[c] + t`` at step
    ``positions[c]``. It is lost if there is no such line or step.
    :func:`hw_model.engine.events.transpose` is the compiled version.
    """
    step_of_channel, first_lines = item.visits
    rows = min(item.rows, events.rows)
    transposed = np.zeros((len(events.first), steps, item.size), dtype=np.uint8)
    for recording, starts in enumerate(events.first):
        channel = events.channel[starts[0] : starts[rows]]
        row = np.repeat(np.arange(rows), np.diff(starts[: rows + 1]))
        line = row + first_lines[channel]
        step = step_of_channel[channel]
        is_played = step < steps
        transposed[recording, step[is_played], line[is_played]] = 1
    return list_events(item.stream, transposed)


class Player(Frozen):
    """Two functions on events, plain or compiled: each engine brings its own, and both give the same lists."""

    list_events: Callable[[str, ByteArray], EventLists] = list_events
    transpose: Callable[[EventLists, Input, int], EventLists] = transpose


def play(
    program: HasInputs,
    phase: Phase,
    streams: Mapping[str, EventLists],
    steps: int | None,
    player: Player,
) -> PhaseInput:
    """Return the spikes of a phase's input lines. The phase has ``steps`` steps if the program does not fix them."""
    any_stream = next(iter(streams.values()))
    rows = any_stream.rows
    batch = len(any_stream.first)
    steps_of_phase = length_of(program, phase, rows, steps)
    inputs = program.inputs_of(phase.name)
    is_aligned = phase.align_events is not None
    # Views of one array in the order of PLAYED: adding to them fills it.
    counts = np.zeros((len(PLAYED), batch), dtype=np.int64)
    played, transposed, dropped, rows_before_start = counts

    # Each recording runs in steps start..stop, without stop.
    start = np.zeros(batch, dtype=np.int64)
    stop = start + steps_of_phase
    if phase.align_events is not None:
        names = {item.stream for item in inputs}
        rows_before_start[:] = first_touch([streams[name] for name in names], phase.align_events)
        if phase.axis == "time":
            # Recordings start at their own touch, in arrays that have room for the latest start. One without any
            # touch starts at the end, so that none of its steps is run.
            last_step = steps_of(program, phase, rows, steps)
            start = np.where(rows_before_start < rows, rows_before_start, last_step)
            stop = np.minimum(start + steps_of_phase, last_step)
            steps_of_phase = last_step

    lists = []
    for item in inputs:
        recorded = streams[item.stream]
        if item.positions is None:
            from_start = recorded.between(start, stop) if is_aligned else recorded
            on_lines = _fit(from_start, steps_of_phase)
            played += on_lines.events
        else:
            # In the buffer, the row of the first touch is row 0.
            from_start = recorded.moved(rows_before_start) if is_aligned else recorded
            on_lines = player.transpose(from_start, item, steps_of_phase)
            transposed += on_lines.events
        lists.append(on_lines)
        if on_lines is not recorded:
            dropped += recorded.events - on_lines.events
    sizes = tuple(item.size for item in inputs)
    return PhaseInput(steps_of_phase, sizes, tuple(lists), counts, start, stop)


def length_of(program: HasInputs, phase: Phase, rows: int, steps: int | None = None) -> int:
    """Return the number of steps of a phase.

    It is the phase's own, else ``steps``, else as many as its recordings have rows and its
    transposed inputs have visits, whichever is more.
    """
    fixed = phase.steps or steps
    if fixed:
        return fixed
    lengths = []
    for item in program.inputs_of(phase.name):
        if item.positions is None:
            lengths.append(rows)
        else:
            last_visit = int(item.positions.max(initial=0))
            lengths.append(last_visit + 1)
    return max(lengths, default=rows)


def steps_of(program: HasInputs, phase: Phase, rows: int, steps: int | None = None) -> int:
    """Return the number of steps that the arrays of a phase have, which may be more than its length.

    A phase over time that begins at the first touch may begin in any row of a recording, so its
    arrays have at least as many steps as the recording has rows.
    """
    length = length_of(program, phase, rows, steps)
    begins_at_touch = phase.align_events is not None and phase.axis == "time"
    return max(length, rows) if begins_at_touch else length


def first_touch(streams: Sequence[EventLists], events: int) -> IntArray:
    """Return the first row in which all streams together have at least ``events`` events, (batch,).

    For a recording without such a row it is the number of rows.
    """
    events_of_row = np.sum([np.diff(lists.first, axis=1) for lists in streams], axis=0)
    has_touched = np.logical_or.accumulate(events_of_row >= events, axis=1)
    return np.asarray((~has_touched).sum(axis=1), dtype=np.int64)


def _fit(events: EventLists, length: int) -> EventLists:
    """Cut lists to a length in steps, or append rows without events."""
    if length == events.rows:
        return events
    # An appended row begins and ends where the last one ends.
    row = np.minimum(np.arange(length + 1), events.rows)
    return EventLists(events.first[:, row], events.channel)
