"""A simulated board with the open core, a small program for it, and sessions of a host with the board.

Host and board exchange frames (``hw_model/rtl/frames.py``): a kind, a sequence number and a payload. Mostly there is no
serial line between them: a byte takes one clock cycle.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from unittest.mock import patch

from hw_model.rtl import ports
from hw_model.rtl.board import Answer, Board
from hw_model.rtl.cosimulation import END, TICK, words_of
from hw_model.rtl.frames import HELLO, LOAD, REPORT, WELCOME, WORDS, FrameReader, framed
from hw_model.rtl.images import CoreProgram, Sizes
from hw_model.rtl.memory_words import hex_words
from hw_model.rtl.ports import SimulatedBoard
from hw_model.rtl.simulators import built, run
from tests.support import benches

PRESS = 513
"""The number that presses the reset button in ``board_bench.sv``, which sends numbers below 256 as bytes."""
LAST = 1 << 32
"""The bit of TLAST in a beat of the AXI-Stream."""
STOP = 3 << 16
"""The word that ends a recording early."""
PATIENCE = 1600
"""Cycles of silence after which a read ends: twice what the whole recording takes (796), clearing the core included."""
LINE_BROKEN = 256
"""Added to a byte, this makes ``board_bench.sv`` send it with its stop bit low."""


class Desk:
    """A program with a recording, and simulated boards that can run it.

    ``words`` are the recording as the core takes it: channel numbers, a tick after each row, an end. ``texts`` given to a
    method replace the SystemVerilog sources, by file name.
    """

    def __init__(self, sizes: Sizes = benches.SIZES):
        self.program, self.spikes = benches.hybrid(22)
        self.core = CoreProgram(self.program, self.spikes.shape[1], sizes=sizes)
        self.sizes = self.core.simulated(sizes)
        self.words = words_of(self.core, self.spikes[0])

    def port(self, texts: Mapping[str, str] | None = None, **more) -> SimulatedBoard:
        """Return a simulated board without a program; ``more`` are parameters of ``board_bench.sv``."""
        parameters = {"bit": 0, "patience": PATIENCE, **more}
        texts = texts or ports.sources()
        with patch.object(ports, "sources", lambda: texts):
            return SimulatedBoard("icarus", self.sizes, **parameters)

    def beats(self) -> list[int]:
        """Return the recording as beats of the AXI-Stream, where TLAST on the last tick replaces the word of the end."""
        *words, tick, end = self.words
        assert tick == TICK
        assert end == END
        return [*words, LAST | TICK]

    def play_axis(
        self, folder: Path, beats: list[int], texts: Mapping[str, str], waits: int = 2, **more
    ):
        """Play beats to ``axis_bench.sv``; return its lines of answers, split, and its words of spikes."""
        binary = built("icarus", self.sizes, texts, "axis_bench", waits=waits, **more)
        (folder / "load").write_bytes(hex_words(self.core.load_words(self.sizes)))
        (folder / "words").write_text("".join(f"{beat:x}\n" for beat in beats))
        run(binary, folder, 8000)  # cycles, more than clearing the core takes
        answers = [line.split() for line in (folder / "answers").read_text().splitlines()]
        return answers, (folder / "spikes").read_text().split()


def received_frames(port) -> list[tuple[int, int, bytes]]:
    """Return every frame that the board sends until it is silent."""
    reader = FrameReader(port.read)
    return list(iter(reader.next, None))


def exchange(port, kind: int, number: int, payload: bytes = b"") -> list[tuple[int, int, bytes]]:
    """Send a frame to the board, and return every frame that it sends until it is silent."""
    port.write(framed(kind, number, payload))
    return received_frames(port)


def stream_words(words) -> bytes:
    """Return the bytes of words of 24 bits as they go over the serial line, the highest byte first."""
    return b"".join(word.to_bytes(3, "big") for word in words)


WORD = stream_words([TICK])
# A load is the number of a memory, an address of three bytes, the bytes per word, and the words.
REFUSED_LOADS = {
    "an empty load": b"",
    "a load without words": b"\x01\0\0\0\x04",
    "a load of a word and a half": b"\x01\0\0\0\x04abcdef",
    "a load of words without bytes": b"\x01\0\0\0\x00abc",
    "a load of words of 17 bytes": b"\x01\0\0\0\x11" + bytes(17),
    "a memory that does not exist": b"\x08\0\0\0\x04abcd",
    "an address outside its memory": b"\x01\x00\x01\x00\x04abcd",
    "a word that runs over the end": b"\x01\x00\x00\xff\x04abcdabcd",
}


def damaged(frame: bytes) -> bytes:
    """Return a frame with one wrong bit, which its checksum reveals."""
    return frame[:3] + bytes((frame[3] ^ 1,)) + frame[4:]


def chapters(desk: Desk) -> Iterator[list[int]]:
    """Yield what a host sends in each part of a session, with every fault that a host or a line can make.

    The host greets the board before each part, so that the frame after the greeting has the number 1.
    """
    words = desk.words
    whole_recording = stream_words(words)
    # A channel that does not exist; then a byte without its stop bit.
    yield framed(WORDS, 1, stream_words([desk.core.channels, TICK, END]))
    yield [0x7E, HELLO, LINE_BROKEN + 1, 0x7E, *framed(REPORT, number=1, payload=b"\1")]
    # Recordings with reports of spikes, and without.
    yield [*framed(REPORT, number=1, payload=b"\1"), *framed(WORDS, 2, whole_recording)]
    yield framed(WORDS, 1, whole_recording)
    yield [
        *framed(REPORT, number=1, payload=b"\1"),
        *framed(REPORT, number=2, payload=b"\0"),
        *framed(WORDS, 3, whole_recording),
    ]
    # Frames that are damaged, cut short, given up by their sender, no frames at all, longer than the board's buffer
    # and as long as it.
    yield [*damaged(framed(WORDS, 1, WORD)), *framed(WORDS, 1, stream_words([0, END]))]
    yield [*framed(WORDS, 1, WORD)[:5], *framed(REPORT, number=1, payload=b"\0")]
    yield [*framed(WORDS, 1, WORD)[:-1], 0x7D, 0x7E, *framed(REPORT, number=1, payload=b"\0")]
    yield [*b"\x7eabc\x7e", *framed(REPORT, number=1, payload=b"\0")]
    yield [*framed(WORDS, 1, bytes(200)), *framed(REPORT, number=1, payload=b"\0")]
    yield [*framed(WORDS, 1, bytes(127)), *framed(REPORT, number=1, payload=b"\0")]
    # Frames out of order, and one that comes twice.
    yield [
        *framed(WORDS, 2, WORD),
        *framed(WORDS, 1, WORD),
        *framed(WORDS, 1, WORD),
        *framed(WORDS, 2, WORD),
    ]
    # Loads within a recording, and a recording that is stopped early and followed by another.
    yield [
        *framed(WORDS, 1, stream_words(words[:15])),
        *framed(LOAD, 2, REFUSED_LOADS["an empty load"]),
    ]
    yield [
        *framed(WORDS, 1, stream_words([desk.core.channels, TICK, END])),
        *framed(LOAD, number=2, payload=b"\x01\0\0\0\x04abcd"),
    ]
    yield [
        *framed(WORDS, 1, stream_words([*words[:9], STOP])),
        *framed(WORDS, 2, stream_words(words[:4])),
    ]
    # Unknown kinds of frames, and payloads of a wrong form.
    for kind, payload in (
        (9, b""),
        (0, b"abc"),
        (WORDS, b"\1\0"),
        (WORDS, b"\4\0\0"),
        (REPORT, b"\2"),
        (REPORT, b"\1\1"),
    ):
        yield [*framed(kind, 1, payload), *framed(WORDS, 2, whole_recording)]
    yield framed(HELLO, number=1, payload=b"a")
    for payload in REFUSED_LOADS.values():
        yield [*framed(LOAD, 1, payload), *framed(WORDS, 2, WORD)]
    # A load of the last word of a memory, and the reset button, after which the board has no program.
    yield framed(LOAD, number=1, payload=b"\x01\0\0\xff\x04abcd")
    yield [PRESS, *framed(WORDS, 0, WORD)]


def until_greeted(port: SimulatedBoard, number: int, tokens: Iterable[int]) -> bytes:
    """Send ``tokens`` and a hello; return all bytes up to the board's welcome, to silence, or to 2,000 bytes.

    A faulty board may send without end.
    """
    port.write([*tokens, *framed(HELLO, number, b"")])
    start_of_welcome = framed(WELCOME, number, b"")[:3]
    received = b""
    while start_of_welcome not in received and len(received) < 2000:
        more = port.read()
        if not more:
            break
        received += more
    return received + port.read()


def transcript(desk: Desk, texts: Mapping[str, str]) -> Iterator[bytes]:
    """Yield every byte that a board sends in a session with every fault."""
    with closing(desk.port(texts, buffer=128, spikes=2)) as port:
        board = Board(port)
        board.load(desk.core)
        # Numbers that no other frame of the session has, so that each welcome is recognised.
        for number, chapter in enumerate(chapters(desk), start=0x64):
            yield until_greeted(port, 0, ())
            yield until_greeted(port, number, chapter)


def over_a_line(desk: Desk, texts: Mapping[str, str] | None = None) -> Answer:
    """Return a board's answer over a line so slow that reported spikes still wait when the class is known."""
    with closing(desk.port(texts, bit=8, spikes=64, patience=20_000)) as port:
        board = Board(port)
        board.load(desk.core)
        board.report(wanted=True)
        return board.play(desk.core, desk.spikes[0])


def received_bytes(folder: Path, texts: Mapping[str, str], bit: int, host_bit: int) -> list[str]:
    """Send every byte over ``uart_rates.sv``; return what its receiver prints.

    A bit takes ``bit`` clock cycles at the receiver and ``host_bit`` at the sender.
    """
    bench = (Path(__file__).parent / "uart_rates.sv").read_text()
    files = {name: texts.get(name, bench) for name in ("uart_rx.sv", "uart_tx.sv", "uart_rates.sv")}
    for name, text in files.items():
        (folder / name).write_text(text)
    parameters = [f"-Puart_rates.BIT={bit}", f"-Puart_rates.HOST_BIT={host_bit}"]
    command = ["iverilog", "-g2012", "-s", "uart_rates", "-o", "rates.vvp", *parameters, *files]
    subprocess.run(command, cwd=folder, check=True)
    process = subprocess.run(
        ["vvp", "-n", "rates.vvp"],
        cwd=folder,
        check=True,
        capture_output=True,
        text=True,
        timeout=60,
    )
    return process.stdout.split()
