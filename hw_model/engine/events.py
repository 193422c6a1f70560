"""Lists of events, compiled: the same as those of :mod:`hw_model.engine.playing`, made in one pass over a recording."""

from functools import lru_cache

import numpy as np

from hw_model.engine.compiled import compiled
from hw_model.engine.trace import EventLists
from hw_model.mapping.graph import Input
from hw_model.values import ByteArray, IntArray


def list_events(recordings: ByteArray) -> EventLists:
    """Return the spikes of recordings (batch, rows, channels), 0 or 1, as lists."""
    first = np.zeros((len(recordings), recordings.shape[1] + 1), dtype=np.int64)
    channel = np.empty(np.count_nonzero(recordings) + 1, dtype=np.int32)
    # A copy of what is read-only: loops are compiled anew for it.
    plain = recordings if recordings.flags.carray else np.array(recordings, order="C")
    _list(plain, first, channel)
    return EventLists(first, channel[:-1])


def transpose(events: EventLists, item: Input, steps: int) -> EventLists:
    """Return what the buffer plays of a transposed input in ``steps`` steps, lists of so many rows.

    An event (step t, channel c) becomes line ``first_lines[c] + t`` at step ``positions[c]``, if both exist.
    """
    visit_of, first_lines, begins = _visits(item, steps)
    first = np.empty((len(events.first), steps + 1), dtype=np.int64)
    many = min(item.rows, events.rows)
    line = np.empty(int(events.until(many).sum()), dtype=np.int32)
    place = np.empty(begins[-1] + 1, dtype=np.int64)
    found = _transpose(events.first, events.channel, visit_of, first_lines, begins, many, first, line, place)
    return EventLists(first, line[:found])


@lru_cache(maxsize=8)
def _visits(item: Input, steps: int) -> tuple[IntArray, IntArray, IntArray]:
    """Return the visit and the first line of every channel, and the first visit of every step."""
    assert item.positions is not None
    # A copy, whatever is given: loops are compiled anew for what is read-only.
    first_lines = np.zeros_like(item.positions) if item.first_lines is None else np.array(item.first_lines)
    # Channels of one step have lines of their own, so that visit by visit, and by time within one, lines ascend.
    visits = np.lexsort((first_lines, item.positions))
    return np.argsort(visits), first_lines, np.searchsorted(item.positions[visits], np.arange(steps + 1))


@compiled
def _list(recordings, first, channel):  # type: ignore[no-untyped-def]
    many = np.uint64(0)
    for b in range(first.shape[0]):
        first[b, 0] = many
        for row in range(recordings.shape[1]):
            for c in range(recordings.shape[2]):
                # Every channel is written, and stays where it has a spike: a branch would be guessed wrong too often.
                channel[many] = c
                many += np.uint64(recordings[b, row, c] != 0)
            first[b, row + 1] = many


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
