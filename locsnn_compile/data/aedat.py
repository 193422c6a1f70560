"""Recordings of iniVation's cameras in ``.aedat``: AEDAT 2.0 of jAER, and AEDAT 3.1 of cAER.

Layouts: iniVation's pages on "AEDAT 2.0" and "AEDAT 3.1". Both begin with lines ``#...``, the first of
which names the version. Polarity 1 is brighter. Numbers are kept as the file has them, so rows count
from the bottom in AEDAT 2.0, and from the top in AEDAT 3.1.

- 2.0: an address and a time in microseconds, 32 bits each, high byte first. Addresses of a DVS128:
  polarity in bit 0, x in 7..1, y in 14..8, bit 15 for an input. Of a DAVIS: polarity in bit 11, x in
  21..12, y in 30..22, bit 10 for an input, bit 31 for a sample of an image
- 3.1: packets of events of one kind behind a head of 28 bytes, low byte first. An event of a pixel has
  x in bits 31..17, y in 16..2, polarity in 1, bit 0 if it is valid, and 31 bits of time. Packets of
  all other kinds are skipped
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
    check_event_count,
    records,
    unwrapped,
)
from locsnn_compile.data.event_stream import EventStream
from locsnn_compile.data.file_headers import FileHeader, split_header
from locsnn_compile.errors import InputError

_SIZES = {
    "dvs128": SensorSize(width=128, height=128),
    "davis128": SensorSize(width=128, height=128),
    "davis208": SensorSize(width=208, height=192),
    "davis240": SensorSize(width=240, height=180),
    "davis346": SensorSize(width=346, height=260),
    "davis640": SensorSize(width=640, height=480),
}
"""Cameras by how their names begin, in lower case. Sizes: iniVation's page on AEDAT 3.1."""
_AEDAT2_FIRST_LINES = (b"#!AER-DAT2.0",)
_AEDAT3_FIRST_LINES = (b"#!AER-DAT3.0", b"#!AER-DAT3.1")
_AEDAT2_TIME_BITS = 32

_PACKET_HEAD = struct.Struct("<HHIIIIII")
"""Kind of the events, source, bytes of an event, where in it its time is, how often times had wrapped,
room in events, events, and how many of these are valid."""
_POLARITY_PACKET = 1
"""The kind of packets that hold events of pixels."""
_EVENT_BYTES = 8
"""Bytes of an event of a pixel: data, then time, 32 bits each."""
_AEDAT3_TIME_BITS = 31


def parse_aedat(data: bytes, where: str) -> EventStream:
    """Return the events of an ``.aedat`` file; ``InputError`` for other versions and damage."""
    # The first line is a dozen bytes; 40 are enough to show another one in the error.
    first_line = data[:40].split(b"\n")[0].strip()
    if first_line in _AEDAT2_FIRST_LINES:
        return _aedat2_stream(split_header(data, b"#", "end of ascii header", where), where)
    if first_line in _AEDAT3_FIRST_LINES:
        return _aedat3_stream(split_header(data, b"#", "!end-header", where), where)
    fix = "Give AEDAT 2.0 or 3.1, or AEDAT4 with the ending .aedat4."
    measured = f"its first line is {first_line[:20].decode('latin-1')!r}"
    raise InputError(where, "it is not an AEDAT file", measured=measured, fix=fix)


def _camera(text: str) -> str:
    """Return the camera that a text names, as a key of ``_SIZES``; empty for none of them."""
    names = re.findall(r"d(?:vs|avis)\d{3}", text.lower())
    return next((name for name in names if name in _SIZES), "")


# AEDAT 2.0.


def _aedat2_stream(header: FileHeader, where: str) -> EventStream:
    """Return the events of AEDAT 2.0."""
    camera = _aedat2_camera(header, where)
    pairs = records(header.body, ">u8", where)
    check_event_count(len(pairs), where)
    addresses = (pairs >> 32).astype(np.int64)
    counter = (pairs & 0xFFFFFFFF).astype(np.int64)
    # Images and inputs count time as well, so wraps are found before these are left out.
    times = unwrapped(counter, _AEDAT2_TIME_BITS)
    if camera.startswith("dvs"):
        events = _dvs_events(addresses, times)
    else:
        events = _davis_events(addresses, times)
    return camera_stream(events, _SIZES[camera], where)


def _aedat2_camera(header: FileHeader, where: str) -> str:
    """Return the camera of a header, as a key of ``_SIZES``; ``InputError`` if it names none."""
    chip = header.value("AEChip")
    camera = _camera(chip)
    if not camera:
        what = "its header does not name a camera that is known"
        measured = f"{chip[-40:]!r}" if chip else "no line '# AEChip'"
        fix = "Add '# AEChip: DVS128', or the name of a DAVIS."
        raise InputError(where, what, measured=measured, fix=fix)
    return camera


