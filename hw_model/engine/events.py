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
    together = max(1, LITTLE // max(1, rows * channels))
    # A copy of what is read-only: loops are compiled anew for it.
    plain = recordings if recordings.flags.carray else np.array(recordings, order="C")

    def listed(low: int, high: int) -> list[tuple[IntArray, Int32Array]]:
        found = []
        for start in range(low, high, together):
            stop = min(start + together, high)
            given = plain[start:stop].reshape(-1)
            starts = first[start:stop]
            # Where bytes are few there is room for all. Others are counted as booleans, which numpy does fastest.
            most = given.size if given.size <= LITTLE else np.count_nonzero(given.view(np.bool_))
            channel = np.empty(most + CACHE_LINE, dtype=np.int32)
            many, larger = called(list_into, given, channels, starts, channel)
            if larger:
                raise not_binary(name)
            found.append((starts, channel[:many] if stop - low == batch else channel[:many].copy()))
        return found

    before = 0
    parts = [part for parts in in_parts(listed, batch, plain.size) for part in parts]
    for starts, channel in parts:
        starts += before
        before += len(channel)
    return EventLists(first, joined([channel for _, channel in parts]))


def transpose(events: EventLists, item: Input, steps: int) -> EventLists:
    """Return what the buffer plays of a transposed input in ``steps`` steps, lists of that many rows.

    An event (step t, channel c) becomes line ``first_lines[c] + t`` at step ``positions[c]``, if both exist.
    """
    visit_of, first_lines, begins = _visits(item, steps)
    first = np.empty((len(events.first), steps + 1), dtype=np.int64)
    many = min(item.rows, events.rows)
    line = np.empty(len(events.channel), dtype=np.int32)
    place = np.empty(begins[-1] + 1, dtype=np.int64)
    starts = np.ascontiguousarray(events.first)
    found = called(
        _transpose, starts, events.channel, visit_of, first_lines, begins, many, first, line, place
    )
    return EventLists(first, line[:found])


@lru_cache(maxsize=8)
def _visits(item: Input, steps: int) -> tuple[IntArray, IntArray, IntArray]:
    """Return the visit and the first line of every channel, and the first visit of every step."""
    at, first_lines = item.visits
    # Channels of one step have lines of their own, so that visit by visit, and by time within one, lines ascend.
    visits = np.lexsort((first_lines, at))
    # A copy, whatever is given: loops are compiled anew for what is read-only.
    return np.argsort(visits), first_lines.copy(), np.searchsorted(at[visits], np.arange(steps + 1))


@kernel("given, at, channel, many, first, left", returns=2)
def _list_line(given: Place, channel: Place, first: LlvmValue, left: LlvmValue) -> LlvmValues:
    """List which of the next ``left`` bytes, of those in a line of the cache, are not 0: channels ``first`` on.

    Return how many are, and how many in the whole line are above 1.
    """
    line = given.of(CACHE_LINE)[0]
    return put_lane_numbers(channel, first_lanes(line != 0, left), first), count((line & 254) != 0)


@absorbed
def list_row(given, low, channels, channel, many):  # type: ignore[no-untyped-def]
    """List a row of channels, bytes from ``low`` on, behind the ``many`` that are listed.

    Return how many are, and a number above 0 if a byte of the row, or near it, is above 1. ``channel`` has room for
    all events and, behind them, for a line of the cache.
    """
    larger = np.int32(0)
    for at in range(low, low + channels, CACHE_LINE):
        if at + CACHE_LINE <= len(given):
            found, above = _list_line(given, at, channel, many, at - low, low + channels - at)
            many += np.uint64(found)
            larger |= above
            continue
        for c in range(at - low, channels):
            channel[many] = c
            many += np.uint64(given[low + c] != 0)
            larger |= given[low + c] > 1
    return many, larger


@compiled
def list_into(given, channels, first, channel):  # type: ignore[no-untyped-def]
    """List rows of channels, bytes side by side, into ``first`` (batch, rows + 1) and ``channel``.

    Return how many events there are, and a number above 0 if a byte is above 1. ``channel`` has room for all of them
    and, behind, for a line of the cache.
    """
    many = np.uint64(0)
    low = 0
    larger = np.int32(0)
    for b in range(first.shape[0]):
        first[b, 0] = many
        for row in range(1, first.shape[1]):
            many, above = list_row(given, low, channels, channel, many)
            larger |= above
            low += channels
            first[b, row] = many
    return many, larger


@compiled
def _transpose(  # type: ignore[no-untyped-def]
    given, channel, visit_of, first_lines, begins, many, first, line, place
):
    """Sort the events of every recording by visit, in the order of time within one, and return how many there are.

    Visits ``begins[step]`` to ``begins[step + 1]`` are those of a step; later ones than all are left out. ``place`` has
    room for a number a visit, and one more.
    """
    visits = begins[-1]
    so_far = 0
    for b in range(len(given)):
        for visit in range(visits + 1):
            place[visit] = 0
        for e in range(given[b, 0], given[b, many]):
            visit = visit_of[channel[e]]
            if visit < visits:
                place[visit + 1] += 1
        place[0] = so_far
        for visit in range(visits):
            place[visit + 1] += place[visit]
        so_far = place[visits]
        for step in range(len(begins)):
            first[b, step] = place[begins[step]]
        for t in range(many):
            for e in range(given[b, t], given[b, t + 1]):
                visit = visit_of[channel[e]]
                if visit < visits:
                    line[place[visit]] = first_lines[channel[e]] + t
                    place[visit] += 1
    return so_far
