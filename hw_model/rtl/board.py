"""The host of a board with the open core: load programs and play recordings over its line.

The protocol is that of docs/reference/hardware/serial-line-and-axi.md: frames with sequence
numbers, each of which the board answers. A frame that was lost or damaged on the line is sent
again.
"""

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
"""The texts of the problems that a board reports, by their numbers; number 0 is none."""
LINE = range(1, 5)
"""Problems of the line: the frame was damaged or lost, so it is sent again."""
OUT_OF_ORDER = 5
CUT_OFF = 6
"""Not a refusal: a hello reports that it cut a recording off."""
TRIES = 4
"""How often a frame is sent before the host gives up. Chosen by hand."""
VERSION = 3
"""The version of the protocol, which a board sends first. Versions differ in the parameters that
follow it."""
# Bytes of a word on the load port, and of what precedes the words in the buffer of the board: the
# type and number of a frame, and in a load also memory, address and size.
_PLACE_BYTES = 4
_DATA_BYTES = 16
_HEADER_BYTES = 2
_LOAD_HEADER_BYTES = _HEADER_BYTES + _PLACE_BYTES + 1


class Answer(Frozen):
    """A board's answer to a recording.

    - ``error``: of the stream; 0 if there was none
    - ``winner``: the class
    - ``cycles``: from the first word of the recording to its answer
    - ``counts``: synaptic operations, updates, active updates, spikes, wraps of charge and of
      current, and clips, in the order of ``cosimulation.ANSWER_COUNTS``
    - ``lost``: spikes that the board had no room for
    - ``spikes``: each as the number of compartments that were updated before it; empty unless they
      were asked for
    """

    error: int
    winner: int
    cycles: int
    counts: tuple[int, ...]
    lost: int
    spikes: tuple[int, ...]


