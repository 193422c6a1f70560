"""Count what a batch did in a phase, from its spikes and from what one spike of each source causes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from hw_model.counts import BY_CORE, COUNTED
from hw_model.fixed_point import IntArray
from hw_model.program import ChipProgram
from hw_model.trace import EVENTS, ByteArray, PhaseInput, PhaseTrace

PER_PACKET = ("axon_packets", "packets_within_tile", "hops_x", "hops_y")


@dataclass(frozen=True, eq=False)
class StepActivity:
    """One recording in one phase: ``by_core[name]`` (steps, cores) for each of :data:`hw_model.counts.BY_CORE`."""

    by_core: dict[str, IntArray]

    def count(self, name: str) -> IntArray:
        """Return a count, or one derived from them, (steps, cores)."""
        if name == "neuron_updates_inactive":
            return self.by_core["neuron_updates"] - self.by_core["neuron_updates_active"]
        if name == "hops":
            return self.by_core["hops_x"] + self.by_core["hops_y"]
        return self.by_core[name]


@dataclass(frozen=True, eq=False)
class FanOut:
    """What one spike of each source causes; sources are input lines, then columns.

    ``synapses`` (sources, cores of the phase): synapses at each core. ``due_late`` (longest delay + 1, sources): of
    them, those with at least that delay. ``packets`` (sources, 4): of a compartment, :data:`PER_PACKET`.
    ``input_packets`` (lines,): packets that carry an event of a line. ``core`` (columns,): where each column is among
    the phase's cores.
    """

    synapses: IntArray
    due_late: IntArray
    packets: IntArray
    input_packets: IntArray
    core: IntArray


def count_totals(program: ChipProgram, phase: str, played: PhaseInput, trace: PhaseTrace) -> IntArray:
    """Return the counts of every recording, (batch, fields of Counts): spikes of each source times what one causes."""
    fan = fan_out(program, phase)
    lines = len(fan.input_packets)
    packets = trace.sent @ fan.packets
    events = trace.events.sum(axis=2)
    columns = {
        "input_events": played.input_events,
        "transpose_events": played.transpose_events,
        "events_dropped": played.events_dropped,
        "synaptic_ops": trace.sent @ fan.synapses.sum(axis=1),
        "synaptic_ops_after_end": _due_after_end(played, trace.spikes, fan.due_late),
        "neuron_updates": played.steps * len(fan.core),
        "neuron_updates_active": trace.active.sum(axis=(1, 2), dtype=np.int64),
        "spikes": trace.sent[:, lines:].sum(axis=1),
        **{name: packets[:, k] for k, name in enumerate(PER_PACKET)},
        "input_packets": trace.sent[:, :lines] @ fan.input_packets,
        **{name: events[:, k] for k, name in enumerate(EVENTS)},
        "skipped_steps": trace.skipped,
    }
    table = np.empty((len(trace.sent), len(COUNTED)), dtype=np.int64)
    for k, name in enumerate(COUNTED):
        table[:, k] = columns[name]
    return table


def count_steps(program: ChipProgram, phase: str, played: PhaseInput, trace: PhaseTrace) -> list[StepActivity]:
    """Return the counts of every recording step by step and core by core."""
    fan = fan_out(program, phase)
    cores = len(program.cores_of(phase))
    lines = len(fan.input_packets)
    on_core = np.zeros((len(fan.core), cores), dtype=np.float64)
    on_core[np.arange(len(fan.core)), fan.core] = 1
    sizes = on_core.sum(axis=0).astype(np.int64)
    found = []
    for i in range(len(trace.spikes)):
        spikes = trace.spikes[i].astype(np.float64)
        synapses = played.lines(i).astype(np.float64) @ fan.synapses[:lines] + spikes @ fan.synapses[lines:]
        by_core = {
            "synaptic_ops": _whole(synapses),
            "neuron_updates": np.broadcast_to(sizes, (played.steps, cores)),
            "neuron_updates_active": trace.active[i].astype(np.int64),
            "spikes": _whole(spikes @ on_core),
        }
        for name, per_spike in zip(PER_PACKET, fan.packets[lines:].T, strict=True):
            by_core[name] = _whole(spikes @ (on_core * per_spike[:, None]))
        assert set(by_core) == set(BY_CORE)
        found.append(StepActivity(by_core))
    return found


def _whole(sums: npt.NDArray[np.float64]) -> IntArray:
    """Sums of integers below 2^53 are exact in float64, and its matrix product is the fast one."""
    return sums.astype(np.int64)


def _due_after_end(played: PhaseInput, spikes: ByteArray, due_late: IntArray) -> IntArray:
    """A spike d rows before the end is too late for the synapses whose delay is at least d."""
    lines = sum(played.sizes)
    late = np.zeros(len(spikes), dtype=np.int64)
    for d in range(min(len(due_late), played.steps)):
        row = played.steps - 1 - d
        late += spikes[:, row].astype(np.int64) @ due_late[d, lines:]
        offset = 0
        for events, size in zip(played.events, played.sizes, strict=True):
            recording, channel = events.at(row)
            np.add.at(late, recording, due_late[d, offset + channel])
            offset += size
    return late


@lru_cache(maxsize=8)
def fan_out(program: ChipProgram, phase: str) -> FanOut:
    """Follow every axon of a phase. Programs are hashed by identity."""
    cores = program.cores_of(phase)
    place = {core.number: i for i, core in enumerate(cores)}
    columns = {core.number: program.columns_of_core(core) for core in cores}
    inputs = program.inputs_of(phase)
    lines = sum(item.size for item in inputs)
    count = lines + sum(core.compartments for core in cores)
    longest = max((int(core.axons.delay.max(initial=0)) for core in cores), default=0)
    synapses = np.zeros((count, len(cores)), dtype=np.int64)
    due_late = np.zeros((longest + 1, count), dtype=np.int64)
    packets = np.zeros((count, len(PER_PACKET)), dtype=np.int64)
    input_packets = np.zeros(lines, dtype=np.int64)
    core_of = np.empty(count - lines, dtype=np.int64)

    # How many synapses of each delay an axon has, for every core.
    by_delay = {}
    for core in cores:
        axons = core.axons
        axon = np.repeat(np.arange(axons.input_axons), np.diff(axons.list_start))
        table = np.bincount(axon * (longest + 1) + axons.delay, minlength=axons.input_axons * (longest + 1))
        by_delay[core.number] = table.reshape(-1, longest + 1)

    def arrive(sources: IntArray, to_core: IntArray, to_axon: IntArray) -> None:
        for number in np.unique(to_core):
            mine = to_core == number
            table = by_delay[int(number)][to_axon[mine]]
            np.add.at(synapses[:, place[int(number)]], sources[mine], table.sum(axis=1))
            np.add.at(due_late.T, sources[mine], table[:, ::-1].cumsum(axis=1)[:, ::-1])

    first = 0
    for item in inputs:
        route = program.route_of(item.name)
        arrive(route.line + first, route.core, route.axon)
        input_packets[first : first + item.size] = np.bincount(route.line, minlength=item.size)
        first += item.size
    for core in cores:
        axons, mine = core.axons, columns[core.number]
        core_of[mine] = place[core.number]
        sources = lines + mine[axons.out_compartment]
        arrive(sources, axons.out_core, axons.out_axon)
        hops = {int(to): program.chip.hops(core.slot, program.cores[to].slot) for to in np.unique(axons.out_core)}
        ways = [(1, int(hops[to] == (0, 0)), *hops[to]) for to in axons.out_core.tolist()]
        np.add.at(packets, sources, np.array(ways, dtype=np.int64).reshape(-1, len(PER_PACKET)))
    return FanOut(synapses, due_late, packets, input_packets, core_of)
