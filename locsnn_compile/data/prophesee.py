"""Recordings of Prophesee's cameras: ``.raw`` in EVT2 or EVT3, and ``.dat``.

Layouts: Prophesee's pages on "EVT 2.0", "EVT 3.0" and "DAT" (docs.prophesee.ai). All three begin with
lines ``% name value``. Coordinates count from the upper left, polarity 1 is brighter.

- EVT2, words of 32 bits, kind in bits 31..28: an event (0 darker, 1 brighter) has the low 6 bits of
  its time in 27..22, x in 21..11, y in 10..0; 8 has the other 28 bits of the time
- EVT3, words of 16 bits, kind in 15..12: 0 sets y; 2 is an event at x, polarity in bit 11; 3 sets x
  and polarity of a vector; 4 and 5 are its next 12 or 8 pixels, a bit for each event; 6 and 8 set
  the low and the high 12 bits of the time, which wraps after 16.8 s
- DAT: two bytes for kind and size of an event, then 32 bits of time, and 32 with x in 13..0, y in
  27..14 and polarity in 28
"""

import re
from collections.abc import Iterator

import numpy as np

from hw_model.values import Frozen, IntArray
from locsnn_compile.data.camera_words import (
    MOST_PIXELS_PER_SIDE,
    CameraEvents,
    SensorSize,
    camera_stream,
    held,
    records,
    unwrapped,
)
from locsnn_compile.data.event_stream import MAX_EVENTS, EventStream
from locsnn_compile.data.file_headers import FileHeader, split_header
from locsnn_compile.errors import InputError, check_most

_EVT2_BRIGHTER, _EVT2_TIME_HIGH = 1, 8
_EVT2_TIME_LOW_BITS = 6
_EVT3_KIND_FROM_BIT = 12
_EVT3_Y, _EVT3_X, _EVT3_VECTOR, _EVT3_NEXT_12, _EVT3_NEXT_8 = 0, 2, 3, 4, 5
_EVT3_TIME_LOW, _EVT3_TIME_HIGH = 6, 8
_EVT3_TIME_BITS = 12
EVT3_CHUNK_WORDS = 1 << 18
"""Words that are decoded at once, which bounds the memory that this takes."""
_UNSET = -(1 << 40)
"""A place or time before the first that is set: below zero, whatever is added to it."""
_SIZE_PATTERNS = (
    r"\b(?P<width>\d{1,9})x(?P<height>\d{1,9})\b",
    r"width=(?P<width>\d{1,9});height=(?P<height>\d{1,9})",
    r"height=(?P<height>\d{1,9});width=(?P<width>\d{1,9})",
)
"""How headers state the size of a sensor."""
_DAT_KINDS = (0, 12)
"""Kinds of events of pixels in ``.dat`` files."""
_DAT_EVENT_BYTES = 8


def parse_raw(data: bytes, where: str) -> EventStream:
    """Return the events of a ``.raw`` file; ``InputError`` for other formats and damaged files."""
    header = split_header(data, b"%", "end")
    version = header.value("evt") or header.value("format")
    size = _sensor_size(header, where)
    if re.match(r"(EVT)?2(\.0)?(;|$)", version):
        return camera_stream(_evt2_events(header.body, where), size, where)
    if re.match(r"(EVT)?3(\.0)?(;|$)", version):
        return camera_stream(_evt3_events(header.body, where), size, where)
    measured = f"{version[:40]!r}" if version else "no line '% evt'"
    what = "it is not a recording in EVT2 or EVT3"
    fix = "Convert it to EVT3, .dat or HDF5 with Prophesee's tools."
    raise InputError(where, what, measured=measured, fix=fix)


