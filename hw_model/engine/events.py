"""Lists of events, compiled: the same as those of :mod:`hw_model.engine.playing`, eight bytes of a recording at a
time."""

import numpy as np

from hw_model.engine.compiled import compiled, in_parts, trailing_zeros
from hw_model.engine.trace import EventLists
from hw_model.mapping.graph import Input
from hw_model.values import ByteArray, Int32Array


def list_events(recordings: ByteArray) -> EventLists:
    """Return the spikes of recordings (batch, rows, channels), 0 or 1, as lists."""
    batch, rows, channels = recordings.shape
    first = np.zeros((batch, rows + 1), dtype=np.int64)
    if first.size == batch or channels == 0:
        return EventLists(first, np.empty(0, dtype=np.int32))
    flat = np.ascontiguousarray(recordings).reshape(-1)
    whole = len(flat) // 8 * 8
    words, last_word = flat[:whole].view(np.uint64), np.uint64(int.from_bytes(flat[whole:].tobytes(), "little"))

    def scan(start: int, stop: int) -> tuple[int, int, Int32Array]:
        begin, end = start * rows * channels, stop * rows * channels
        channel = np.empty(np.count_nonzero(flat[begin:end]), dtype=np.int32)
        busy = np.empty((end - begin) // 8 + 2, dtype=np.int64)
        _scan(words, last_word, begin, channels, first[start:stop], busy, channel)
        return start, stop, channel

    parts = in_parts(scan, batch)
    before = 0
    for start, stop, channel in parts:
        first[start:stop] += before
        before += len(channel)
    return EventLists(first, parts[0][2] if len(parts) == 1 else np.concatenate([part[2] for part in parts]))


def transpose(events: EventLists, item: Input, steps: int) -> EventLists:
    """Return what the buffer plays of a transposed input in ``steps`` steps, lists of so many rows.

    An event (step t, channel c) becomes line ``first_lines[c] + t`` at step ``positions[c]``, if both exist.
    """
    assert item.positions is not None
    # A copy, whatever is given: loops are compiled anew for what is read-only.
    first_lines = np.zeros_like(item.positions) if item.first_lines is None else np.array(item.first_lines)
    # Channels of one step have lines of their own, so that visit by visit, and by time within one, lines ascend.
    visits = np.lexsort((first_lines, item.positions))
    visit_of = np.argsort(visits)
    begins = np.searchsorted(item.positions[visits], np.arange(steps + 1))
    first = np.empty((len(events.first), steps + 1), dtype=np.int64)
    many = min(item.rows, events.rows)
    line = np.empty(int(events.until(many).sum()), dtype=np.int32)
    place = np.empty(begins[-1] + 1, dtype=np.int64)
    found = _transpose(events.first, events.channel, visit_of, first_lines, begins, many, first, line, place)
    return EventLists(first, line[:found])


@compiled
def _scan(words, last_word, begin, channels, first, busy, channel):  # type: ignore[no-untyped-def]
    """Fill ``first`` and ``channel`` of some recordings, the first of which begins at byte ``begin``.

    ``last_word``: the bytes behind the last whole word. Bytes of other recordings in the outer words are masked away.
    ``busy``: room for a number a word.
    """
    batch, rows = first.shape[0], first.shape[1] - 1
    size = rows * channels
    end = begin + batch * size
    many = np.int64(0)
    recording, row, row_end = 0, 0, begin + channels
    first[0, 0] = 0
    whole = np.uint64(len(words))
    start, stop = np.uint64(begin // 8), np.uint64((end + 7) // 8)
    # Every index is written and only those of words with spikes are kept: a branch would be guessed wrong too often.
    found = np.uint64(0)
    for k in range(start, min(stop, whole)):
        busy[found] = k
        found += np.uint64(words[k] != 0)
    if stop > whole:
        busy[found] = whole
        found += np.uint64(1)
    for b in range(found):
        k = busy[b]
        word = words[np.uint64(k)] if k < whole else last_word
        at = k * 8
        if at < begin:
            word &= ~np.uint64(0) << np.uint64(8 * (begin - at))
        if at + 8 > end:
            word &= ~np.uint64(0) >> np.uint64(8 * (at + 8 - end))
        while word:
            byte = at + (trailing_zeros(word) >> 3)
            word &= word - np.uint64(1)
            while byte >= row_end:
                row += 1
                first[recording, row] = many
                row_end += channels
                if row == rows:
                    recording, row = recording + 1, 0
                    first[recording, 0] = many
            channel[np.uint64(many)] = byte - row_end + channels
            many += 1
    while recording < batch:
        row += 1
        first[recording, row] = many
        if row == rows:
            recording, row = recording + 1, 0
            if recording < batch:
                first[recording, 0] = many


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
