"""Lists of events, compiled: the same as those of :mod:`hw_model.engine.playing`, made in one pass over a recording."""

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
    # A copy of what is read-only: loops are compiled anew for it.
    plain = recordings if recordings.flags.carray else np.array(recordings, order="C")

    def listed(low: int, high: int) -> list[tuple[IntArray, Int32Array]]:
        lists = []
        for start in range(low, high, recordings_at_a_time):
            stop = min(start + recordings_at_a_time, high)
            events = plain[start:stop].reshape(-1)
            starts = first[start:stop]
            # Where bytes are few there is room for all. Others are counted as booleans, which numpy does fastest.
            is_little = events.size <= LITTLE
            most_events = events.size if is_little else np.count_nonzero(events.view(np.bool_))
            channel = np.empty(most_events + CACHE_LINE, dtype=np.int32)
            event_count, above_1 = called(list_into, events, channels, starts, channel)
            if above_1:
                raise not_binary(name)
            channel = channel[:event_count]
            # Of several parts each is copied, so that no spare room is held while the others are listed.
            lists.append((starts, channel if stop - low == batch else channel.copy()))
        return lists

    events_before = 0
    parts = [part for parts in in_parts(listed, batch, plain.size) for part in parts]
    for starts, channel in parts:
        starts += events_before
        events_before += len(channel)
    return EventLists(first, joined([channel for _, channel in parts]))


def transpose(events: EventLists, item: Input, steps: int) -> EventLists:
    """Return what the buffer plays of a transposed input in ``steps`` steps, lists of that many rows.

    An event (step t, channel c) becomes line ``first_lines[c] + t`` at step ``positions[c]``, if both exist.
    """
    visit_of, first_lines, begins = _visits(item, steps)
    # Room for all that the loop writes.
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
    """Return the visit and the first line of every channel, and the first visit of every step."""
    at, first_lines = item.visits
    # Channels of one step have lines of their own, so that visit by visit, and by time within one, lines ascend.
    visits = np.lexsort((first_lines, at))
    # A copy, whatever is given: loops are compiled anew for what is read-only.
    return np.argsort(visits), first_lines.copy(), np.searchsorted(at[visits], np.arange(steps + 1))


@kernel("events, at, channel, index, first, left", returns=2)
def _list_line(events: Place, channel: Place, first: LlvmValue, left: LlvmValue) -> LlvmValues:
    """List which of the next ``left`` bytes, of those in a line of the cache, are not 0: channels ``first`` on.

    Return how many are, and how many in the whole line are above 1.
    """
    line = events.of(CACHE_LINE)[0]
    return put_lane_numbers(channel, first_lanes(line != 0, left), first), count((line & 254) != 0)


@absorbed
def list_row(events, low, channels, channel, listed):  # type: ignore[no-untyped-def]
    """List the events of a row of channels, bytes from ``low`` on, behind those that are ``listed`` already.

    Return how many are listed then, and a number above 0 if a byte of the row, or near it, is above 1. ``channel`` has
    room for all events and, behind them, for a line of the cache.
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
        for c in range(at - low, channels):
            channel[listed] = c
            listed += np.uint64(events[low + c] != 0)
            above_1 |= events[low + c] > 1
    return listed, above_1


@compiled
def list_into(events, channels, first, channel):  # type: ignore[no-untyped-def]
    """List rows of channels, bytes side by side, into ``first`` (batch, rows + 1) and ``channel``.

    Return how many events there are, and a number above 0 if a byte is above 1. ``channel`` has room for all of them
    and, behind, for a line of the cache.
    """
    listed = np.uint64(0)
    low = 0
    above_1 = np.int32(0)
    for b in range(first.shape[0]):
        first[b, 0] = listed
        for row in range(1, first.shape[1]):
            listed, line_above_1 = list_row(events, low, channels, channel, listed)
            above_1 |= line_above_1
            low += channels
            first[b, row] = listed
    return listed, above_1


@compiled
def _transpose(  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    starts, channel, visit_of, first_lines, begins, rows, first, line, place
):
    """Sort the events of every recording by visit, in the order of time within one, and return how many there are.

    Visits ``begins[step]`` to ``begins[step + 1]`` are those of a step; later ones than all are left out. ``place`` has
    room for a number a visit, and one more.
    """
    visits = begins[-1]
    spikes = 0
    for b in range(len(starts)):
        for visit in range(visits + 1):
            place[visit] = 0
        for e in range(starts[b, 0], starts[b, rows]):
            visit = visit_of[channel[e]]
            if visit < visits:
                place[visit + 1] += 1
        place[0] = spikes
        for visit in range(visits):
            place[visit + 1] += place[visit]
        spikes = place[visits]
        for step in range(len(begins)):
            first[b, step] = place[begins[step]]
        for t in range(rows):
            for e in range(starts[b, t], starts[b, t + 1]):
                visit = visit_of[channel[e]]
                if visit < visits:
                    line[place[visit]] = first_lines[channel[e]] + t
                    place[visit] += 1
    return spikes
