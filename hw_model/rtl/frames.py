"""Frames on the serial line between a host and a board: packed into bytes, and found in bytes.

``frame_receiver.sv`` describes how a frame looks on the line. It is the format of RFC 1662: flags
around the frame, escapes in it, and a CRC-16 at its end.
"""

import re
from binascii import crc_hqx
from collections.abc import Callable

FLAG, ESCAPE = b"\x7e", b"\x7d"
HELLO, LOAD, WORDS, REPORT = 1, 2, 3, 4
"""Types of the frames that a host sends."""
WELCOME, DONE, ANSWER, SPIKES, ERROR = 0x81, 0x82, 0x83, 0x84, 0x85
"""Types of the frames that a board sends."""
Frame = tuple[int, int, bytes]
"""Type, sequence number and payload."""
_FLIP = 0x20
"""An escaped byte is sent with this bit inverted."""
_CRC_START = 0xFFFF


def framed(kind: int, number: int, payload: bytes) -> bytes:
    """Return a frame as it stands on the line: flag, escaped body and checksum, flag."""
    body = bytes((kind, number)) + payload
    body += crc_hqx(body, _CRC_START).to_bytes(2, "big")
    # Escapes first: those that stand for flags must not be escaped again.
    return FLAG + body.replace(ESCAPE, b"\x7d\x5d").replace(FLAG, b"\x7d\x5e") + FLAG


class FrameReader:
    """Finds whole and correct frames in the bytes of a line.

    ``read`` returns the bytes that have come, or none after some time without any.
    """

    def __init__(self, read: Callable[[], bytes]) -> None:
        self._read = read
        self._unread = b""

    def next(self) -> Frame | None:
        """Return the next frame, or None if nothing comes.

        Damaged frames are skipped: a host that waits for one of them sends its request again.
        """
        while True:
            between_flags, flag, after = self._unread.partition(FLAG)
            if flag:
                self._unread = after
                body = _without_escapes(between_flags)
                # Type, number and a CRC make four bytes; the CRC of a frame with its own CRC is 0.
                if len(body) > 3 and crc_hqx(body, _CRC_START) == 0:
                    return body[0], body[1], body[2:-2]
            elif received := self._read():
                self._unread += received
            else:
                return None


def _without_escapes(escaped: bytes) -> bytes:
    """Return the bytes of a frame, with the byte that each escape stands for in its place."""
    return re.sub(
        rb"\x7d(.)", lambda match: bytes((match[1][0] ^ _FLIP,)), escaped, flags=re.DOTALL
    )
