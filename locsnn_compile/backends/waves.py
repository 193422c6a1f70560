"""``--emit vcd``: write u, v, potential and spikes of chosen compartments as waveforms (VCD, IEEE 1364).

A microsecond in the file is one algorithmic step, and phases follow each other. Signals of a phase are unknown (x)
before it, and keep their last value after it. A user chooses compartments by probes, such as ``hidden[3]``.
"""

import io
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import hw_model as hw
from hw_model.engine.trace import REGISTERS
from hw_model.values import Frozen, IntArray
from locsnn_compile.backends.played import Played, unique_names
from locsnn_compile.errors import InputError, counted, did_you_mean

FILE = "waves.vcd"
_STEP_BITS = 32
"""Width of the number of the step."""
_PROBE = re.compile(r"(?P<group>.+)\[(?P<first>[0-9]{1,9})(?::(?P<stop>[0-9]{1,9}))?\]")
"""``group[first]`` or ``group[first:stop]``; nine digits are more than any group has compartments."""


Compartment = tuple[str, int]
"""The group of a compartment, and its number in the group."""


class _Signal(Frozen, eq=False):
    """A signal of the waveform.

    - ``scopes``: the names around it, as phase, group and compartment, from the outermost in
    - ``kind``: its type in VCD, such as ``reg`` or ``wire``
    - ``values``: one per step from time ``start`` on, in two's complement of ``width`` bits
    """

    scopes: tuple[str, ...]
    name: str
    kind: str
    width: int
    start: int
    values: IntArray
    before: str = "x"
    """The value until ``start``: unknown, unless given."""


def vcd_file(played: Played, probes: Sequence[str]) -> dict[str, bytes]:
    """Return the content of the file, by its name."""
    # A heavy import that only this emitter needs.
    from vcd import VCDWriter

    compartments = probed(played, probes)
    identifiers = unique_names(dict.fromkeys(group for group, _ in compartments))
    comment = [
        f"{_comment_text(played.program.name)}, {_comment_text(played.title)}; 1 us is one step",
        *(f"{name} is {_comment_text(group)}" for group, name in identifiers.items()),
    ]
    file = io.StringIO()
    # Without a date, equal programs give equal bytes.
    writer = VCDWriter(file, "1 us", date="", comment="\n".join(comment), version="locsnn-compile")
    changes: list[tuple[int, Any, int]] = []
    for signal in _signals(played, compartments, identifiers):
        bits = (signal.width - 1, 0) if signal.kind == "reg" else None
        variable = writer.register_var(
            signal.scopes, signal.name, signal.kind, signal.width, signal.before, bits
        )
        for step in _steps_of_change(signal.values):
            changes.append((signal.start + step, variable, int(signal.values[step])))
    # The format wants all changes in the order of time. Sorting is stable, so signals of one moment keep their order.
    for time, variable, value in sorted(changes, key=lambda change: change[0]):
        writer.change(variable, time, value)
    writer.close(sum(played.steps(phase.name) for phase in played.phases))
    return {FILE: file.getvalue().encode()}


def _steps_of_change(values: IntArray) -> list[int]:
    """Return the steps in which a signal has another value than before; the first step is one of them."""
    if len(values) == 0:
        return []
    changes: list[int] = (np.flatnonzero(np.diff(values)) + 1).tolist()
    return [0, *changes]


def _signals(
    played: Played, compartments: Sequence[Compartment], identifiers: dict[str, str]
) -> Iterator[_Signal]:
    """Yield the signals phase by phase and scope by scope; ``identifiers`` are the names of groups in the file."""
    registers = played.program.chip.registers
    # One bit more for the sign. The registers are u, v and the potential, which is as wide as v.
    current_width = registers.current_bits + 1
    voltage_width = registers.voltage_bits + 1
    widths = (current_width, voltage_width, voltage_width)
    phase_names = unique_names(phase.name for phase in played.phases)
    start = 0
    for phase in played.phases:
        phase_name = phase_names[phase.name]
        steps = np.array(played.runs[phase.name], dtype=np.int64)
        # One value more than steps: the phase ends in the step after its last.
        running = np.append(np.ones_like(steps), 0)
        yield _Signal(
            (phase_name,), "running", "wire", width=1, start=start, values=running, before="0"
        )
        yield _Signal((phase_name,), "step", "integer", _STEP_BITS, start, steps)
        for group, i in compartments:
            if group not in played.program.columns_of(phase.name):
                continue
            scopes = (phase_name, identifiers[group], f"n{i}")
            for register, width in zip(REGISTERS, widths, strict=True):
                values = played.recorded(phase.name, register, group)[:, i]
                yield _Signal(scopes, register, "reg", width, start, values)
            if group in played.result.spikes:
                spikes = played.recorded(phase.name, "spikes", group)[:, i].astype(np.int64)
                yield _Signal(scopes, "spike", "wire", width=1, start=start, values=spikes)
        start += len(steps)


def _comment_text(text: str) -> str:
    """Return a text that can stand in a comment: on one line, in ASCII, and without $, which begins a keyword."""
    one_line = " ".join(text.replace("$", "_").split())
    return one_line.encode("ascii", "replace").decode()


def probed(played: Played, probes: Sequence[str]) -> tuple[Compartment, ...]:
    """Return the compartments that probes name, and those joined to them, in the program's order.

    A probe is ``population[index]``, ``population[first:stop]`` or ``population``. Without probes, the neuron of each
    population that spikes most in the recording is chosen.
    """
    program = played.program
    chosen = [compartment for probe in probes for compartment in _read_probe(program, probe)]
    if not probes:
        chosen = [
            (name, int(spikes.sum(axis=0).argmax()))
            for name, spikes in played.result.spikes.items()
        ]
    # The list grows while it is walked through, because dendrites may have dendrites of their own.
    for group, i in chosen:
        chosen += [(name, i) for name, parent in program.joined_to.items() if parent == group]
    groups = list(program.populations)
    return tuple(
        sorted(set(chosen), key=lambda compartment: (groups.index(compartment[0]), compartment[1]))
    )


def _read_probe(program: hw.ChipProgram, probe: str) -> list[Compartment]:
    """Return the compartments that a probe names. Raise InputError if the program does not have them."""
    sizes = program.populations
    # First, because the name of a population may itself end in brackets.
    if probe in sizes:
        return [(probe, i) for i in range(sizes[probe])]
    match = _PROBE.fullmatch(probe)
    if match is None and "[" in probe:
        raise InputError(
            f"probe {probe!r}",
            "not an index",
            fix="Write population[index] or population[first:stop].",
        )
    group = match["group"] if match else probe
    if match is None or group not in sizes:
        raise InputError(
            f"probe {probe!r}", f"there is no population {group!r}", fix=did_you_mean(group, sizes)
        )
    first = int(match["first"])
    stop = int(match["stop"]) if match["stop"] else first + 1
    if stop <= first:
        raise InputError(
            f"probe {probe!r}", "it holds no compartment", fix="Let the stop be above the first."
        )
    if stop > sizes[group]:
        measured = counted(sizes[group], "compartment")
        fix = f"Count from 0 to {sizes[group] - 1}."
        raise InputError(
            f"probe {probe!r}", f"{group!r} has no such compartment", measured=measured, fix=fix
        )
    return [(group, i) for i in range(first, stop)]
