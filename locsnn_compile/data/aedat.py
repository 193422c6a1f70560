"""Recordings of iniVation's cameras in ``.aedat``: AEDAT 2.0 of jAER, and AEDAT 3.1 of cAER.

Layouts: iniVation's pages on "AEDAT 2.0" and "AEDAT 3.1". Both begin with lines ``#...``, the first of
which names the version. Polarity 1 is brighter. Numbers are kept as the file has them, so rows count
from the bottom in AEDAT 2.0, and from the top in AEDAT 3.1.

- 2.0: an address and a time in microseconds, 32 bits each, high byte first. Addresses of a DVS128:
  polarity in bit 0, x in 7..1, y in 14..8, bit 15 for an input. Of a DAVIS: polarity in bit 11, x in
  21..12, y in 30..22, bit 10 for an input, bit 31 for a sample of an image
- 3.1: packets of events of one kind behind a head of 28 bytes, low byte first. An event of a pixel has
  x in bits 31..17, y in 16..2, polarity in 1, bit 0 if it is valid, and 31 bits of time
"""

import re
import struct
from collections.abc import Iterator

import numpy as np

from hw_model.values import Frozen, IntArray
from locsnn_compile.data.camera_words import (
    CameraEvents,
    SensorSize,
    camera_stream,
    records,
    unwrapped,
)
from locsnn_compile.data.event_stream import MAX_EVENTS, EventStream
from locsnn_compile.data.file_headers import FileHeader, split_header
from locsnn_compile.errors import InputError, check_most

_SIZES = {
    "dvs128": SensorSize(128, 128),
    "davis128": SensorSize(128, 128),
    "davis208": SensorSize(208, 192),
    "davis240": SensorSize(240, 180),
    "davis346": SensorSize(346, 260),
    "davis640": SensorSize(640, 480),
}
"""Cameras by how their names begin, in lower case. Sizes: iniVation's page on AEDAT 3.1."""
_PACKET_HEAD = struct.Struct("<HHIIIIII")
_POLARITY_PACKET = 1
_DAVIS_X_FROM_BIT = 12
_EVENT_BYTES = 8


def parse_aedat(data: bytes, where: str) -> EventStream:
    """Return the events of an ``.aedat`` file; ``InputError`` for other versions and damage."""
    first = data[:40].split(b"\n")[0].strip()
    if first == b"#!AER-DAT2.0":
        header = split_header(data, b"#", "end of ascii header")
        return _aedat2_stream(header, where)
    if first in (b"#!AER-DAT3.0", b"#!AER-DAT3.1"):
        header = split_header(data, b"#", "!end-header")
        return _aedat3_stream(header, where)
    fix = "Give AEDAT 2.0 or 3.1, or AEDAT4 with the ending .aedat4."
    measured = f"its first line is {first[:20].decode('latin-1')!r}"
    raise InputError(where, "it is not an AEDAT file", measured=measured, fix=fix)


def _camera(text: str) -> str:
    """Return the camera that a text names, as a key of ``_SIZES``; empty for none of them."""
    names = re.findall(r"d(?:vs|avis)\d{3}", text.lower())
    return next((name for name in names if name in _SIZES), "")


def _aedat2_stream(header: FileHeader, where: str) -> EventStream:
    """Return the events of AEDAT 2.0."""
    chip = header.value("AEChip")
    camera = _camera(chip)
    if not camera:
        what = "its header does not name a camera that is known"
        measured = f"{chip[-40:]!r}" if chip else "no line '# AEChip'"
        fix = "Add '# AEChip: DVS128', or the name of a DAVIS."
        raise InputError(where, what, measured=measured, fix=fix)
    pairs = records(header.body, ">u8", where)
    what = "it has too many events"
    check_most(len(pairs), MAX_EVENTS, where, what, fix="Give a part of it.")
    address = (pairs >> 32).astype(np.int64)
    times = unwrapped((pairs & 0xFFFFFFFF).astype(np.int64), 32)
    if camera.startswith("dvs"):
        is_pixel = address >> 15 == 0
        x = address >> 1 & 0x7F
        y = address >> 8 & 0x7F
        polarity = address & 1
    else:
        is_pixel = (address >> 31 == 0) & (address >> 10 & 1 == 0)
        x = address >> _DAVIS_X_FROM_BIT & 0x3FF
        y = address >> 22 & 0x1FF
        polarity = address >> 11 & 1
    events = CameraEvents(
        times=times[is_pixel], x=x[is_pixel], y=y[is_pixel], polarity=polarity[is_pixel]
    )
    return camera_stream(events, _SIZES[camera], where)


