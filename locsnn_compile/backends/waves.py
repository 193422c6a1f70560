"""``--emit vcd``: u, v, potential and spikes of chosen compartments as a value change dump (IEEE 1364), for a viewer.

A microsecond in the file is one algorithmic step, and phases follow each other. Signals of a phase are unknown (x)
before it, and keep their last value after it.
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
_PROBE = re.compile(r"(?P<group>.+)\[(?P<first>[0-9]{1,9})(?::(?P<stop>[0-9]{1,9}))?\]")


Compartment = tuple[str, int]
"""Its group, and its number there."""


class _Signal(Frozen, eq=False):
    """A signal in its scopes: ``values`` from time ``start`` on, in two's complement of ``width`` bits."""

    scopes: tuple[str, ...]
    name: str
    kind: str
    width: int
    start: int
    values: IntArray
    before: str = "x"
    """The value until then."""


def vcd_file(played: Played, probes: Sequence[str]) -> dict[str, bytes]:
    """Return the file by name."""
    from vcd import VCDWriter  # only who writes such a file waits for it

    compartments = probed(played, probes)
    groups = unique_names(dict.fromkeys(group for group, _ in compartments))
    about = [
        f"{_plain(played.program.name)}, {_plain(played.title)}; 1 us is one step",
        *(f"{name} is {_plain(group)}" for group, name in groups.items()),
    ]
    file = io.StringIO()
    writer = VCDWriter(file, "1 us", date="", comment="\n".join(about), version="locsnn-compile")
    changes: list[tuple[int, Any, int]] = []
    for signal in _signals(played, compartments, groups):
        bits = (signal.width - 1, 0) if signal.kind == "reg" else None
        variable = writer.register_var(
            signal.scopes, signal.name, signal.kind, signal.width, signal.before, bits
        )
        at = np.flatnonzero(np.append(True, np.diff(signal.values) != 0)[: len(signal.values)])
        changes += (
            (signal.start + i, variable, value)
            for i, value in zip(at.tolist(), signal.values[at].tolist(), strict=True)
        )
    for time, variable, value in sorted(changes, key=lambda change: change[0]):
        writer.change(variable, time, value)
    writer.close(sum(played.steps(phase.name) for phase in played.phases))
    return {FILE: file.getvalue().encode()}


def _signals(
    played: Played, compartments: Sequence[Compartment], groups: dict[str, str]
) -> Iterator[_Signal]:
    """Yield the signals phase by phase and scope by scope."""
    registers, start = played.program.chip.registers, 0
    current, voltage = registers.current_bits + 1, registers.voltage_bits + 1
    names = unique_names(phase.name for phase in played.phases)
    for phase in played.phases:
        steps = np.array(played.runs[phase.name], dtype=np.int64)
        running = np.append(np.ones_like(steps), 0)
        yield _Signal((names[phase.name],), "running", "wire", 1, start, running, before="0")
        yield _Signal((names[phase.name],), "step", "integer", _STEP_BITS, start, steps)
        for group, i in compartments:
            if group not in played.program.columns_of(phase.name):
                continue
            scopes = (names[phase.name], groups[group], f"n{i}")
            for kind, width in zip(REGISTERS, (current, voltage, voltage), strict=True):
                yield _Signal(
                    scopes,
                    kind,
                    "reg",
                    width,
                    start,
                    played.recorded(phase.name, kind, group)[:, i],
                )
            if group in played.result.spikes:
                spikes = played.recorded(phase.name, "spikes", group)[:, i].astype(np.int64)
                yield _Signal(scopes, "spike", "wire", 1, start, spikes)
        start += len(steps)


def _plain(text: str) -> str:
    """Return a text without characters that would end a comment or a line."""
    return " ".join(text.replace("$", "_").split()).encode("ascii", "replace").decode()


def probed(played: Played, probes: Sequence[str]) -> tuple[Compartment, ...]:
    """Return the compartments that probes name, and those joined to them, in the program's order.

    A probe is ``population[index]``, ``population[first:stop]`` or ``population``. Without probes, it is the neuron of
    every population that spikes most in the recording.
    """
    program = played.program
    chosen = [compartment for probe in probes for compartment in _read(program, probe)]
    if not probes:
        chosen = [
            (name, int(spikes.sum(axis=0).argmax()))
            for name, spikes in played.result.spikes.items()
        ]
    for group, i in chosen:
        chosen += [(name, i) for name, to in program.joined_to.items() if to == group]
    order = list(program.populations)
    return tuple(sorted(set(chosen), key=lambda c: (order.index(c[0]), c[1])))


def _read(program: hw.ChipProgram, probe: str) -> list[Compartment]:
    sizes = program.populations
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