class Board:
    """A board on a port. It is greeted when this object is made.

    - ``sizes``: the sizes of its core, as it reports them
    - ``buffer``: the bytes of frames that may wait on the board, so the longest frame it takes
    - ``cut_off``: whether an earlier host left a recording in the middle, which the board then
      dropped
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
            version = welcome[0] if welcome else "none"
            fix = "Build the bitstream again, with this version."
            raise InputError(
                "board",
                "it speaks another version of the protocol",
                measured=f"got {version} against {VERSION}",
                fix=fix,
            )
        # The bytes of a welcome: version, whether a program is loaded, then numbers of three bytes.
        self.buffer, *sizes, last = _numbers(welcome[2:])
        # What an earlier host asked for is not of interest.
        self._answers.clear()
        self._spikes.clear()
        # Three parameters share the last number, as locsnn_bytes.sv packs them.
        self.sizes = replace(
            Sizes(*sizes), phase_words=last & (1 << 20) - 1, later=last >> 20 & 7, groups=last >> 23
        )

    def load(self, core: CoreProgram) -> None:
        """Fill the memories with a program, and start it.

        Raise a ``TargetError`` that names the first size in which the core of the board is too
        small.
        """
        for name, need in asdict(core.needs).items():
            room = getattr(self.sizes, name)
            refuse_unless(
                need <= room,
                core.program,
                f"room on this board for its {name}",
                f"{need} against {room}",
            )
        # Bytes, the highest first: one of the memory, three of the address, sixteen of data.
        words = np.packbits(core.load_words(self.sizes)[:, ::-1], axis=1)
        place = words[:, :_PLACE_BYTES].astype(np.int64) @ (1 << np.arange(24, -1, -8))
        # A frame holds words of one memory whose addresses follow each other, without the leading
        # bytes of data that are 0 in all of them.
        block_starts = np.flatnonzero(np.diff(place) != 1) + 1
        for block in np.split(words, block_starts):
            data = block[:, _PLACE_BYTES:]
            leading_zeros = int(np.flatnonzero(data.any(axis=0)).min(initial=_DATA_BYTES - 1))
            size = _DATA_BYTES - leading_zeros
            for part in _parts(block, (self.buffer - _LOAD_HEADER_BYTES) // size):
                destination = part[0, :_PLACE_BYTES].tobytes() + bytes((size,))
                self._command(frames.LOAD, destination + part[:, -size:].tobytes())

    def report(self, *, wanted: bool) -> None:
        """Ask the board to report spikes with the answers, or to stop that."""
        self._command(frames.REPORT, bytes((wanted,)))

    def play(self, core: CoreProgram, recording: ByteArray) -> Answer:
        """Stream a recording (rows, channels) and return its answer."""
        # The stream has words of 18 bits, and the line three bytes for each: the highest of four
        # bytes is left out.
        words = np.array(words_of(core, recording), dtype=">u4")
        bytes_of_words = words.view(np.uint8).reshape(-1, 4)[:, 1:]
        for part in _parts(bytes_of_words, (self.buffer - _HEADER_BYTES) // 3):
            self._command(frames.WORDS, part.tobytes())
        while not self._answers:
            if self._next_frame() is None:
                raise InputError(
                    "board", "it did not answer a recording", fix="Check the line; play it again."
                )
        return self._answers.pop()

    def _command(self, kind: int, payload: bytes = b"") -> bytes:
        """Send a frame until it is carried out, and return the payload of the board's reply.

        Raise an ``InputError`` if the board refuses the frame, or does not answer.
        """
        reply_type = frames.WELCOME if kind == frames.HELLO else frames.DONE
        next_number = (self._number + 1) % 256
        for _ in range(TRIES):
            self._port.write(frames.framed(kind, self._number, payload))
            while (frame := self._next_frame()) is not None:
                frame_type, number, body = frame
                problem = body[0] if frame_type == frames.ERROR else 0
                is_reply = (frame_type, number) == (reply_type, self._number)
                # The board waits for the next number: it has carried this frame out, and its reply
                # was lost on the line.
                was_carried_out = (problem, number) == (OUT_OF_ORDER, next_number)
                if is_reply or was_carried_out:
                    self._number = next_number
                    return body
                self.cut_off |= problem == CUT_OFF
                if problem in LINE:
                    break
                if problem > CUT_OFF:
                    raise InputError("board", f"it says that {PROBLEMS[problem]}", fix="Report it.")
        raise InputError(
            "board", "it does not answer", fix="Check the port, the baud rate and the bitstream."
        )

    def _next_frame(self) -> frames.Frame | None:
        """Return the next frame, or None if nothing comes.

        Spikes and answers may come between other frames, so they are stored here, whatever is
        waited for.
        """
        frame = self._frames.next()
        if frame is None:
            return None
        frame_type, _, payload = frame
        if frame_type == frames.SPIKES:
            self._spikes += _numbers(payload)
        if frame_type == frames.ANSWER:
            # Error 1 byte, class 2, cycles 4, seven counts of 4, lost spikes 3.
            error, winner, cycles, *counts = struct.unpack(">BHI7I", payload[:-3])
            (lost,) = _numbers(payload[-3:])
            self._answers.append(
                Answer(error, winner, cycles, tuple(counts), lost, tuple(self._spikes))
            )
            self._spikes.clear()
        return frame


def _numbers(payload: bytes) -> list[int]:
    """Return the numbers in a payload, three bytes each, the highest first."""
    return [int.from_bytes(payload[at : at + 3], "big") for at in range(0, len(payload), 3)]


def _parts(rows: ByteArray, most: int) -> Iterator[ByteArray]:
    """Split an array into parts of at most ``most`` rows."""
    return (rows[at : at + most] for at in range(0, len(rows), most))


def spike_numbers(
    core: CoreProgram, recording: ByteArray, spikes: Mapping[str, ByteArray]
) -> list[int]:
    """Return the spikes of a simulation as a board reports them: how many updates came before.

    ``spikes[population]`` (steps, n).
    """
    parts = [fired_in_order(core, phase, recording, spikes).ravel() for phase in core.phases]
    return np.flatnonzero(np.concatenate(parts)).tolist()
