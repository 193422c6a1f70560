"""Files of single events, by their ending."""

from locsnn_compile.data.aedat4 import parse_aedat4
from locsnn_compile.data.event_stream import MAX_EVENTS, EventStream
from locsnn_compile.data.slayer_events import EVENT_BYTES, parse_slayer_events
from locsnn_compile.data.tact import parse_tact
from locsnn_compile.errors import check_most

EVENT_SUFFIXES = (".tact", ".bs1", ".bs2", ".bin", ".aedat4")
#: Largest text of one recording: about 600,000 events.
MAX_TEXT_BYTES = 10_000_000


def parse_events(data: bytes, suffix: str, where: str, startend: bytes | None, startend_where: str) -> EventStream:
    """Return the events of a file's bytes; ``startend`` are those of the file beside a ``.tact``, None without one."""
    limit = MAX_TEXT_BYTES if suffix == ".tact" else MAX_EVENTS * EVENT_BYTES
    length = max(len(data), len(startend or b""))
    check_most(length, limit, where, "it is too large", unit="bytes", fix="Give one recording.")
    if suffix == ".tact":
        return parse_tact(data, where, startend, startend_where)
    if suffix == ".aedat4":
        return parse_aedat4(data, where)
    return parse_slayer_events(data, suffix, where)
