"""What emitters share: a recording played to a program, with every spike and register, and names.

Names are for formats that allow few characters, and for Markdown.
"""

import re
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Literal

import numpy as np

import hw_model as hw
from hw_model.engine.playing import Player, Spikes, list_events, play, read_streams
from hw_model.engine.trace import Register
from hw_model.mapping.graph import Phase
from hw_model.program.chip_program import Core
from hw_model.texts.templates import filled
from hw_model.values import ByteArray, Frozen, IntArray
from locsnn_compile.errors import InputError


class Played(Frozen, eq=False):
    """A recording on a program.

    ``runs[phase]`` are the steps that a phase runs: all, but for one over time that starts at the first touch. Lines
    and what methods return hold these steps alone; ``result`` holds all. ``lines[phase]`` (steps, lines) are the spikes
    of the phase's input lines, input by input, after the transpose buffer. ``title`` names the recording.
    """

    program: hw.ChipProgram
    title: str
    runs: Mapping[str, range]
    lines: Mapping[str, ByteArray]
    result: hw.SimulationResult

    def steps(self, phase: str) -> int:
        """Return the number of steps that a phase runs."""
        return len(self.runs[phase])

    def recorded(self, phase: str, kind: Register | Literal["spikes"], group: str) -> IntArray:
        """Return spikes, u, v or the potential of a group of a phase, (steps, compartments)."""
        runs = self.runs[phase]
        of_group: Mapping[str, IntArray] = getattr(self.result, kind)
        return of_group[group][runs.start : runs.stop]

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        """The phases that have cores, in the order in which they run."""
        return tuple(phase for phase in self.program.phases if self.program.cores_of(phase.name))

    def register(self, core: Core, kind: Register) -> IntArray:
        """Return a register of every compartment of a core, (steps, compartments)."""
        return np.concatenate(
            [self.recorded(core.phase, kind, p.group)[:, p.start : p.stop] for p in core.slices],
            axis=1,
        )

    def spikes(self, core: Core) -> ByteArray:
        """Return the spikes of every compartment of a core, (steps, compartments); joined ones never spike."""
        lines = self.lines[core.phase].shape[1]
        return self._sent[core.phase][:, lines + self.program.columns_of_core(core)]

    def input_axons(self, core: Core) -> ByteArray:
        """Return the spikes that input lines send to a core, (steps, input axons of the core)."""
        lines = self.lines[core.phase].shape[1]
        from_lines: ByteArray = self.axons(core) * (self.program.senders[core.number] < lines)
        return from_lines

    def axons(self, core: Core) -> ByteArray:
        """Return all spikes that reach a core, from input lines and from compartments, (steps, input axons)."""
        return self._sent[core.phase][:, self.program.senders[core.number]]

    def readme(self, package: str, **given: str) -> str:
        """Return the README of an emitter, filled with the names of program, recording and chip, and with more."""
        names = {"program": self.program.name, "title": self.title, "chip": self.program.chip.name}
        return filled(
            package,
            "README.template.md",
            **{key: _code_span(name) for key, name in names.items()},
            **given,
        )

    @cached_property
    def _sent(self) -> dict[str, ByteArray]:
        """The spikes of all sources of each phase, (steps, lines + columns)."""
        sent = {}
        for phase, lines in self.lines.items():
            count = sum(core.compartments for core in self.program.cores_of(phase))
            spikes = np.zeros((len(lines), count), dtype=np.uint8)
            for name, columns in self.program.columns_of(phase).items():
                if name in self.result.spikes:
                    spikes[:, columns] = self.recorded(phase, "spikes", name)
            sent[phase] = np.concatenate((lines, spikes), axis=1)
        return sent


def play_recording(program: hw.ChipProgram, spikes: Spikes, title: str = "recording 0") -> Played:
    """Play one recording (steps, channels), or a mapping of them by stream, and keep everything."""
    streams, batched = read_streams(program, spikes)
    if batched:
        raise InputError(
            "recording",
            "several recordings were given",
            fix="Give one, of shape (steps, channels).",
        )
    recording = {name: array[0] for name, array in streams.items()}
    result = hw.simulate(program, recording, probe=("spikes", "u", "v", "potential", "activity"))
    events = {name: list_events(name, array) for name, array in streams.items()}
    inputs = {phase.name: play(program, phase, events, None, Player()) for phase in program.phases}
    runs = {
        phase: range(int(played_phase.start[0]), int(played_phase.stop[0]))
        for phase, played_phase in inputs.items()
    }
    lines = {
        phase: played_phase.lines(0)[runs[phase].start : runs[phase].stop]
        for phase, played_phase in inputs.items()
    }
    return Played(program, title, runs, lines, result)


def unique_names(texts: Iterable[str]) -> dict[str, str]:
    """Return a unique name of letters, digits and underscores for every text."""
    names: dict[str, str] = {}
    for text in texts:
        base = "_" * text[:1].isdigit() + re.sub(r"[^A-Za-z0-9_]", "_", text) or "_"
        name, number = base, 2
        while name in names.values():
            name, number = f"{base}_{number}", number + 1
        names[text] = name
    return names


def _code_span(text: str) -> str:
    """Return a text as a code span of Markdown, on one line and without characters that would end it."""
    return f"`{' '.join(text.replace('`', chr(39)).split())}`"