def parse_dat(data: bytes, where: str) -> EventStream:
    """Return the events of a ``.dat`` file; ``InputError`` for other formats and damaged files."""
    header = split_header(data, b"%", "end")
    version = header.value("version")
    if version != "2" or len(header.body) < 2:
        measured = f"version {version[:40]!r}" if version else "no line '% Version'"
        what = "it is not a DAT file of version 2"
        fix = "Convert it with Prophesee's tools."
        raise InputError(where, what, measured=measured, fix=fix)
    kind, event_bytes = header.body[:2]
    if kind not in _DAT_KINDS or event_bytes != _DAT_EVENT_BYTES:
        measured = f"kind {kind} of {event_bytes} bytes"
        fix = "Give a file of CD events, kind 12 of 8 bytes."
        raise InputError(where, "its events are not those of pixels", measured=measured, fix=fix)
    words = records(header.body[2:], "<u8", where)
    check_most(len(words), MAX_EVENTS, where, "it has too many events", fix="Give a part of it.")
    times = (words & 0xFFFFFFFF).astype(np.int64)
    places = (words >> 32).astype(np.int64)
    events = CameraEvents(
        times=unwrapped(times, 32),
        x=places & 0x3FFF,
        y=places >> 14 & 0x3FFF,
        polarity=places >> 28 & 1,
    )
    return camera_stream(events, _sensor_size(header, where), where)


def _sensor_size(header: FileHeader, where: str) -> SensorSize:
    """Return the size that a header states in one of three ways."""
    width, height = header.value("width"), header.value("height")
    form = header.value("format")
    stated = f"{header.value('geometry')} {width}x{height} {form}"
    for pattern in _SIZE_PATTERNS:
        sides = re.search(pattern, stated)
        if sides is not None:
            size = SensorSize(int(sides["width"]), int(sides["height"]))
            largest = max(size.width, size.height)
            what = "its sensor is too large"
            fix = "Correct the size in its header."
            check_most(largest, MOST_PIXELS_PER_SIDE, where, what, unit="pixels", fix=fix)
            return size
    return SensorSize()


def _evt2_events(body: bytes, where: str) -> CameraEvents:
    """Return the events in words of EVT2."""
    words = records(body, "<u4", where)
    kind = words >> 28
    is_event = kind <= _EVT2_BRIGHTER
    check_most(
        int(is_event.sum()), MAX_EVENTS, where, "it has too many events", fix="Give a part of it."
    )
    sets_time = kind == _EVT2_TIME_HIGH
    high = np.zeros(len(words), dtype=np.int64)
    high[sets_time] = (
        unwrapped((words[sets_time] & 0xFFFFFFF).astype(np.int64), 28) << _EVT2_TIME_LOW_BITS
    )
    began = held(high, sets_time, _UNSET)[is_event]
    events = words[is_event].astype(np.int64)
    is_timed = began >= 0
    events = events[is_timed]
    return CameraEvents(
        times=began[is_timed] + (events >> 22 & 0x3F),
        x=events >> 11 & 0x7FF,
        y=events & 0x7FF,
        polarity=events >> 28,
        unplaced=int((~is_timed).sum()),
    )


class _Evt3State(Frozen):
    """What words before a chunk have set: both parts of the time, the row, and the next vector."""

    time_high: int = _UNSET
    time_low: int = 0
    y: int = _UNSET
    vector_x: int = _UNSET
    vector_polarity: int = 0


def _evt3_events(body: bytes, where: str) -> CameraEvents:
    """Return the events in words of EVT3, decoded chunk by chunk."""
    words = records(body, "<u2", where)
    chunks: list[CameraEvents] = []
    count = 0
    for chunk in _evt3_chunks(words, where):
        chunks.append(chunk)
        count += len(chunk.times)
        check_most(count, MAX_EVENTS, where, "it has too many events", fix="Give a part of it.")
    return CameraEvents(
        times=_joined([chunk.times for chunk in chunks]),
        x=_joined([chunk.x for chunk in chunks]),
        y=_joined([chunk.y for chunk in chunks]),
        polarity=_joined([chunk.polarity for chunk in chunks]),
        unplaced=sum(chunk.unplaced for chunk in chunks),
    )


def _joined(parts: list[IntArray]) -> IntArray:
    """Return parts in one array, which is empty without any."""
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])


