"""What emitters share: a recording played to a program, with every spike and register, and safe names.

Files for other tools often hold one recording and its results, so that a user can check the other tool against ours.
Names of populations may have any characters; many formats allow only letters, digits and underscores.
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
    """A recording that was played to a program.

    - ``title``: names the recording in the files
    - ``runs[phase]``: the steps that a phase runs: all, or those from the first event on for a phase that begins there
    - ``lines[phase]``: the spikes of the phase's input lines, (steps, lines), input by input. Events that went through
      the transpose buffer are already transposed
    - ``result``: what the program did, in all steps

    Lines, and what methods return, hold only the steps of ``runs``.
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
        by_group: Mapping[str, IntArray] = getattr(self.result, kind)
        return by_group[group][runs.start : runs.stop]

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        """The phases that have cores, in the order in which they run."""
        return tuple(phase for phase in self.program.phases if self.program.cores_of(phase.name))

    def register(self, core: Core, kind: Register) -> IntArray:
        """Return a register of every compartment of a core, (steps, compartments)."""
        slices = []
        for core_slice in core.slices:
            group_values = self.recorded(core.phase, kind, core_slice.group)
            slices.append(group_values[:, core_slice.start : core_slice.stop])
        return np.concatenate(slices, axis=1)

    def spikes(self, core: Core) -> ByteArray:
        """Return the spikes of every compartment of a core, (steps, compartments).

        Compartments that are joined to a parent (dendrites) never spike.
        """
        lines = self.lines[core.phase].shape[1]
        return self._sent[core.phase][:, lines + self.program.columns_of_core(core)]

    def input_axons(self, core: Core) -> ByteArray:
        """Return the spikes that reach a core from input lines, (steps, input axons); 0 on axons of compartments."""
        lines = self.lines[core.phase].shape[1]
        is_line = self.program.senders[core.number] < lines
        from_lines: ByteArray = self.axons(core) * is_line
        return from_lines

    def axons(self, core: Core) -> ByteArray:
        """Return all spikes that reach a core, from input lines and from compartments, (steps, input axons)."""
        return self._sent[core.phase][:, self.program.senders[core.number]]

    def readme(self, package: str, **values: str) -> str:
        """Return the README of an emitter, with the names of program, recording and chip and further values filled in.

        ``package`` is that of the emitter, which holds the template.
        """
        names = {"program": self.program.name, "title": self.title, "chip": self.program.chip.name}
        code_spans = {key: _code_span(name) for key, name in names.items()}
        return filled(package, "README.template.md", **code_spans, **values)

    @cached_property
    def _sent(self) -> dict[str, ByteArray]:
        """The spikes of all senders of each phase, (steps, lines + compartments).

        The columns are numbered as in ``program.senders``: input lines first, then compartments.
        """
        sent = {}
        for phase, lines in self.lines.items():
            compartments = sum(core.compartments for core in self.program.cores_of(phase))
            spikes = np.zeros((len(lines), compartments), dtype=np.uint8)
            for name, columns in self.program.columns_of(phase).items():
                # Groups that never spike are not in the result.
                if name in self.result.spikes:
                    spikes[:, columns] = self.recorded(phase, "spikes", name)
            sent[phase] = np.concatenate((lines, spikes), axis=1)
        return sent


def play_recording(program: hw.ChipProgram, spikes: Spikes, title: str = "recording 0") -> Played:
    """Play one recording, and keep every spike and register.

    ``spikes`` are (steps, channels), or a mapping of such arrays by stream, for a program with several input streams.
    """
    streams, batched = read_streams(program, spikes)
    if batched:
        raise InputError(
            "recording",
            "several recordings were given",
            fix="Give one, of shape (steps, channels).",
        )
    # Streams are batches of recordings, (recordings, steps, channels); this batch has one.
    recording = {name: array[0] for name, array in streams.items()}
    result = hw.simulate(program, recording, probe=("spikes", "u", "v", "potential", "activity"))
    events = {name: list_events(name, array) for name, array in streams.items()}
    runs = {}
    lines = {}
    for phase in program.phases:
        phase_input = play(program, phase, events, steps=None, player=Player())
        run = range(int(phase_input.start[0]), int(phase_input.stop[0]))
        runs[phase.name] = run
        lines[phase.name] = phase_input.lines(0)[run.start : run.stop]
    return Played(program, title, runs, lines, result)


def unique_names(texts: Iterable[str]) -> dict[str, str]:
    """Return a unique identifier of letters, digits and underscores for every text.

    It does not begin with a digit. Texts that would get the same identifier are numbered from 2 on.
    """
    names: dict[str, str] = {}
    for text in texts:
        identifier = re.sub(r"[^A-Za-z0-9_]", "_", text)
        if not identifier or text[:1].isdigit():
            identifier = f"_{identifier}"
        name = identifier
        number = 2
        while name in names.values():
            name = f"{identifier}_{number}"
            number += 1
        names[text] = name
    return names


def _code_span(text: str) -> str:
    """Return a text as a code span of Markdown, on one line and without backticks, which would end it."""
    without_backticks = text.replace("`", "'")
    one_line = " ".join(without_backticks.split())
    return f"`{one_line}`"
