"""``--emit vcd``: u, v, potential and spikes of chosen compartments as a value change dump (IEEE 1364), for a viewer.

A microsecond in the file is one algorithmic step, and phases follow each other. Signals of a phase are unknown (x)
before it, and keep their last value after it.
"""

import re
from collections.abc import Iterator, Sequence

import numpy as np

import hw_model as hw
from hw_model.values import Frozen, IntArray
from locsnn_compile.backends.played import Played, unique_names
from locsnn_compile.errors import InputError, counted, did_you_mean

FILE = "waves.vcd"
_STEP_BITS = 32
_PROBE = re.compile(r"(?P<group>.+)\[(?P<first>[0-9]{1,9})(?::(?P<stop>[0-9]{1,9}))?\]")


class _Signal(Frozen, eq=False):
    """A signal in its scopes: ``values`` from time ``start`` on, in two's complement of ``width`` bits."""

    scopes: tuple[str, ...]
    name: str
    kind: str
    width: int
    start: int
    values: IntArray

    def changes(self) -> Iterator[tuple[int, str]]:
        """Yield each time at which the value changes, with all bits of the new one.

        Readers fill up with zeros, which would make negative numbers positive.
        """
        if self.start > 0:
            yield 0, "0" if self.name == "running" else "x"
        for i in np.flatnonzero(np.append(True, np.diff(self.values) != 0)).tolist():
            yield self.start + i, format(int(self.values[i]) & (1 << self.width) - 1, f"0{self.width}b")
        if self.name == "running":
            yield self.start + len(self.values), "0"


def vcd_file(played: Played, probes: Sequence[str]) -> dict[str, bytes]:
    """Return the file by name."""
    compartments = probed(played, probes)
    groups = unique_names(dict.fromkeys(c.group for c in compartments))
    signals = list(_signals(played, compartments, groups))
    end = sum(played.steps(phase.name) for phase in played.phases)
    lines = [
        "$version locsnn-compile $end",
        f"$comment {_plain(played.program.name)}, {_plain(played.title)}; 1 us is one step $end",
        *(f"$comment {name} is {_plain(group)} $end" for group, name in groups.items()),
        "$timescale 1 us $end",
        *_declarations(signals),
        "$enddefinitions $end",
        *_changes(signals, end),
    ]
    return {FILE: ("\n".join(lines) + "\n").encode()}


def _signals(played: Played, compartments: "Sequence[Compartment]", groups: dict[str, str]) -> Iterator[_Signal]:
    """Yield the signals phase by phase and scope by scope."""
    registers, result, start = played.program.chip.registers, played.result, 0
    current, voltage = registers.current_bits + 1, registers.voltage_bits + 1
    names = unique_names(phase.name for phase in played.phases)
    for phase in played.phases:
        steps = np.arange(played.steps(phase.name))
        yield _Signal((names[phase.name],), "running", "wire", 1, start, np.ones_like(steps))
        yield _Signal((names[phase.name],), "step", "integer", _STEP_BITS, start, steps)
        for group, i in ((c.group, c.index) for c in compartments):
            if group not in played.program.columns_of(phase.name):
                continue
            scopes = (names[phase.name], groups[group], f"n{i}")
            for kind, width in (("u", current), ("v", voltage), ("potential", voltage)):
                yield _Signal(scopes, kind, "reg", width, start, getattr(result, kind)[group][:, i])
            if group in result.spikes:
                yield _Signal(scopes, "spike", "wire", 1, start, result.spikes[group][:, i].astype(np.int64))
        start += len(steps)


def _declarations(signals: Sequence[_Signal]) -> Iterator[str]:
    """Yield the variables between the start and end of their scopes; the code of signal 3 in the file is ``s3``."""
    open_scopes: tuple[str, ...] = ()
    for number, signal in enumerate(signals):
        common = 0
        while common < min(len(open_scopes), len(signal.scopes)) and open_scopes[common] == signal.scopes[common]:
            common += 1
        yield from ["$upscope $end"] * (len(open_scopes) - common)
        yield from (f"$scope module {name} $end" for name in signal.scopes[common:])
        bits = f" [{signal.width - 1}:0]" if signal.kind == "reg" else ""
        yield f"$var {signal.kind} {signal.width} s{number} {signal.name}{bits} $end"
        open_scopes = signal.scopes
    yield from ["$upscope $end"] * len(open_scopes)


def _changes(signals: Sequence[_Signal], end: int) -> Iterator[str]:
    """Yield every time at which values change, with the new values."""
    changes: dict[int, list[str]] = {0: [], end: []}
    for number, signal in enumerate(signals):
        form = "{}s{}" if signal.width == 1 else "b{} s{}"
        for time, bits in signal.changes():
            changes.setdefault(time, []).append(form.format(bits, number))
    for time in sorted(changes):
        yield f"#{time}"
        yield from ["$dumpvars"] * (time == 0)
        yield from changes[time]
        yield from ["$end"] * (time == 0)


def _plain(text: str) -> str:
    """Return a text without characters that would end a comment or a line."""
    return " ".join(text.replace("$", "_").split()).encode("ascii", "replace").decode()


class Compartment(Frozen):
    """Compartment ``index`` of a group."""

    group: str
    index: int


def probed(played: Played, probes: Sequence[str]) -> tuple[Compartment, ...]:
    """Return the compartments that probes name, and those joined to them, in the program's order.

    A probe is ``population[index]``, ``population[first:stop]`` or ``population``. Without probes, it is the neuron of
    every population that spikes most in the recording.
    """
    program = played.program
    chosen = [compartment for probe in probes for compartment in _read(program, probe)]
    if not probes:
        chosen = [Compartment(name, int(spikes.sum(axis=0).argmax())) for name, spikes in played.result.spikes.items()]
    for compartment in chosen:
        chosen += [
            Compartment(name, compartment.index) for name, to in program.joined_to.items() if to == compartment.group
        ]
    order = list(program.populations)
    return tuple(sorted(set(chosen), key=lambda c: (order.index(c.group), c.index)))


def _read(program: hw.ChipProgram, probe: str) -> list[Compartment]:
    sizes = program.populations
    if probe in sizes:
        return [Compartment(probe, i) for i in range(sizes[probe])]
    match = _PROBE.fullmatch(probe)
    if match is None and "[" in probe:
        raise InputError(f"probe {probe!r}", "not an index", fix="Write population[index] or population[first:stop].")
    group = match["group"] if match else probe
    if match is None or group not in sizes:
        raise InputError(f"probe {probe!r}", f"there is no population {group!r}", fix=did_you_mean(group, sizes))
    first = int(match["first"])
    stop = int(match["stop"]) if match["stop"] else first + 1
    if not first < stop <= sizes[group]:
        measured = counted(sizes[group], "compartment")
        fix = f"Count from 0 to {sizes[group] - 1}."
        raise InputError(f"probe {probe!r}", f"{group!r} has no such compartment", measured=measured, fix=fix)
    return [Compartment(group, i) for i in range(first, stop)]
