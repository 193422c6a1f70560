"""Count what a batch did in a phase, from its spikes and from what one spike of each source causes."""

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache

import numpy as np

from hw_model.accounting.mesh_routes import PER_PACKET, Routes, routes_of
from hw_model.description.counts import BY_CORE, COUNTED
from hw_model.engine.trace import TOTALS, PhaseInput, PhaseTrace
from hw_model.program.chip_program import ChipProgram
from hw_model.program.pieces import Pieces, pieces_of
from hw_model.values import BoolArray, FloatArray, Int32Array, IntArray, Shown


class StepActivity(Shown):
    """One recording in one phase, step by step; several may be stacked, with a dimension in front.

    ``by_piece[name]`` (steps, pieces) for each of :data:`hw_model.description.counts.BY_CORE`; ``packets`` (steps,
    ways): packets on each way of :class:`hw_model.accounting.mesh_routes.Routes`; ``input_packets`` (steps, cores):
    those that bring input events; ``buffered`` (steps,): events that the transpose buffer gives out.
    """

    pieces: Pieces
    routes: Routes
    by_piece: dict[str, IntArray]
    packets: IntArray
    input_packets: IntArray
    buffered: IntArray

    @cached_property
    def by_core(self) -> dict[str, IntArray]:
        """The same counts by core, (steps, cores)."""
        return {name: self.pieces.of_pieces(counts) for name, counts in self.by_piece.items()}

    def count(self, name: str) -> IntArray:
        """Return a count, or one derived from them, (steps, cores)."""
        if name == "packets_received":
            arrived = self.input_packets.copy()
            np.add.at(arrived.T, self.routes.target, self.packets.T)
            return arrived
        return counted(self.by_core, name)


def counted(kept: Mapping[str, IntArray], name: str) -> IntArray:
    """Return one of the counts that are kept, or one derived from them."""
    if name == "neuron_updates_inactive":
        return kept["neuron_updates"] - kept["neuron_updates_active"]
    return kept["hops_x"] + kept["hops_y"] if name == "hops" else kept[name]


def stacked(items: Sequence[StepActivity]) -> StepActivity:
    """Return recordings of one phase and of equal length as one, (recordings, steps, ...)."""
    first = items[0]
    return StepActivity(
        first.pieces,
        first.routes,
        {name: np.stack([item.by_piece[name] for item in items]) for name in first.by_piece},
        np.stack([item.packets for item in items]),
        np.stack([item.input_packets for item in items]),
        np.stack([item.buffered for item in items]),
    )


PER_SPIKE = ("synaptic_ops", "spikes", *PER_PACKET, "input_packets")
"""Counts of a recording that are a sum over its spikes and input events."""
_COLUMN = {name: k for k, name in enumerate(COUNTED)}
_OF_SPIKES, _OF_TOTALS = [_COLUMN[name] for name in PER_SPIKE], [_COLUMN[name] for name in TOTALS]


def count_totals(program: ChipProgram, phase: str, played: PhaseInput, trace: PhaseTrace) -> IntArray:
    """Return the counts of every recording, (batch, fields of Counts): spikes of each source times what one causes."""
    table = np.zeros((len(trace.sent), len(COUNTED)), dtype=np.int64)
    table[:, _OF_SPIKES] = trace.sent @ fan_out(program, phase)
    table[:, _OF_TOTALS] = trace.totals
    table[:, _COLUMN["input_events"]] = played.input_events
    table[:, _COLUMN["transpose_events"]] = played.transpose_events
    table[:, _COLUMN["events_dropped"]] = played.events_dropped
    table[:, _COLUMN["neuron_updates"]] = (played.stop - played.start) * trace.spikes.shape[2]
    table[:, _COLUMN["aligned_steps"]] = played.aligned_steps
    return table