class _Packet(Frozen, eq=False):
    """The ``words`` of a packet of pixels: (events, 2), data and time, and the ``source`` of it.

    ``time_wraps`` counts how often the 31 bits of time had wrapped.
    """

    words: IntArray
    source: int
    time_wraps: int


def _aedat3_stream(header: FileHeader, where: str) -> EventStream:
    """Return the events of AEDAT 3.1: those of the first source that has any."""
    form = header.value("Format") or "RAW"
    if form != "RAW":
        what = "its events are compressed"
        fix = "Record in the format RAW."
        raise InputError(where, what, measured=f"format {form[:20]!r}", fix=fix)
    packets = list(_pixel_packets(header.body, where))
    source = packets[0].source if packets else 0
    own = [packet for packet in packets if packet.source == source]
    words = np.concatenate([np.zeros((0, 2), dtype=np.int64), *(one.words for one in own)])
    lengths = [len(packet.words) for packet in own]
    wraps = np.repeat([packet.time_wraps for packet in own], lengths).astype(np.int64)
    is_valid = words[:, 0] & 1 != 0
    data = words[is_valid, 0]
    camera = _camera(_source_line(header, source))
    events = CameraEvents(
        times=words[is_valid, 1] + (wraps[is_valid] << 31),
        x=data >> 17,
        y=data >> 2 & 0x7FFF,
        polarity=data >> 1 & 1,
        unplaced=sum(len(packet.words) for packet in packets if packet.source != source),
    )
    return camera_stream(events, _SIZES.get(camera, SensorSize()), where)


def _source_line(header: FileHeader, source: int) -> str:
    """Return what a header says of a source, as in ``Source 1: DVS128``; empty if nothing."""
    begin = f"Source {source}:"
    return next((line for line in header.lines if line.startswith(begin)), "")


def _pixel_packets(body: bytes, where: str) -> Iterator[_Packet]:
    """Yield the packets of pixels in the bytes behind a header."""
    begin = 0
    count = 0
    while begin < len(body):
        content = begin + _PACKET_HEAD.size
        if content > len(body):
            raise _cut(where, f"byte {begin} behind its header begins a packet")
        kind, source, event_bytes, _, wraps, _, number, _ = _PACKET_HEAD.unpack_from(body, begin)
        end = content + event_bytes * number
        if event_bytes == 0 or end > len(body):
            raise _cut(where, f"a packet of {number} events of {event_bytes} bytes")
        if kind == _POLARITY_PACKET:
            if event_bytes != _EVENT_BYTES:
                measured = f"{event_bytes} bytes against {_EVENT_BYTES}"
                what = "its events of pixels have another size"
                raise InputError(where, what, measured=measured, fix="Give a whole file.")
            count += number
            what = "it has too many events"
            check_most(count, MAX_EVENTS, where, what, fix="Give a part of it.")
            words = np.frombuffer(body, dtype="<u4", count=2 * number, offset=content)
            if number:
                yield _Packet(words.reshape(-1, 2).astype(np.int64), source, wraps)
        begin = end


def _cut(where: str, measured: str) -> InputError:
    """Return the error for packets that do not fill a file."""
    return InputError(
        where, "it is damaged or truncated", measured=measured, fix="Give a whole file."
    )