def _dvs_events(addresses: IntArray, times: IntArray) -> CameraEvents:
    """Return the events of pixels of a DVS128."""
    is_pixel = addresses >> 15 == 0
    address = addresses[is_pixel]
    return CameraEvents(
        times=times[is_pixel],
        x=address >> 1 & 0x7F,
        y=address >> 8 & 0x7F,
        polarity=address & 1,
    )


def _davis_events(addresses: IntArray, times: IntArray) -> CameraEvents:
    """Return the events of pixels of a DAVIS."""
    is_image = addresses >> 31 == 1
    is_input = addresses >> 10 & 1 == 1
    is_pixel = ~is_image & ~is_input
    address = addresses[is_pixel]
    return CameraEvents(
        times=times[is_pixel],
        x=address >> 12 & 0x3FF,
        y=address >> 22 & 0x1FF,
        polarity=address >> 11 & 1,
    )


# AEDAT 3.1.


class _Packet(Frozen, eq=False):
    """The events of pixels of a packet: ``words`` (events, 2) are data and time.

    ``source`` is the number of its camera, and ``time_wraps`` how often the 31 bits of time had
    wrapped.
    """

    words: IntArray
    source: int
    time_wraps: int


def _aedat3_stream(header: FileHeader, where: str) -> EventStream:
    """Return the events of AEDAT 3.1: those of the first camera that has any."""
    _check_raw_format(header, where)
    packets = list(_pixel_packets(header.body, where))
    source = packets[0].source if packets else 0
    own_packets = [packet for packet in packets if packet.source == source]
    further_packets = [packet for packet in packets if packet.source != source]
    further_events = sum(len(packet.words) for packet in further_packets)
    camera = _camera(_source_line(header, source))
    events = _packet_events(own_packets, further_events)
    return camera_stream(events, _SIZES.get(camera, SensorSize()), where)


def _check_raw_format(header: FileHeader, where: str) -> None:
    """Refuse compressed events; a header that does not say has plain ones."""
    form = header.value("Format") or "RAW"
    if form != "RAW":
        what = "its events are compressed"
        fix = "Record in the format RAW."
        raise InputError(where, what, measured=f"format {form[:20]!r}", fix=fix)


def _packet_events(packets: list[_Packet], unplaced: int) -> CameraEvents:
    """Return the valid events of packets; ``unplaced`` is the number of events of further cameras."""
    no_words = np.zeros((0, 2), dtype=np.int64)
    words = np.concatenate([no_words, *(packet.words for packet in packets)])
    event_counts = [len(packet.words) for packet in packets]
    time_wraps = np.repeat([packet.time_wraps for packet in packets], event_counts)
    times = words[:, 1] + (time_wraps.astype(np.int64) << _AEDAT3_TIME_BITS)
    is_valid = words[:, 0] & 1 != 0
    data = words[is_valid, 0]
    return CameraEvents(
        times=times[is_valid],
        x=data >> 17,
        y=data >> 2 & 0x7FFF,
        polarity=data >> 1 & 1,
        unplaced=unplaced,
    )


def _source_line(header: FileHeader, source: int) -> str:
    """Return what a header says of a source, as in ``Source 1: DVS128``; empty if nothing."""
    label = f"Source {source}:"
    return next((line for line in header.lines if line.startswith(label)), "")


def _pixel_packets(body: bytes, where: str) -> Iterator[_Packet]:
    """Yield the packets of pixel events in the bytes behind a header, except empty ones."""
    begin = 0
    events = 0
    while begin < len(body):
        content = begin + _PACKET_HEAD.size
        if content > len(body):
            raise _cut(where, f"byte {begin} behind its header begins a packet")
        head = _PACKET_HEAD.unpack_from(body, begin)
        kind, source, event_bytes, _, time_wraps, _, packet_events, _ = head
        end = content + event_bytes * packet_events
        # Events of 0 bytes would let a damaged file have any number of them.
        if event_bytes == 0 or end > len(body):
            raise _cut(where, f"a packet of {packet_events} events of {event_bytes} bytes")
        if kind == _POLARITY_PACKET:
            _check_event_bytes(event_bytes, where)
            events += packet_events
            check_event_count(events, where)
            words = np.frombuffer(body, dtype="<u4", count=2 * packet_events, offset=content)
            if packet_events:
                yield _Packet(words.reshape(-1, 2).astype(np.int64), source, time_wraps)
        begin = end


def _check_event_bytes(event_bytes: int, where: str) -> None:
    """Refuse a packet whose pixel events do not have the size that the format gives them."""
    if event_bytes != _EVENT_BYTES:
        measured = f"{event_bytes} bytes against {_EVENT_BYTES}"
        what = "its events of pixels have another size"
        raise InputError(where, what, measured=measured, fix="Give a whole file.")


def _cut(where: str, measured: str) -> InputError:
    """Return the error for packets that do not fill a file."""
    what = "it is damaged or truncated"
    return InputError(where, what, measured=measured, fix="Give a whole file.")
