"""A board that runs the open core: programs loaded over its line, recordings played, answers checked."""

import struct
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace

import numpy as np

from hw_model.errors import InputError
from hw_model.rtl import frames
from hw_model.rtl.cosimulation import words_of
from hw_model.rtl.cycles import fired_in_order
from hw_model.rtl.images import CoreProgram, Sizes
from hw_model.rtl.ports import Port
from hw_model.rtl.refused import refuse_unless
from hw_model.texts.templates import filled
from hw_model.values import ByteArray, Frozen

PROBLEMS = ("", *filled(__package__, "problems.txt").splitlines())
"""What a board says by number; the first are those of the line, where sending again helps."""
LINE, OUT_OF_ORDER, CUT_OFF = range(1, 5), 5, 6
TRIES = 4
VERSION = 3
"""Of the protocol, which a board says first: a core has other parameters in another."""


class Answer(Frozen):
    """What a board made of a recording: an error of the stream or 0, a class, cycles, counts, and spikes if asked.

    ``counts``: synaptic operations, updates, active updates, spikes, and wraps and clips, as ``cosimulation.ANSWER``
    names them. ``spikes``: each as the number of updates before it; ``lost``: those that the board had no room for.
    """

    error: int
    winner: int
    cycles: int
    counts: tuple[int, ...]
    lost: int
    spikes: tuple[int, ...]


class Board:
    """A board on a port, greeted: ``sizes`` and ``buffer`` are what it says of itself.

    ``cut_off``: an earlier host left a recording in the middle, which the board dropped.
    """

    def __init__(self, port: Port) -> None:
        self._port = port
        self._frames = frames.FrameReader(port.read)
        self._number = 0
        self.cut_off = False
        self._spikes: list[int] = []
        self._answers: list[Answer] = []
        welcome = self._command(frames.HELLO)
        if welcome[:1] != bytes((VERSION,)):
            said = f"got {welcome[0] if welcome else 'none'} against {VERSION}"
            fix = "Build the bitstream again, with this version."
            raise InputError(
                "board", "it speaks another version of the protocol", measured=said, fix=fix
            )
        self.buffer, *sizes, last = _numbers(welcome[2:])
        self._answers.clear()
        self._spikes.clear()
        self.sizes = replace(
            Sizes(*sizes), phase_words=last & (1 << 20) - 1, later=last >> 20 & 7, groups=last >> 23
        )

    def load(self, core: CoreProgram) -> None:
        """Fill the memories with a program, and start it; a ``TargetError`` names what has no room."""
        for name, need in asdict(core.needs).items():
            room = getattr(self.sizes, name)
            refuse_unless(
                need <= room,
                core.program,
                f"room on this board for its {name}",
                f"{need} against {room}",
            )
        rows = np.packbits(core.load_words(self.sizes)[:, ::-1], axis=1)
        place = rows[:, :4].astype(np.int64) @ (1 << np.arange(24, -1, -8))
        for block in np.split(rows, np.flatnonzero(np.diff(place) != 1) + 1):
            size = 16 - int(np.flatnonzero(block[:, 4:].any(axis=0)).min(initial=15))
            for part in _parts(block, (self.buffer - 7) // size):
                self._command(
                    frames.LOAD, part[0, :4].tobytes() + bytes((size,)) + part[:, -size:].tobytes()
                )

    def report(self, wanted: bool) -> None:
        """Ask for spikes, or for none."""
        self._command(frames.REPORT, bytes((wanted,)))

    def play(self, core: CoreProgram, recording: ByteArray) -> Answer:
        """Stream a recording (rows, channels) and return its answer."""
        words = (
            np.array(words_of(core, recording), dtype=">u4").view(np.uint8).reshape(-1, 4)[:, 1:]
        )
        for part in _parts(words, (self.buffer - 2) // 3):
            self._command(frames.WORDS, part.tobytes())
        while not self._answers:
            if self._heard() is None:
                raise InputError(
                    "board", "it did not answer a recording", fix="Check the line; play it again."
                )
        return self._answers.pop()

    def _command(self, kind: int, payload: bytes = b"") -> bytes:
        """Send a frame until it is carried out; return what the board says to it. A refusal is an ``InputError``."""
        reply_type = frames.WELCOME if kind == frames.HELLO else frames.DONE
        following = (self._number + 1) % 256
        for _ in range(TRIES):
            self._port.write(frames.framed(kind, self._number, payload))
            while (frame := self._heard()) is not None:
                said, number, body = frame
                problem = body[0] if said == frames.ERROR else 0
                # Carried out already, if the board waits for the next one: what it said to it was lost on the line.
                if (said, number) == (reply_type, self._number) or (problem, number) == (
                    OUT_OF_ORDER,
                    following,
                ):
                    self._number = following
                    return body
                self.cut_off |= problem == CUT_OFF
                if problem in LINE:
                    break
                if problem > CUT_OFF:
                    raise InputError("board", f"it says that {PROBLEMS[problem]}", fix="Report it.")
        raise InputError(
            "board", "it does not answer", fix="Check the port, the baud rate and the bitstream."
        )

    def _heard(self) -> frames.Frame | None:
        """Return the next frame, None if nothing comes; keep spikes and answers."""
        frame = self._frames.next()
        if frame and frame[0] == frames.SPIKES:
            self._spikes += _numbers(frame[2])
        if frame and frame[0] == frames.ANSWER:
            error, winner, cycles, *counts = struct.unpack(">BHI7I", frame[2][:-3])
            (lost,) = _numbers(frame[2][-3:])
            self._answers.append(
                Answer(error, winner, cycles, tuple(counts), lost, tuple(self._spikes))
            )
            self._spikes.clear()
        return frame


def _numbers(payload: bytes) -> list[int]:
    return [int.from_bytes(payload[at : at + 3], "big") for at in range(0, len(payload), 3)]


def _parts(rows: ByteArray, most: int) -> Iterator[ByteArray]:
    return (rows[at : at + most] for at in range(0, len(rows), most))


def spike_numbers(
    core: CoreProgram, recording: ByteArray, spikes: Mapping[str, ByteArray]
) -> list[int]:
    """Return the spikes of a simulation as a board reports them; ``spikes[population]`` (steps, n)."""
    parts = [fired_in_order(core, phase, recording, spikes).ravel() for phase in core.phases]
    return np.flatnonzero(np.concatenate(parts)).tolist()
