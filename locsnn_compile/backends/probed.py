"""Which compartments to show: ``--probe population[index]``, and what is shown where nothing is asked for."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import hw_model as hw
from locsnn_compile.backends.played import Played
from locsnn_compile.errors import InputError, did_you_mean

_PROBE = re.compile(r"(?P<group>.+)\[(?P<first>[0-9]{1,9})(?::(?P<stop>[0-9]{1,9}))?\]")


@dataclass(frozen=True, order=True)
class Compartment:
    """Compartment ``index`` of a group."""

    group: str
    index: int


def probed(played: Played, probes: Sequence[str]) -> tuple[Compartment, ...]:
    """Return the compartments that probes name, those joined to them included, in the program's order.

    A probe is ``population[index]``, ``population[first:stop]`` or ``population``. With none, the neuron of every
    population that spikes most in the recording, the first of equals.
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
        raise InputError(
            f"probe {probe!r}",
            f"{group!r} has no such compartment",
            measured=f"{sizes[group]} compartments",
            fix=f"Count from 0 to {sizes[group] - 1}.",
        )
    return [Compartment(group, i) for i in range(first, stop)]
