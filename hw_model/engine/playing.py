"""How recordings become spikes on a phase's input lines: as they come, or through the transpose buffer."""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np

from hw_model.engine.trace import PLAYED, EventLists, PhaseInput
from hw_model.errors import InputError
from hw_model.io.given import as_array
from hw_model.mapping.graph import Input, Phase
from hw_model.values import AnyArray, ArrayLike, ByteArray, Frozen, IntArray

Spikes = ArrayLike | Mapping[str, ArrayLike]


class HasInputs(Protocol):
    """A program of any arithmetic, as far as recordings concern it."""

    @property
    def streams(self) -> Mapping[str, int]:
        """The recordings that it expects, by name, with their number of channels."""

    def inputs_of(self, phase: str) -> tuple[Input, ...]:
        """Return the inputs of a phase."""


def read_streams(
    program: HasInputs, spikes: Spikes, listed: bool = False
) -> tuple[dict[str, ByteArray], bool]:
    """Return every stream as (batch, steps, channels) of 0 and 1, and whether a batch was given.

    ``listed``: bytes are looked at when they are listed, and others than 0 and 1 refused then.
    """
    expected = program.streams
    # Arrays first: to find out that one is not a mapping takes a while.
    if isinstance(spikes, np.ndarray) or not isinstance(spikes, Mapping):
        spikes = {name: spikes for name in list(expected)[:1]}
    if spikes.keys() != expected.keys():
        what = "its streams are not the program's inputs"
        names = ", ".join(sorted(expected))
        raise InputError(
            "spikes", what, measured=names, fix="Give a mapping with one array for each."
        )
    arrays = {
        name: _stream(name, spikes[name], channels, listed) for name, channels in expected.items()
    }
    shape, *others = (array.shape[:-1] for array in arrays.values())
    if any(other != shape for other in others):
        raise InputError(
            "spikes", "the streams differ in batch or steps", fix="Give arrays of equal length."
        )
    batched = len(shape) == 2
    return {name: array if batched else array[None] for name, array in arrays.items()}, batched


def _stream(name: str, given: ArrayLike, channels: int, listed: bool) -> ByteArray:
    where = f"spikes of {name!r}"
    array: AnyArray = given if isinstance(given, np.ndarray) else as_array(where, given)
    if array.ndim not in (2, 3) or array.shape[-1] != channels:
        measured = f"{array.shape} against (steps, {channels}) or (batch, steps, {channels})"
        raise InputError(
            where, "the shape does not fit", measured=measured, fix="Give one column per channel."
        )
    if array.dtype != np.uint8:
        binary = array.dtype.kind in "buif" and bool(((array == 0) | (array == 1)).all())
    else:
        binary = listed or array.max(initial=0) <= 1
    if not binary:
        raise not_binary(name)
    return array.astype(np.uint8, copy=False)


def not_binary(name: str) -> InputError:
    """Return what to raise where a stream has values other than 0 and 1."""
    fix = "Binarise the events; graded spikes do not exist here."
    return InputError(f"spikes of {name!r}", "values other than 0 and 1", fix=fix)


def list_events(name: str, recordings: ByteArray) -> EventLists:
    """Return the spikes of a stream's recordings, bytes (batch, rows, channels), as lists."""
    batch, rows, channels = recordings.shape
    if recordings.max(initial=0) > 1:
        raise not_binary(name)
    row, channel = divmod(np.flatnonzero(recordings), max(channels, 1))
    starts = np.searchsorted(row, np.arange(batch * rows + 1))
    first = starts[np.add.outer(np.arange(batch) * rows, np.arange(rows + 1))]
    return EventLists(first, channel.astype(np.int32))


