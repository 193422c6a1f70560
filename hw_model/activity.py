"""Count what a phase did, step by step and core by core, from its spikes and the program's tables."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy import sparse

from hw_model.counts import BY_CORE, Counts
from hw_model.fixed_point import IntArray
from hw_model.program import ChipProgram
from hw_model.trace import PhaseInput, PhaseTrace


@dataclass(frozen=True, eq=False)
class StepActivity:
    """One recording in one phase: ``by_core[name]`` (steps, cores) for each of :data:`hw_model.counts.BY_CORE`."""

    by_core: dict[str, IntArray]
    counts: Counts

    def count(self, name: str) -> IntArray:
        """Return a count, or one derived from them, (steps, cores)."""
        if name == "neuron_updates_inactive":
            return self.by_core["neuron_updates"] - self.by_core["neuron_updates_active"]
        if name == "hops":
            return self.by_core["hops_x"] + self.by_core["hops_y"]
        return self.by_core[name]


@dataclass(frozen=True, eq=False)
class _FanOut:
    """What one spike of each source (input lines, then compartments) causes."""

    lines: int
    starts: IntArray
    ops: Any
    """Sparse (sources, cores): synapses at each core."""
    due_late: IntArray
    """(longest delay + 1, sources): synapses with at least that delay."""
    packets: IntArray
    """(4, sources): packets, packets within the tile, hops x, hops y."""


def count_activity(program: ChipProgram, phase: str, played: PhaseInput, trace: PhaseTrace) -> StepActivity:
    """Multiply spikes by what each causes; integers throughout."""
    fan = _fan_out(program, phase)
    cores = program.cores_of(phase)
    lines = np.concatenate([played.lines[item.name] for item in program.inputs_of(phase)], axis=1)
    sources = np.concatenate((lines, trace.spikes), axis=1)
    sizes = np.array([core.compartments for core in cores], dtype=np.int64)
    wide = trace.spikes.astype(np.int64)
    by_core: dict[str, IntArray] = {
        "synaptic_ops": np.asarray((sparse.csr_array(sources.astype(np.int64)) @ fan.ops).todense()),
        "neuron_updates": np.broadcast_to(sizes, (played.steps, len(cores))),
        "neuron_updates_active": trace.active,
        "spikes": _per_core(wide, fan.starts),
    }
    for name, per_spike in zip(BY_CORE[4:], fan.packets[:, fan.lines :], strict=True):
        by_core[name] = _per_core(wide * per_spike, fan.starts)
    wraps_and_clips = trace.events.sum(axis=1)
    counts = Counts(
        input_events=played.input_events,
        transpose_events=played.transpose_events,
        events_dropped=played.events_dropped,
        synaptic_ops_after_end=_due_after_end(sources, fan.due_late),
        input_packets=int((lines.sum(axis=0, dtype=np.int64) * fan.packets[0, : fan.lines]).sum()),
        charge_wraps=int(wraps_and_clips[0]),
        current_wraps=int(wraps_and_clips[1]),
        voltage_clips=int(wraps_and_clips[2]),
        **{name: int(by_core[name].sum()) for name in BY_CORE},
    )
    return StepActivity(by_core, counts)


def _per_core(values: IntArray, starts: IntArray) -> IntArray:
    summed: IntArray = np.add.reduceat(values, starts, axis=1)
    return summed


def _due_after_end(sources: Any, due_late: IntArray) -> int:
    """A spike d rows before the end is too late for the synapses whose delay is at least d."""
    last = sources[::-1][: len(due_late)].astype(np.int64)
    return int((last * due_late[: len(last)]).sum())


@lru_cache(maxsize=8)
def _fan_out(program: ChipProgram, phase: str) -> _FanOut:
    cores = program.cores_of(phase)
    column = {core.number: i for i, core in enumerate(cores)}
    sizes = [core.compartments for core in cores]
    starts = np.cumsum([0, *sizes])[:-1]
    inputs = program.inputs_of(phase)
    line_first = np.cumsum([0, *(item.size for item in inputs)])
    lines = int(line_first[-1])
    ops = sparse.lil_array((lines + sum(sizes), len(cores)), dtype=np.int64)
    longest = max((int(core.axons.delay.max(initial=0)) for core in cores), default=0)
    due_late = np.zeros((longest + 1, lines + sum(sizes)), dtype=np.int64)
    packets = np.zeros((4, lines + sum(sizes)), dtype=np.int64)

    def add(source: int, to_core: int, axon: int, from_core: int | None) -> None:
        axons = program.cores[to_core].axons
        row = slice(int(axons.list_start[axon]), int(axons.list_start[axon + 1]))
        ops[source, column[to_core]] += row.stop - row.start
        late = np.bincount(axons.delay[row], minlength=longest + 1)
        due_late[:, source] += late[::-1].cumsum()[::-1]
        packets[0, source] += 1
        if from_core is not None:
            packets[1:, source] += _journey(program, from_core, to_core)

    for item, at in zip(inputs, line_first[:-1], strict=True):
        route = program.route_of(item.name)
        for line, to_core, axon in zip(route.line, route.core, route.axon, strict=True):
            add(int(line + at), int(to_core), int(axon), None)
    for core, at in zip(cores, starts, strict=True):
        axons = core.axons
        for sender, to_core, axon in zip(axons.out_compartment, axons.out_core, axons.out_axon, strict=True):
            add(int(lines + at + sender), int(to_core), int(axon), core.number)
    return _FanOut(lines, starts, sparse.csr_array(ops), due_late, packets)


def _journey(program: ChipProgram, from_core: int, to_core: int) -> tuple[int, int, int]:
    """Return (within a tile, hops x, hops y) of a packet."""
    hops_x, hops_y = program.chip.hops(program.cores[from_core].slot, program.cores[to_core].slot)
    return int(hops_x == hops_y == 0), hops_x, hops_y
