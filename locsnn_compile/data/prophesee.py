"""Recordings of Prophesee's cameras: ``.raw`` in EVT2 or EVT3, and ``.dat``.

Layouts: Prophesee's pages on "EVT 2.0" and "DAT" (docs.prophesee.ai); :mod:`.prophesee_evt3` has that
of EVT3. All three begin with lines ``% name value``. Coordinates count from the upper left, polarity 1
is brighter, times are microseconds.

- EVT2, words of 32 bits, kind in bits 31..28: an event (0 darker, 1 brighter) has the low 6 bits of
  its time in 27..22, x in 21..11, y in 10..0; 8 sets the high 28 bits of the time for all events
  behind it. Words of all other kinds are skipped
- DAT: two bytes for kind and size of an event, then 32 bits of time, and 32 with x in 13..0, y in
  27..14 and polarity in 28
"""

import re

import numpy as np

from hw_model.values import AnyArray, IntArray
from locsnn_compile.data.camera_words import (
    MOST_PIXELS_PER_SIDE,
    CameraEvents,
    SensorSize,
    camera_stream,
    check_event_count,
    latest_set,
    records,
    unwrapped,
)
from locsnn_compile.data.event_stream import EventStream
from locsnn_compile.data.file_headers import FileHeader, split_header
from locsnn_compile.data.prophesee_evt3 import evt3_events
from locsnn_compile.errors import InputError, check_most

_EVT2_VERSION = r"(EVT)?2(\.0)?(;|$)"
_EVT3_VERSION = r"(EVT)?3(\.0)?(;|$)"
"""As headers write them: ``2.0`` behind ``% evt``, and ``EVT3;height=720;...`` behind ``% format``."""
_SIZE_PATTERNS = (
    r"\b(?P<width>\d{1,9})x(?P<height>\d{1,9})\b",
    r"width=(?P<width>\d{1,9});height=(?P<height>\d{1,9})",
    r"height=(?P<height>\d{1,9});width=(?P<width>\d{1,9})",
)
"""How headers state the size of a sensor."""

_EVT2_BRIGHTER = 1
_EVT2_TIME_HIGH = 8
_EVT2_TIME_HIGH_BITS = 28
_EVT2_TIME_LOW_BITS = 6
_EVT2_UNTIMED = -1
"""The time of words that precede the first word that sets one; all other times are 0 or more."""

_DAT_VERSION = "2"
_DAT_KINDS = (0, 12)
"""Kinds of events of pixels in ``.dat`` files."""
_DAT_EVENT_BYTES = 8
_DAT_TIME_BITS = 32


def parse_raw(data: bytes, where: str) -> EventStream:
    """Return the events of a ``.raw`` file; ``InputError`` for other formats and damaged files."""
    header = split_header(data, b"%", "end", where)
    version = header.value("evt") or header.value("format")
    size = _sensor_size(header, where)
    if re.match(_EVT2_VERSION, version):
        return camera_stream(_evt2_events(header.body, where), size, where)
    if re.match(_EVT3_VERSION, version):
        return camera_stream(evt3_events(header.body, where), size, where)
    measured = f"{version[:40]!r}" if version else "no line '% evt'"
    what = "it is not a recording in EVT2 or EVT3"
    fix = "Convert it to EVT3, .dat or HDF5 with Prophesee's tools."
    raise InputError(where, what, measured=measured, fix=fix)


def parse_dat(data: bytes, where: str) -> EventStream:
    """Return the events of a ``.dat`` file; ``InputError`` for other formats and damaged files."""
    header = split_header(data, b"%", "end", where)
    _check_dat(header, where)
    # The first two bytes are the kind and the size of all events.
    events = _dat_events(header.body[2:], where)
    return camera_stream(events, _sensor_size(header, where), where)


def _sensor_size(header: FileHeader, where: str) -> SensorSize:
    """Return the size that a header states in any of its ways; ``InputError`` if it is absurd.

    The size is ``SensorSize()``, which means unknown, if it states none.
    """
    geometry = header.value("geometry")
    # All texts that may state it, in one, so that each pattern is tried on all of them.
    sides = f"{header.value('width')}x{header.value('height')}"
    stated = f"{geometry} {sides} {header.value('format')}"
    for pattern in _SIZE_PATTERNS:
        match = re.search(pattern, stated)
        if match is not None:
            size = SensorSize(int(match["width"]), int(match["height"]))
            largest = max(size.width, size.height)
            what = "its sensor is too large"
            fix = "Correct the size in its header."
            check_most(largest, MOST_PIXELS_PER_SIDE, where, what, unit="pixels", fix=fix)
            return size
    return SensorSize()


# EVT2.


def _evt2_events(body: bytes, where: str) -> CameraEvents:
    """Return the events in words of EVT2."""
    words = records(body, "<u4", where)
    kind = words >> 28
    is_event = kind <= _EVT2_BRIGHTER
    check_event_count(int(is_event.sum()), where)
    time_start = _evt2_time_starts(words, kind)
    is_timed = is_event & (time_start != _EVT2_UNTIMED)
    events = words[is_timed].astype(np.int64)
    return CameraEvents(
        times=time_start[is_timed] + (events >> 22 & 0x3F),
        x=events >> 11 & 0x7FF,
        y=events & 0x7FF,
        polarity=events >> 28,
        unplaced=int((is_event & ~is_timed).sum()),
    )


def _evt2_time_starts(words: AnyArray, kind: AnyArray) -> IntArray:
    """Return for each word the time set last, without its low bits, in microseconds, (words,)."""
    sets_time = kind == _EVT2_TIME_HIGH
    counter = (words[sets_time] & 0xFFFFFFF).astype(np.int64)
    time_high = unwrapped(counter, _EVT2_TIME_HIGH_BITS)
    time_start = np.zeros(len(words), dtype=np.int64)
    time_start[sets_time] = time_high << _EVT2_TIME_LOW_BITS
    return latest_set(time_start, sets_time, _EVT2_UNTIMED)


# DAT.


def _check_dat(header: FileHeader, where: str) -> None:
    """Refuse other versions, and events that are not pixels' by the two bytes in front of them."""
    version = header.value("version")
    if version != _DAT_VERSION or len(header.body) < 2:
        measured = f"version {version[:40]!r}" if version else "no line '% Version'"
        what = "it is not a DAT file of version 2"
        fix = "Convert it with Prophesee's tools."
        raise InputError(where, what, measured=measured, fix=fix)
    kind, event_bytes = header.body[:2]
    if kind not in _DAT_KINDS or event_bytes != _DAT_EVENT_BYTES:
        measured = f"kind {kind} of {event_bytes} bytes"
        fix = "Give a file of CD events, kind 12 of 8 bytes."
        raise InputError(where, "its events are not those of pixels", measured=measured, fix=fix)


def _dat_events(body: bytes, where: str) -> CameraEvents:
    """Return the events of a ``.dat`` file: the low half of each is its time, the high its place."""
    words = records(body, "<u8", where)
    check_event_count(len(words), where)
    times = (words & 0xFFFFFFFF).astype(np.int64)
    places = (words >> 32).astype(np.int64)
    return CameraEvents(
        times=unwrapped(times, _DAT_TIME_BITS),
        x=places & 0x3FFF,
        y=places >> 14 & 0x3FFF,
        polarity=places >> 28 & 1,
    )