def transpose(events: EventLists, item: Input, steps: int) -> EventLists:
    """Return what the buffer plays of a transposed input in ``steps`` steps, lists of that many rows.

    An event (step t, channel c) becomes line ``first_lines[c] + t`` at step ``positions[c]``, if both exist.
    """
    at, first_lines = item.visits
    rows = min(item.rows, events.rows)
    turned = np.zeros((len(events.first), steps, item.size), dtype=np.uint8)
    for b, starts in enumerate(events.first):
        channel = events.channel[starts[0] : starts[rows]]
        line = np.repeat(np.arange(rows), np.diff(starts[: rows + 1])) + first_lines[channel]
        played = at[channel] < steps
        turned[b, at[channel[played]], line[played]] = 1
    return list_events(item.stream, turned)


class Player(Frozen):
    """How events are listed and transposed; the two engines bring their own, which give the same lists."""

    list_events: Callable[[str, ByteArray], EventLists] = list_events
    transpose: Callable[[EventLists, Input, int], EventLists] = transpose


def play(
    program: HasInputs,
    phase: Phase,
    streams: Mapping[str, EventLists],
    steps: int | None,
    player: Player,
) -> PhaseInput:
    """Lay recordings out as the lines of a phase, of ``steps`` steps where it does not fix them."""
    rows, batch = next((events.rows, len(events.first)) for events in streams.values())
    steps_of_phase = length_of(program, phase, rows, steps)
    inputs = program.inputs_of(phase.name)
    is_aligned = phase.align_events is not None
    # Views of one array, in the order of PLAYED.
    counts = np.zeros((len(PLAYED), batch), dtype=np.int64)
    played, transposed, dropped, rows_before_start = counts

    # From which step to which each recording runs.
    start = np.zeros(batch, dtype=np.int64)
    stop = start + steps_of_phase
    if phase.align_events is not None:
        names = {item.stream for item in inputs}
        rows_before_start[:] = first_touch([streams[name] for name in names], phase.align_events)
        if phase.axis == "time":
            last_step = steps_of(program, phase, rows, steps)
            start = np.where(rows_before_start < rows, rows_before_start, last_step)
            stop = np.minimum(start + steps_of_phase, last_step)
            steps_of_phase = last_step

    lists = []
    for item in inputs:
        recorded = streams[item.stream]
        if item.positions is None:
            heard = recorded.between(start, stop) if is_aligned else recorded
            lists.append(_fit(heard, steps_of_phase))
            counted = played
        else:
            heard = recorded.moved(rows_before_start) if is_aligned else recorded
            lists.append(player.transpose(heard, item, steps_of_phase))
            counted = transposed
        events_played = lists[-1].events
        counted += events_played
        if lists[-1] is not recorded:
            dropped += recorded.events - events_played
    sizes = tuple(item.size for item in inputs)
    return PhaseInput(steps_of_phase, sizes, tuple(lists), counts, start, stop)


def length_of(program: HasInputs, phase: Phase, rows: int, steps: int | None = None) -> int:
    """Return the steps of a phase: its own, else those asked for, else until its recording and its visits are over."""
    fixed = phase.steps or steps
    if fixed:
        return fixed
    visits = [item.positions for item in program.inputs_of(phase.name)]
    return max((rows if at is None else int(at.max(initial=0)) + 1 for at in visits), default=rows)


def steps_of(program: HasInputs, phase: Phase, rows: int, steps: int | None = None) -> int:
    """Return the steps of a phase with those of the recording before its start: where a touch comes last."""
    length = length_of(program, phase, rows, steps)
    return max(length, rows) if phase.align_events is not None and phase.axis == "time" else length


def first_touch(streams: Sequence[EventLists], events: int) -> IntArray:
    """Return the first row in which streams have at least ``events`` together, (batch,), or the number of rows."""
    enough = np.sum([np.diff(lists.first, axis=1) for lists in streams], axis=0) >= events
    return np.asarray((enough.cumsum(axis=1) == 0).sum(axis=1), dtype=np.int64)


def _fit(events: EventLists, length: int) -> EventLists:
    """Cut lists, or follow them by silence, to a length in steps."""
    if length == events.rows:
        return events
    return EventLists(
        events.first[:, np.minimum(np.arange(length + 1), events.rows)], events.channel
    )
