"""An independent hand: the chip's step in Python integers, compartment by compartment, for whatever a graph may hold.

It reads the graph that a program is made of, before any placing, and shares no arithmetic with ``hw_model``: widths of
registers, joined compartments in any tree, delays, refractory periods, limits of the voltage, several phases over
both axes with several inputs, late starts, readouts.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass

import numpy as np

import hw_model as hw
from hw_model.mapping.graph import CompartmentGraph, Compartments, Phase
from tests.support.played_events import Recording, extent, inputs_of, played, rows_of

KINDS = ("spikes", "u", "v", "potential")
EVENTS = ("charge_wraps", "current_wraps", "voltage_clips")


def decay(x: int, d: int) -> int:
    """What a decay of d / 4096 leaves of x: the magnitude is rounded down."""
    left = (abs(x) * (4096 - d)) // 4096
    return left if x >= 0 else -left


def wrap(x: int, bits: int) -> int:
    """What a register of so many bits and a sign holds of x."""
    span = 2 ** (bits + 1)
    low = x % span
    return low - span if low >= 2**bits else low


def charge_of(mantissa: int, exponent: int) -> int:
    """What a spike adds to the charge: 64 times the mantissa after its shift, of which low bits are lost."""
    shifted = mantissa * 2**exponent if exponent >= 0 else mantissa // 2**-exponent
    return 64 * shifted


@dataclass
class Played:
    """One recording: arrays (steps, n) by kind and population, events by population, and scores by class."""

    arrays: dict[str, dict[str, np.ndarray]]
    events: dict[str, dict[str, int]]
    active: int
    """Updates of compartments that had anything to work on."""
    scores: list[float] | None


def play(
    graph: CompartmentGraph, chip: hw.Chip, recording: Recording, steps: int | None = None
) -> Played:
    """Play a recording to every phase of a graph; ``steps`` for those that do not say theirs."""
    rows = len(next(iter(recording.values())))
    arrays: dict[str, dict[str, np.ndarray]] = {kind: {} for kind in KINDS}
    events: dict[str, Counter[str]] = defaultdict(Counter)
    active = 0
    for phase in graph.phases:
        length = rows_of(graph, phase, rows, steps)
        for group in graph.groups:
            if group.phase == phase.name:
                for kind in KINDS:
                    arrays[kind][group.name] = np.zeros((length, group.size), dtype=np.int64)
        active += _play_phase(graph, phase, chip, recording, steps, arrays, events)
    met = {
        name: {event: counts[event] for event in EVENTS}
        for name, counts in events.items()
        if counts.total()
    }
    return Played(arrays, met, active, _scores(graph, arrays))


def _play_phase(
    graph: CompartmentGraph,
    phase: Phase,
    chip: hw.Chip,
    recording: Recording,
    steps: int | None,
    arrays: dict[str, dict[str, np.ndarray]],
    events: dict[str, Counter[str]],
) -> int:
    """Run the steps of a phase; return how many updates had anything to work on."""
    groups = _children_first([group for group in graph.groups if group.phase == phase.name])
    cells = {group.name: [_Cell(group, i, chip) for i in range(group.size)] for group in groups}
    reached = _synapses_of(graph)
    due: dict[int, Counter[tuple[str, int]]] = defaultdict(Counter)

    def send(source: str, index: int, step: int) -> None:
        for target, i, delay, charge in reached[source, index]:
            due[step + 1 + delay][target, i] += charge

    lines = defaultdict(list)
    for item in inputs_of(graph, phase):
        for step, line in played(graph, item, phase, recording, steps):
            lines[step].append((item.name, line))

    active = 0
    _, begin, end = extent(graph, phase, recording, steps)
    for step in range(begin, end):
        arrived = due.pop(step, Counter())
        passed: Counter[tuple[str, int]] = Counter()
        spikes = lines[step]
        for group in groups:
            for i, cell in enumerate(cells[group.name]):
                active += cell.has_work(arrived[group.name, i], passed[group.name, i])
                cell.step(arrived[group.name, i], passed[group.name, i], events[group.name])
                if group.joined_to is not None:
                    passed[group.joined_to, i] += cell.v
                if cell.spike:
                    spikes.append((group.name, i))
                for kind, value in zip(KINDS, cell.seen(), strict=True):
                    arrays[kind][group.name][step, i] = value
        for source, index in spikes:
            send(source, index, step)
    return active


class _Cell:
    """One compartment: its registers u, v and the count of blocked steps."""

    def __init__(self, group: Compartments, i: int, chip: hw.Chip) -> None:
        self.charge_bits = chip.registers.charge_bits
        self.current_bits = chip.registers.current_bits
        self.decay_u = int(group.decay_u[i])
        self.decay_v = int(group.decay_v[i])
        self.threshold = 64 * int(group.threshold[i])
        self.bias = int(group.bias_mantissa[i]) * 2 ** int(group.bias_exponent[i])
        self.refractory = int(group.refractory[i])
        self.vmin = int(group.vmin[i])
        self.vmax = int(group.vmax[i])
        self.is_child = group.joined_to is not None
        self.u = 0
        self.v = 0
        self.hold = 0
        self.spike = False
        self.potential = 0

    def has_work(self, arrived: int, passed: int) -> bool:
        return any((arrived, passed, self.u, self.v, self.bias))

    def step(self, arrived: int, passed: int, events: Counter[str]) -> None:
        """Take what arrived, and what children passed; count what wrapped and what was clipped."""
        q = wrap(arrived, self.charge_bits)
        events["charge_wraps"] += q != arrived
        u = decay(self.u, self.decay_u) + q
        self.u = wrap(u, self.current_bits)
        events["current_wraps"] += self.u != u
        self.spike = False
        if self.hold > 0:
            self.hold -= 1
            self.v = 0
            self.potential = 0
            return
        drive = wrap(self.u + self.bias, self.current_bits)
        events["current_wraps"] += drive != self.u + self.bias
        v = decay(self.v, self.decay_v) + drive + passed
        self.potential = max(self.vmin, min(self.vmax, v))
        events["voltage_clips"] += self.potential != v
        self.spike = not self.is_child and self.potential > self.threshold
        self.v = 0 if self.spike else self.potential
        if self.spike:
            self.hold = self.refractory - 1

    def seen(self) -> tuple[int, ...]:
        """What :data:`KINDS` names."""
        return int(self.spike), self.u, self.v, self.potential


def _children_first(groups: list[Compartments]) -> list[Compartments]:
    """Order groups so that all that are joined to one come before it."""
    parent = {group.name: group.joined_to for group in groups}

    def depth(name: str) -> int:
        above = parent[name]
        return 0 if above is None else 1 + depth(above)

    return sorted(groups, key=lambda group: -depth(group.name))


def _synapses_of(
    graph: CompartmentGraph,
) -> dict[tuple[str, int], list[tuple[str, int, int, int]]]:
    """Target, index, delay and charge of every synapse, by source and index."""
    reached: dict[tuple[str, int], list[tuple[str, int, int, int]]] = defaultdict(list)
    for s in graph.synapses:
        rows = zip(
            s.source_index.tolist(),
            s.target_index.tolist(),
            s.mantissa.tolist(),
            np.broadcast_to(s.delay, s.source_index.shape).tolist(),
            strict=True,
        )
        for source, target, mantissa, delay in rows:
            charge = charge_of(mantissa, int(s.exponent))
            reached[s.source, source].append((s.target, target, delay, charge))
    return reached


def _scores(
    graph: CompartmentGraph, arrays: dict[str, dict[str, np.ndarray]]
) -> list[float] | None:
    """Spike counts, or largest potentials from a step on (0 where there is no step), weighted and added in order."""
    readout = graph.readout
    if readout is None:
        return None
    first = readout.potentials_from
    firsts = first if isinstance(first, tuple) else (first,) * len(readout.populations)
    scores = [0.0] * arrays["spikes"][readout.populations[0]].shape[1]
    for name, weight, start in zip(readout.populations, readout.weights, firsts, strict=True):
        for i in range(len(scores)):
            if start is None:
                votes = float(arrays["spikes"][name][:, i].sum())
            else:
                votes = float(max(arrays["potential"][name][start:, i].tolist(), default=0))
            scores[i] += weight * votes
    return scores
