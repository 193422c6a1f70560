"""The oracle: an independent simulator of the chip in plain Python integers, one compartment at a time.

Engines of ``hw_model`` are tested against it. It reads the graph of a program, before cores are placed, and shares no
arithmetic with ``hw_model``. It knows register widths, joined compartments in any tree, delays, refractory periods,
voltage limits, several phases over both axes with several inputs, late starts, and readouts.
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
    """Return what a decay of d / 4096 leaves of x; its magnitude is rounded down."""
    magnitude = (abs(x) * (4096 - d)) // 4096
    return magnitude if x >= 0 else -magnitude


def wrap(x: int, bits: int) -> int:
    """Return what a register of ``bits`` and a sign holds of x."""
    span = 2 ** (bits + 1)
    low = x % span
    return low - span if low >= 2**bits else low


def charge_of(mantissa: int, exponent: int) -> int:
    """Return what a spike adds to a charge: 64 times the mantissa shifted by its exponent, rounded down."""
    shifted = mantissa * 2**exponent if exponent >= 0 else mantissa // 2**-exponent
    return 64 * shifted


@dataclass
class Played:
    """The play of one recording.

    ``arrays`` (steps, n) by kind (:data:`KINDS`) and population; ``events`` counts wraps and clips by population and
    event (:data:`EVENTS`), without populations that had none; ``scores`` are by class.
    """

    arrays: dict[str, dict[str, np.ndarray]]
    events: dict[str, dict[str, int]]
    active: int
    """Updates of compartments that had a charge, a state or a bias."""
    scores: list[float] | None


def play(
    graph: CompartmentGraph, chip: hw.Chip, recording: Recording, steps: int | None = None
) -> Played:
    """Play a recording to every phase of a graph; ``steps`` is the length of phases that do not state theirs."""
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
    events_that_occurred = {
        name: {event: counts[event] for event in EVENTS}
        for name, counts in events.items()
        if counts.total()
    }
    return Played(arrays, events_that_occurred, active, _scores(graph, arrays))


def _play_phase(
    graph: CompartmentGraph,
    phase: Phase,
    chip: hw.Chip,
    recording: Recording,
    steps: int | None,
    arrays: dict[str, dict[str, np.ndarray]],
    events: dict[str, Counter[str]],
) -> int:
    """Run the steps of a phase, fill in ``arrays`` and ``events``, and return the number of active updates."""
    groups = _children_first([group for group in graph.groups if group.phase == phase.name])
    cells = {group.name: [_Cell(group, i, chip) for i in range(group.size)] for group in groups}
    synapses = _synapses_of(graph)
    # By step, and by population and index: the charges that will arrive.
    due: dict[int, Counter[tuple[str, int]]] = defaultdict(Counter)

    def send(source: str, index: int, step: int) -> None:
        for target, i, delay, charge in synapses[source, index]:
            due[step + 1 + delay][target, i] += charge

    input_spikes = defaultdict(list)
    for item in inputs_of(graph, phase):
        for step, line in played(graph, item, phase, recording, steps):
            input_spikes[step].append((item.name, line))

    active = 0
    _, begin, end = extent(graph, phase, recording, steps)
    for step in range(begin, end):
        arrived = due.pop(step, Counter())
        from_children: Counter[tuple[str, int]] = Counter()
        spikes = input_spikes[step]
        for group in groups:
            for i, cell in enumerate(cells[group.name]):
                charge = arrived[group.name, i]
                joined = from_children[group.name, i]
                active += cell.has_work(charge, joined)
                cell.step(charge, joined, events[group.name])
                if group.joined_to is not None:
                    from_children[group.joined_to, i] += cell.v
                if cell.spike:
                    spikes.append((group.name, i))
                for kind, value in zip(KINDS, cell.state(), strict=True):
                    arrays[kind][group.name][step, i] = value
        for source, index in spikes:
            send(source, index, step)
    return active


class _Cell:
    """One compartment.

    Its registers are u, v, and ``hold``, the number of steps for which it stays blocked after a spike. ``potential`` is v
    before a reset.
    """

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

    def has_work(self, charge: int, joined: int) -> bool:
        """Return whether a step may change a register: the chip's counts call such an update active."""
        return any((charge, joined, self.u, self.v, self.bias))

    def step(self, charge: int, joined: int, events: Counter[str]) -> None:
        """Take the charge that arrived and the voltages of joined children; count wraps and clips."""
        q = wrap(charge, self.charge_bits)
        events["charge_wraps"] += q != charge
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
        v = decay(self.v, self.decay_v) + drive + joined
        self.potential = max(self.vmin, min(self.vmax, v))
        events["voltage_clips"] += self.potential != v
        self.spike = not self.is_child and self.potential > self.threshold
        self.v = 0 if self.spike else self.potential
        if self.spike:
            self.hold = self.refractory - 1

    def state(self) -> tuple[int, ...]:
        """Return what :data:`KINDS` names."""
        return int(self.spike), self.u, self.v, self.potential


def _children_first(groups: list[Compartments]) -> list[Compartments]:
    """Sort groups so that joined children come before their parents, which add the children's voltages."""
    parent = {group.name: group.joined_to for group in groups}

    def depth(name: str) -> int:
        parent_name = parent[name]
        return 0 if parent_name is None else 1 + depth(parent_name)

    return sorted(groups, key=lambda group: -depth(group.name))


def _synapses_of(
    graph: CompartmentGraph,
) -> dict[tuple[str, int], list[tuple[str, int, int, int]]]:
    """Return (target, target index, delay, charge) of every synapse, by source and source index."""
    synapses: dict[tuple[str, int], list[tuple[str, int, int, int]]] = defaultdict(list)
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
            synapses[s.source, source].append((s.target, target, delay, charge))
    return synapses


def _scores(
    graph: CompartmentGraph, arrays: dict[str, dict[str, np.ndarray]]
) -> list[float] | None:
    """Return the score of each class: the weighted sum over the populations of a readout, in their order.

    Summed are spike counts, or largest potentials from a step on (0 if the phase has no such step).
    """
    readout = graph.readout
    if readout is None:
        return None
    starts = readout.potentials_from
    if not isinstance(starts, tuple):
        starts = (starts,) * len(readout.populations)
    classes = arrays["spikes"][readout.populations[0]].shape[1]
    scores = [0.0] * classes
    for name, weight, start in zip(readout.populations, readout.weights, starts, strict=True):
        for i in range(len(scores)):
            if start is None:
                votes = float(arrays["spikes"][name][:, i].sum())
            else:
                votes = float(max(arrays["potential"][name][start:, i].tolist(), default=0))
            scores[i] += weight * votes
    return scores
