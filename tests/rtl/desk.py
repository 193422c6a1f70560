"""A board on the desk: the simulated one without a line, a small program for it, and what it says byte by byte."""

from __future__ import annotations

import benches

from hw_model.rtl.frames import FrameReader, framed
from hw_model.rtl.images import CoreProgram, sizes_for
from hw_model.rtl.ports import SimulatedBoard

PRESS = 513
PATIENCE = 3000
"""Cycles of silence: more than a recording takes, and its cleaning."""


class Desk:
    """A program, its recording, and simulated boards that hold it; ``texts`` replace the SystemVerilog."""

    def __init__(self):
        self.program, self.spikes = benches.hybrid(22)
        self.core = CoreProgram(self.program, self.spikes.shape[1])
        self.sizes = sizes_for(self.core.needs, benches.SIZES)

    def port(self, **more) -> SimulatedBoard:
        return SimulatedBoard("icarus", self.sizes, **{"bit": 0, "patience": PATIENCE, **more})


def said(port) -> list[tuple[int, int, bytes]]:
    """Return every frame that comes until the board is silent."""
    reader = FrameReader(port.read)
    return list(iter(reader.next, None))


def say(port, kind: int, number: int, payload: bytes = b"") -> list[tuple[int, int, bytes]]:
    port.write(framed(kind, number, payload))
    return said(port)