def _evt3_chunks(words: IntArray, where: str) -> Iterator[CameraEvents]:
    """Yield the events of chunk after chunk."""
    state = _Evt3State()
    for begin in range(0, len(words), EVT3_CHUNK_WORDS):
        chunk = words[begin : begin + EVT3_CHUNK_WORDS].astype(np.int64)
        events, state = _evt3_chunk(chunk, state)
        yield events


def _evt3_chunk(words: IntArray, state: _Evt3State) -> tuple[CameraEvents, _Evt3State]:
    """Return the events of a chunk of words, and what the words leave set for the next."""
    kind = words >> _EVT3_KIND_FROM_BIT
    payload = words & 0xFFF
    time_high = _evt3_time_high(kind, payload, state.time_high)
    # A new high part begins at a low part of 0, until that is set as well.
    is_new_high = np.diff(time_high, prepend=state.time_high) != 0
    is_low = kind == _EVT3_TIME_LOW
    time_low = held(np.where(is_low, payload, 0), is_low | is_new_high, state.time_low)
    y = held(payload & 0x7FF, kind == _EVT3_Y, state.y)

    pixels_per_word = np.where(kind == _EVT3_NEXT_12, 12, 0) + np.where(kind == _EVT3_NEXT_8, 8, 0)
    pixels_before = np.cumsum(pixels_per_word) - pixels_per_word
    sets_vector = kind == _EVT3_VECTOR
    vector_begin = held((payload & 0x7FF) - pixels_before, sets_vector, state.vector_x)
    vector_polarity = held(payload >> 11, sets_vector, state.vector_polarity)

    single = np.flatnonzero(kind == _EVT3_X)
    vector = np.flatnonzero(pixels_per_word)
    offsets = np.arange(_EVT3_TIME_BITS)
    is_valid = payload[vector, None] >> offsets & 1 != 0
    is_valid &= offsets < pixels_per_word[vector, None]
    row_of_vector, offset = np.nonzero(is_valid)
    in_vector = vector[row_of_vector]
    word = np.concatenate((single, in_vector))
    x = np.concatenate(
        (payload[single] & 0x7FF, (vector_begin + pixels_before)[in_vector] + offset)
    )
    polarity = np.concatenate((payload[single] >> 11, vector_polarity[in_vector]))
    order = np.argsort(word, kind="stable")
    events = _placed(
        (time_high << _EVT3_TIME_BITS | time_low)[word[order]],
        x[order],
        y[word[order]],
        polarity[order],
    )
    pixels = int(pixels_per_word.sum())
    last = _Evt3State(
        time_high=int(time_high[-1]),
        time_low=int(time_low[-1]),
        y=int(y[-1]),
        vector_x=int(vector_begin[-1]) + pixels,
        vector_polarity=int(vector_polarity[-1]),
    )
    return events, last


def _evt3_time_high(kind: IntArray, payload: IntArray, before: int) -> IntArray:
    """Return at each word the high part of the time, without the wraps of its 12 bits."""
    is_high = kind == _EVT3_TIME_HIGH
    counter = payload[is_high]
    if before >= 0:
        began = before >> _EVT3_TIME_BITS << _EVT3_TIME_BITS
        counter = unwrapped(np.append(before - began, counter), _EVT3_TIME_BITS)[1:] + began
    else:
        counter = unwrapped(counter, _EVT3_TIME_BITS)
    high = np.zeros(len(kind), dtype=np.int64)
    high[is_high] = counter
    return held(high, is_high, before)


def _placed(times: IntArray, x: IntArray, y: IntArray, polarity: IntArray) -> CameraEvents:
    """Return the events whose time, column and row are all set."""
    is_placed = (times >= 0) & (x >= 0) & (y >= 0)
    return CameraEvents(
        times=times[is_placed],
        x=x[is_placed],
        y=y[is_placed],
        polarity=polarity[is_placed],
        unplaced=int((~is_placed).sum()),
    )
