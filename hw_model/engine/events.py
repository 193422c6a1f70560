"""Compiled versions of ``list_events`` and ``transpose`` of :mod:`hw_model.engine.playing`.

They return the same lists. Listing looks at 64 bytes of a recording at a time and, for large
batches, in threads.
"""

from functools import lru_cache

import numpy as np

from hw_model.engine.compiled import absorbed, called, compiled
from hw_model.engine.lanes import LlvmValue, LlvmValues, Place, count, first_lanes, put_lane_numbers
from hw_model.engine.layout import CACHE_LINE
from hw_model.engine.playing import not_binary
from hw_model.engine.private_numba import kernel
from hw_model.engine.threads import LITTLE, in_parts
from hw_model.engine.trace import EventLists
from hw_model.mapping.graph import Input
from hw_model.values import ByteArray, Int32Array, IntArray, joined


def list_events(name: str, recordings: ByteArray) -> EventLists:
    """Return the spikes of a stream's recordings, bytes (batch, rows, channels), as lists."""
    batch, rows, channels = recordings.shape
    first = np.empty((batch, rows + 1), dtype=np.int64)
    recordings_at_a_time = max(1, LITTLE // max(1, rows * channels))
    # `carray` means writable and in C order. Others are copied: numba would compile the loops again for them.
    plain = recordings if recordings.flags.carray else np.array(recordings, order="C")

    def list_part(low: int, high: int) -> list[tuple[IntArray, Int32Array]]:
        """List recordings ``low..high``; return the starts, views of ``first``, and channels of each part."""
        lists = []
        for start in range(low, high, recordings_at_a_time):
            stop = min(start + recordings_at_a_time, high)
            events = plain[start:stop].reshape(-1)
            starts = first[start:stop]
            # For few bytes, reserve room for an event in each. Else count the events first, as booleans, which numpy
            # counts fastest.
            is_little = events.size <= LITTLE
            most_events = events.size if is_little else np.count_nonzero(events.view(np.bool_))
            channel = np.empty(most_events + CACHE_LINE, dtype=np.int32)
            event_count, above_1 = called(list_into, events, channels, starts, channel)
            if above_1:
                raise not_binary(name)
            channel = channel[:event_count]
            # With several parts, copy each one's events to free its spare room while the others are listed.
            is_only_part = stop - low == batch
            lists.append((starts, channel if is_only_part else channel.copy()))
        return lists

    parts = []
    for parts_of_thread in in_parts(list_part, batch, plain.size):
        parts += parts_of_thread
    # Each part has counted from 0: shift its starts by the events of all parts before it.
    events_before = 0
    for starts, channel in parts:
        starts += events_before
        events_before += len(channel)
    return EventLists(first, joined([channel for _, channel in parts]))


def transpose(events: EventLists, item: Input, steps: int) -> EventLists:
    """Return what the buffer plays of a transposed input in ``steps`` steps, lists of that many rows.

    An event (step t, channel c) becomes line ``first_lines[c] + t`` at step ``positions[c]``, if both exist.
    """
    visit_of, first_lines, begins = _visits(item, steps)
    # The loop creates no arrays, so it gets all that it writes to.
    first = np.empty((len(events.first), steps + 1), dtype=np.int64)
    rows = min(item.rows, events.rows)
    line = np.empty(len(events.channel), dtype=np.int32)
    place = np.empty(begins[-1] + 1, dtype=np.int64)
    starts = np.ascontiguousarray(events.first)
    spikes = called(
        _transpose, starts, events.channel, visit_of, first_lines, begins, rows, first, line, place
    )
    return EventLists(first, line[:spikes])


@lru_cache(maxsize=8)
def _visits(item: Input, steps: int) -> tuple[IntArray, IntArray, IntArray]:
    """Return the number of the visit and the first line of every channel, and the first visit of every step.

    A visit is one reading of a channel. Visits are numbered by step and, within a step, by line.
    """
    step_of_channel, first_lines = item.visits
    # Channels of one step have lines of their own. So, visit by visit and by time within a visit, lines ascend.
    visits = np.lexsort((first_lines, step_of_channel))
    first_visit_of_step = np.searchsorted(step_of_channel[visits], np.arange(steps + 1))
    # A copy is writable: for read-only arrays numba would compile the loops again.
    return np.argsort(visits), first_lines.copy(), first_visit_of_step


@kernel("events, at, channel, index, first, left", returns=2)
def _list_line(events: Place, channel: Place, first: LlvmValue, left: LlvmValue) -> LlvmValues:
    """List the bytes that are not 0 among the next ``left`` bytes of a cache line; the first is channel ``first``.

    Return how many there are, and how many bytes of the whole line are above 1.
    """
    line = events.of(CACHE_LINE)[0]  # 64 bytes as one vector
    return put_lane_numbers(channel, first_lanes(line != 0, left), first), count((line & 254) != 0)


@absorbed
def list_row(events, low, channels, channel, listed):  # type: ignore[no-untyped-def]
    """Append the events of a row, ``channels`` bytes from ``low`` on, to ``channel``, which holds ``listed`` already.

    Return how many are listed then, and a number above 0 if a byte of the row is above 1, or a byte behind the row in
    its last cache line, which belongs to a later row. ``channel`` has room for a cache line behind all events.
    """
    above_1 = np.int32(0)
    for at in range(low, low + channels, CACHE_LINE):
        if at + CACHE_LINE <= len(events):
            in_line, line_above_1 = _list_line(
                events, at, channel, listed, at - low, low + channels - at
            )
            listed += np.uint64(in_line)
            above_1 |= line_above_1
            continue
        # The end of the array: byte by byte. A channel is written even without an event, and then overwritten.
        for c in range(at - low, channels):
            channel[listed] = c
            listed += np.uint64(events[low + c] != 0)
            above_1 |= events[low + c] > 1
    return listed, above_1


@compiled
def list_into(events, channels, first, channel):  # type: ignore[no-untyped-def]
    """List the events of rows of ``channels`` bytes, side by side, into ``first`` (batch, rows + 1) and ``channel``.

    Return how many events there are, and a number above 0 if a byte is above 1. ``channel`` has room for a cache line
    behind all events.
    """
    listed = np.uint64(0)
    low = 0
    above_1 = np.int32(0)
    for recording in range(first.shape[0]):
        first[recording, 0] = listed
        for row in range(1, first.shape[1]):
            listed, line_above_1 = list_row(events, low, channels, channel, listed)
            above_1 |= line_above_1
            low += channels
            first[recording, row] = listed
    return listed, above_1


@compiled
def _transpose(  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    starts, channel, visit_of, first_lines, begins, rows, first, line, place
):
    """Sort the events of every recording by visit and, within a visit, by time; return how many there are.

    Step s has the visits ``begins[s]`` to ``begins[s + 1] - 1``; events of later visits are left out. It is a counting
    sort: count the events of each visit, add up where each visit begins, then put every event in its place. ``place``
    has room for one number per visit, and one more.
    """
    visits = begins[-1]
    spikes = 0
    for recording in range(len(starts)):
        for visit in range(visits + 1):
            place[visit] = 0
        for event in range(starts[recording, 0], starts[recording, rows]):
            visit = visit_of[channel[event]]
            if visit < visits:
                place[visit + 1] += 1
        place[0] = spikes
        for visit in range(visits):
            place[visit + 1] += place[visit]
        spikes = place[visits]
        for step in range(len(begins)):
            first[recording, step] = place[begins[step]]
        for t in range(rows):
            for event in range(starts[recording, t], starts[recording, t + 1]):
                visit = visit_of[channel[event]]
                if visit < visits:
                    line[place[visit]] = first_lines[channel[event]] + t
                    place[visit] += 1
    return spikes