def count_steps(program: ChipProgram, phase: str, played: PhaseInput, trace: PhaseTrace) -> list[StepActivity]:
    """Return the counts of every recording step by step and core by core."""
    synapses, input_packets = _by_place(program, phase)
    pieces, routes = pieces_of(program, phase), routes_of(program, phase)
    lines = len(input_packets)
    from_buffer = _through_buffer(program, phase)
    step, found = np.arange(played.steps), []
    runs = (step >= played.start[:, None]) & (step < played.stop[:, None])
    for i in range(len(trace.spikes)):
        sent, played_lines = trace.spikes[i], played.lines(i)
        events = played_lines.astype(np.float64)
        by_piece = {
            "synaptic_ops": _whole(events @ synapses[:lines] + sent.astype(np.float64) @ synapses[lines:]),
            "neuron_updates": runs[i, :, None] * pieces.size,
            "neuron_updates_active": trace.active[i].astype(np.int64),
            "spikes": pieces.of_spikes(sent),
        }
        packets = routes.packets(sent)
        by_piece |= routes.by_piece(packets, len(pieces.group))
        assert set(by_piece) == set(BY_CORE)
        found.append(
            StepActivity(
                pieces,
                routes,
                by_piece,
                packets=packets,
                input_packets=_whole(events @ input_packets),
                buffered=played_lines[:, from_buffer].sum(axis=1, dtype=np.int64),
            )
        )
    return found


def _through_buffer(program: ChipProgram, phase: str) -> BoolArray:
    """Tell which lines of a phase the transpose buffer plays, (lines,)."""
    inputs = program.inputs_of(phase)
    return np.repeat([item.positions is not None for item in inputs], [item.size for item in inputs])


def _whole(sums: FloatArray) -> IntArray:
    """Sums of integers below 2^53 are exact in float64, and its matrix product is the fast one."""
    return sums.astype(np.int64)


@lru_cache(maxsize=8)
def fan_out(program: ChipProgram, phase: str) -> IntArray:
    """Return what one spike of each source, input lines and then columns, adds to each of :data:`PER_SPIKE`."""
    cores = program.cores_of(phase)
    lines = sum(item.size for item in program.inputs_of(phase))
    count = lines + sum(core.compartments for core in cores)
    synapses = np.zeros(count, dtype=np.int64)
    packets = np.zeros((count, len(PER_PACKET)), dtype=np.int64)
    input_packets = np.zeros(lines, dtype=np.int64)
    for core in cores:
        # What arrives: each input axon of a core has a sender of its own.
        axons, source = core.axons, program.senders[core.number]
        synapses[source] += np.diff(axons.list_start)
        input_packets[source[source < lines]] += 1
        # What is sent.
        hops = {int(to): program.chip.hops(core.slot, program.cores[to].slot) for to in np.unique(axons.out_core)}
        ways = [(1, int(hops[to] == (0, 0)), *hops[to]) for to in axons.out_core.tolist()]
        sender = lines + program.columns_of_core(core)[axons.out_compartment]
        np.add.at(packets, sender, np.array(ways, dtype=np.int64).reshape(-1, len(PER_PACKET)))
    to_inputs = np.pad(input_packets, (0, count - lines))
    return np.column_stack((synapses, np.arange(count) >= lines, packets, to_inputs)).astype(np.int64)


@lru_cache(maxsize=8)
def _by_place(program: ChipProgram, phase: str) -> tuple[Int32Array, IntArray]:
    """Return the synapses of each source at each piece, and the packets of each line to each core.

    They grow with the square of a program's size; only counts of every step and core need them.
    """
    cores, pieces = program.cores_of(phase), pieces_of(program, phase)
    lines = sum(item.size for item in program.inputs_of(phase))
    synapses = np.zeros((lines + sum(core.compartments for core in cores), len(pieces.group)), dtype=np.int32)
    input_packets = np.zeros((lines, len(cores)), dtype=np.int64)
    for index, core in enumerate(cores):
        axons, source = core.axons, program.senders[core.number]
        piece = core.slice_of_compartment[axons.target]
        here = slice(pieces.of_core[index], pieces.of_core[index + 1])
        synapses[source, here] = _tally(axons.axon_of_synapse, piece, (axons.input_axons, len(core.slices)))
        input_packets[source[source < lines], index] = 1
    return synapses, input_packets


def _tally(row: IntArray, column: IntArray, shape: tuple[int, int]) -> IntArray:
    """Count how often each row meets each column."""
    found: IntArray = np.bincount(row * shape[1] + column, minlength=shape[0] * shape[1])
    return found.reshape(shape)
