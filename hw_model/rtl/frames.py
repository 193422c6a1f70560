"""Frames on a serial line, as the open core's board takes and gives them: see ``frame_receiver.sv``."""

import re
from binascii import crc_hqx
from collections.abc import Callable

FLAG, ESCAPE = b"\x7e", b"\x7d"
HELLO, LOAD, WORDS, REPORT = 1, 2, 3, 4
"""What a host says, by the type of its frame."""
WELCOME, DONE, ANSWER, SPIKES, ERROR = 0x81, 0x82, 0x83, 0x84, 0x85
"""What a board says."""
Frame = tuple[int, int, bytes]
"""Its type, its sequence number and its payload."""


def framed(kind: int, number: int, payload: bytes) -> bytes:
    """Return a frame as it stands on the line: flag, escaped body and checksum, flag."""
    body = bytes((kind, number)) + payload
    body += crc_hqx(body, 0xFFFF).to_bytes(2, "big")
    return FLAG + body.replace(ESCAPE, b"\x7d\x5d").replace(FLAG, b"\x7d\x5e") + FLAG


class FrameReader:
    """Whole and correct frames out of bytes; ``read`` returns those that came, none after some time without any."""

    def __init__(self, read: Callable[[], bytes]) -> None:
        self._read, self._rest = read, b""

    def next(self) -> Frame | None:
        """Return the next frame; None if nothing comes. Damaged ones are passed over: who waits for one asks again."""
        while True:
            between, flag, after = self._rest.partition(FLAG)
            if flag:
                self._rest = after
                body = re.sub(
                    rb"\x7d(.)",
                    lambda found: bytes((found[1][0] ^ 0x20,)),
                    between,
                    flags=re.DOTALL,
                )
                if len(body) > 3 and crc_hqx(body, 0xFFFF) == 0:
                    return body[0], body[1], body[2:-2]
            elif came := self._read():
                self._rest += came
            else:
                return None
