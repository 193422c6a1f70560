"""One recording played to a program with every spike and register kept: what all emitters read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

import hw_model as hw
from hw_model.arithmetic.fixed_point import IntArray
from hw_model.engine.playing import Spikes, read_streams
from hw_model.engine.trace import ByteArray, Register
from hw_model.mapping.graph import Phase
from hw_model.program.chip_program import Core
from hw_model.simulation import SimulationResult
from locsnn_compile.errors import InputError

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Played:
    """A recording on a program.

    ``lines[phase]`` (steps, lines): spikes of the phase's input lines, inputs one after the other, as the transpose
    buffer leaves them. ``result`` holds spikes, u, v, potential and activity, arrays (steps, n). ``title`` says which
    recording this is.
    """

    program: hw.ChipProgram
    title: str
    lines: Mapping[str, ByteArray]
    result: SimulationResult

    def steps(self, phase: str) -> int:
        """Return the steps of a phase."""
        return len(self.lines[phase])

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        """Phases that have cores, in the order in which they run."""
        return tuple(phase for phase in self.program.phases if self.program.cores_of(phase.name))

    def register(self, core: Core, kind: Register) -> IntArray:
        """Return a register of every compartment of a core, (steps, compartments)."""
        of_group: Mapping[str, IntArray] = getattr(self.result, kind)
        return np.concatenate([of_group[p.group][:, p.start : p.stop] for p in core.slices], axis=1)

    def spikes(self, core: Core) -> ByteArray:
        """Return the spikes of every compartment of a core, (steps, compartments); joined ones never spike."""
        silent = np.zeros((self.steps(core.phase), 1), dtype=np.uint8)
        of_group = self.result.spikes
        parts = [
            of_group[p.group][:, p.start : p.stop] if p.group in of_group else np.repeat(silent, p.size, axis=1)
            for p in core.slices
        ]
        return np.concatenate(parts, axis=1)

    def input_axons(self, core: Core) -> ByteArray:
        """Return the spikes that input lines send to a core, (steps, input axons of the core)."""
        arriving = np.zeros((self.steps(core.phase), core.axons.input_axons), dtype=np.uint8)
        first = 0
        for item in self.program.inputs_of(core.phase):
            route = self.program.route_of(item.name)
            here = route.core == core.number
            arriving[:, route.axon[here]] = self.lines[core.phase][:, first + route.line[here]]
            first += item.size
        return arriving

    def axons(self, core: Core) -> ByteArray:
        """Return all spikes that reach a core, from input lines and from compartments, (steps, input axons)."""
        arriving = self.input_axons(core)
        for sender in self.program.cores_of(core.phase):
            axons = sender.axons
            here = axons.out_core == core.number
            arriving[:, axons.out_axon[here]] = self.spikes(sender)[:, axons.out_compartment[here]]
        return arriving


def play_recording(program: hw.ChipProgram, spikes: Spikes, title: str = "recording 0") -> Played:
    """Play one recording (steps, channels), or a mapping of them by stream, and keep everything."""
    streams, batched = read_streams(program, spikes)
    if batched:
        raise InputError("recording", "several recordings were given", fix="Give one, of shape (steps, channels).")
    recording = {name: array[0] for name, array in streams.items()}
    result = hw.simulate(program, recording, probe=("spikes", "u", "v", "potential", "activity"))
    rows = len(next(iter(recording.values())))
    lines = {
        phase.name: _lines(program, phase.name, recording, rows if phase.steps is None else phase.steps)
        for phase in program.phases
    }
    return Played(program, title, lines, result)


def _lines(program: hw.ChipProgram, phase: str, recording: Mapping[str, ByteArray], steps: int) -> ByteArray:
    """Return the spikes of a phase's input lines, (steps, lines), inputs one after the other."""
    parts = [np.zeros((steps, 0), dtype=np.uint8)]
    for item in program.inputs_of(phase):
        events = np.argwhere(recording[item.stream])
        if item.positions is None:
            at, line = events[:, 0], events[:, 1]
        else:  # the transpose buffer: an event (step t, channel c) is played as line first_lines[c] + t at positions[c]
            events = events[events[:, 0] < item.rows]
            at, line = item.positions[events[:, 1]], events[:, 0]
            if item.first_lines is not None:
                line = line + item.first_lines[events[:, 1]]
        kept = (at < steps) & (line < item.size)
        part = np.zeros((steps, item.size), dtype=np.uint8)
        part[at[kept], line[kept]] = 1
        parts.append(part)
    return np.concatenate(parts, axis=1)
