"""A board on the desk: the simulated one without a line, a small program for it, and what it says byte by byte."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from unittest.mock import patch

from hw_model.rtl import ports
from hw_model.rtl.board import Answer, Board
from hw_model.rtl.cosimulation import END, TICK, words_of
from hw_model.rtl.frames import HELLO, LOAD, REPORT, WORDS, FrameReader, framed
from hw_model.rtl.images import CoreProgram, Sizes
from hw_model.rtl.memory_words import hex_words
from hw_model.rtl.ports import SimulatedBoard
from hw_model.rtl.simulators import built, run
from tests.support import benches

PRESS = 513
LAST, STOP = 1 << 32, 3 << 16
"""Of a beat of the AXI-Stream: its TLAST, and its kind."""
PATIENCE = 1600
"""Cycles of silence that are an answer: twice what the whole recording takes (796), its cleaning included."""


class Desk:
    """A program, its recording, and simulated boards that hold it; ``texts`` stand in place of the SystemVerilog."""

    def __init__(self, sizes: Sizes = benches.SIZES):
        self.program, self.spikes = benches.hybrid(22)
        self.core = CoreProgram(self.program, self.spikes.shape[1], sizes=sizes)
        self.sizes = self.core.simulated(sizes)
        self.words = words_of(self.core, self.spikes[0])

    def port(self, texts: Mapping[str, str] | None = None, **more) -> SimulatedBoard:
        given = {"bit": 0, "patience": PATIENCE, **more}
        texts = texts or ports.sources()
        with patch.object(ports, "sources", lambda: texts):
            return SimulatedBoard("icarus", self.sizes, **given)

    def beats(self) -> list[int]:
        """Return the recording as beats: the last tick is marked, and there is no end."""
        *words, tick, end = self.words
        assert (tick, end) == (TICK, END)
        return [*words, LAST | TICK]

    def play_axis(
        self, folder: Path, beats: list[int], texts: Mapping[str, str], waits: int = 2, **more
    ):
        """Play beats to the AXI-Stream bench; return the answers and the spikes, as it writes them."""
        binary = built("icarus", self.sizes, texts, "axis_bench", waits=waits, **more)
        (folder / "load").write_bytes(hex_words(self.core.load_words(self.sizes)))
        (folder / "words").write_text("".join(f"{beat:x}\n" for beat in beats))
        run(binary, folder, 8000)  # more than the cleaning of the core takes
        answers = [line.split() for line in (folder / "answers").read_text().splitlines()]
        return answers, (folder / "spikes").read_text().split()


def said(port) -> list[tuple[int, int, bytes]]:
    """Return every frame that comes until the board is silent."""
    reader = FrameReader(port.read)
    return list(iter(reader.next, None))


def say(port, kind: int, number: int, payload: bytes = b"") -> list[tuple[int, int, bytes]]:
    port.write(framed(kind, number, payload))
    return said(port)


def stream_words(words) -> bytes:
    """The bytes of words of 24 bits on the serial line, the highest first."""
    return b"".join(word.to_bytes(3, "big") for word in words)


WORD = stream_words([TICK])
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
    return frame[:3] + bytes((frame[3] ^ 1,)) + frame[4:]


def chapters(desk: Desk) -> Iterator[list[int]]:
    """Yield what a host sends, every fault among it; a hello with number 0 came before each."""
    words = desk.words
    yield framed(WORDS, 1, stream_words([desk.core.channels, TICK, END]))
    yield [0x7E, HELLO, 256 + 1, 0x7E, *framed(REPORT, 1, b"\1")]
    yield [*framed(REPORT, 1, b"\1"), *framed(WORDS, 2, stream_words(words))]
    yield framed(WORDS, 1, stream_words(words))
    yield [
        *framed(REPORT, 1, b"\1"),
        *framed(REPORT, 2, b"\0"),
        *framed(WORDS, 3, stream_words(words)),
    ]
    yield [*damaged(framed(WORDS, 1, WORD)), *framed(WORDS, 1, stream_words([0, END]))]
    yield [*framed(WORDS, 1, WORD)[:5], *framed(REPORT, 1, b"\0")]
    yield [*framed(WORDS, 1, WORD)[:-1], 0x7D, 0x7E, *framed(REPORT, 1, b"\0")]
    yield [*b"\x7eabc\x7e", *framed(REPORT, 1, b"\0")]
    yield [*framed(WORDS, 1, bytes(200)), *framed(REPORT, 1, b"\0")]
    yield [*framed(WORDS, 1, bytes(127)), *framed(REPORT, 1, b"\0")]
    yield [
        *framed(WORDS, 2, WORD),
        *framed(WORDS, 1, WORD),
        *framed(WORDS, 1, WORD),
        *framed(WORDS, 2, WORD),
    ]
    yield [
        *framed(WORDS, 1, stream_words(words[:15])),
        *framed(LOAD, 2, REFUSED_LOADS["an empty load"]),
    ]
    yield [
        *framed(WORDS, 1, stream_words([desk.core.channels, TICK, END])),
        *framed(LOAD, 2, b"\x01\0\0\0\x04abcd"),
    ]
    yield [
        *framed(WORDS, 1, stream_words([*words[:9], STOP])),
        *framed(WORDS, 2, stream_words(words[:4])),
    ]
    for kind, payload in (
        (9, b""),
        (0, b"abc"),
        (WORDS, b"\1\0"),
        (WORDS, b"\4\0\0"),
        (REPORT, b"\2"),
        (REPORT, b"\1\1"),
    ):
        yield [*framed(kind, 1, payload), *framed(WORDS, 2, stream_words(words))]
    yield framed(HELLO, 1, b"a")
    for payload in REFUSED_LOADS.values():
        yield [*framed(LOAD, 1, payload), *framed(WORDS, 2, WORD)]
    yield framed(LOAD, 1, b"\x01\0\0\xff\x04abcd")
    yield [PRESS, *framed(WORDS, 0, WORD)]


def until_greeted(port: SimulatedBoard, number: int, tokens: Iterable[int]) -> bytes:
    """Send what is given and a hello; return all that comes up to its answer, or to silence, or very much of it."""
    port.write([*tokens, *framed(HELLO, number, b"")])
    ending = framed(0x81, number, b"")[:3]
    came = b""
    while ending not in came and len(came) < 2000 and (more := port.read()):
        came += more
    return came + port.read()


def transcript(desk: Desk, texts: Mapping[str, str]) -> Iterator[bytes]:
    """Yield every byte of a board in a session with every fault; a board that says no end to it is cut short."""
    with closing(desk.port(texts, buffer=128, spikes=2)) as port:
        board = Board(port)
        board.load(desk.core)
        for number, chapter in enumerate(chapters(desk), 0x64):
            yield until_greeted(port, 0, ())
            yield until_greeted(port, number, chapter)


def over_a_line(desk: Desk, texts: Mapping[str, str] | None = None) -> Answer:
    """Return a board's answer over a line that is so slow that spikes still wait for it when the class is known."""
    with closing(desk.port(texts, bit=8, spikes=64, patience=20_000)) as port:
        board = Board(port)
        board.load(desk.core)
        board.report(True)
        return board.play(desk.core, desk.spikes[0])


def rates(folder: Path, texts: Mapping[str, str], bit: int, host_bit: int) -> list[str]:
    """Return what a receiver hears of every byte, at these lengths of a bit."""
    bench = (Path(__file__).parent / "uart_rates.sv").read_text()
    files = {name: texts.get(name, bench) for name in ("uart_rx.sv", "uart_tx.sv", "uart_rates.sv")}
    for name, text in files.items():
        (folder / name).write_text(text)
    given = [f"-Puart_rates.BIT={bit}", f"-Puart_rates.HOST_BIT={host_bit}"]
    command = ["iverilog", "-g2012", "-s", "uart_rates", "-o", "rates.vvp", *given, *files]
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
