"""Count what a batch did in a phase, from its spikes and from what one spike of each source causes.

Packets take ways between the cores of a phase: X first, then Y, link by link.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np

from hw_model.description.counts import BY_CORE, COUNTED
from hw_model.engine.trace import TOTALS, PhaseInput, PhaseTrace
from hw_model.program.chip_program import ChipProgram, Core, Pieces, pieces_of
from hw_model.values import BoolArray, ByteArray, FloatArray, Frozen, Int32Array, IntArray, Shown

Tile = tuple[int, int]
PER_PACKET = ("axon_packets", "packets_within_tile", "hops_x", "hops_y")
"""Counts of a packet, which its way decides."""


class Routes(Frozen, eq=False):
    """The ways that packets of a phase can take, sorted by the piece that sends them.

    Way r goes from ``piece[r]`` of the phase (:mod:`hw_model.program.chip_program`), on core ``source[r]``, to core
    ``target[r]`` (indices of the phase's cores), ``hops[r]`` (east-west, north-south) far, over the links ``over[r]``
    (longest way,),
    -1 behind the last. ``links[l]``: (column, row) of the tile that a link leaves and of the one that it enters;
    ``along_y[l]``: it goes north or south. ``sent_from``: for every core, its columns and, for each of them, how many
    packets of a spike take each of its ways.
    """

    piece: IntArray
    source: IntArray
    target: IntArray
    hops: IntArray
    over: IntArray
    links: tuple[tuple[Tile, Tile], ...]
    along_y: IntArray
    sent_from: tuple[tuple[IntArray, FloatArray], ...]

    def packets(self, spikes: ByteArray) -> IntArray:
        """Count the packets of each step on each way, (steps, ways), from spikes (steps, columns)."""
        found = [spikes[:, columns].astype(np.float64) @ per_spike for columns, per_spike in self.sent_from]
        # Sums of integers below 2^53 are exact in float64, and its matrix product is the fast one.
        return np.concatenate(found, axis=1).astype(np.int64)

    def by_piece(self, packets: IntArray, pieces: int) -> dict[str, IntArray]:
        """Return the counts of :data:`PER_PACKET`, (..., pieces), from packets on each way, (..., ways)."""
        sending, first = self._senders
        found = {}
        for name, each in self._per_packet.items():
            found[name] = np.zeros((*packets.shape[:-1], pieces), dtype=np.int64)
            if each.any():
                found[name][..., sending] = np.add.reduceat(packets * each, first, axis=-1)
        return found

    @cached_property
    def _senders(self) -> tuple[IntArray, IntArray]:
        """The pieces that send, and the first way of each."""
        sending, first = np.unique(self.piece, return_index=True)
        return sending, first

    @cached_property
    def _per_packet(self) -> dict[str, IntArray]:
        """What a packet on each way adds to the counts of :data:`PER_PACKET`, (ways,)."""
        x, y = self.hops.T
        return dict(zip(PER_PACKET, (np.ones_like(x), (x + y == 0).astype(np.int64), x, y), strict=True))

    def loads(self, packets: IntArray) -> IntArray:
        """Count the packets on each link, (..., links), from those on each way, (..., ways)."""
        loads = np.zeros((*packets.shape[:-1], len(self.links)), dtype=np.int64)
        for k in range(self.over.shape[1]):
            way = np.flatnonzero(self.over[:, k] >= 0)
            np.add.at(loads.T, self.over[way, k], packets[..., way].T)
        return loads


@lru_cache(maxsize=8)
def routes_of(program: ChipProgram, phase: str) -> Routes:
    """Return the ways of a phase. Programs are hashed by identity."""
    cores = program.cores_of(phase)
    place = {core.number: i for i, core in enumerate(cores)}
    number_of: dict[tuple[Tile, Tile], int] = {}
    pieces = pieces_of(program, phase)
    piece, target, hops, over, sent_from = [], [], [], [], []
    for index, core in enumerate(cores):
        local = core.slice_of_compartment[core.axons.out_compartment]
        ways = np.stack((local, core.axons.out_core))
        reached, way = np.unique(ways, axis=1, return_inverse=True)
        per_spike = np.zeros((core.compartments, reached.shape[1]), dtype=np.float64)
        np.add.at(per_spike, (core.axons.out_compartment, way.reshape(-1)), 1)
        sent_from.append((program.columns_of_core(core), per_spike))
        for own, to in reached.T.tolist():
            piece.append(int(pieces.of_core[index]) + own)
            target.append(place[to])
            hops.append(program.chip.hops(core.slot, program.cores[to].slot))
            over.append(
                [number_of.setdefault(link, len(number_of)) for link in _links(program, core, cores[place[to]])]
            )
    longest = max(map(len, over), default=0)
    return Routes(
        piece=np.array(piece, dtype=np.int64),
        source=pieces.core[np.array(piece, dtype=np.int64)],
        target=np.array(target, dtype=np.int64),
        hops=np.array(hops, dtype=np.int64).reshape(-1, 2),
        over=np.array([row + [-1] * (longest - len(row)) for row in over], dtype=np.int64).reshape(len(over), longest),
        links=tuple(number_of),
        along_y=np.array([a[0] == b[0] for a, b in number_of], dtype=np.int64),
        sent_from=tuple(sent_from),
    )


def _links(program: ChipProgram, source: Core, target: Core) -> Iterator[tuple[Tile, Tile]]:
    """Yield the links from core to core, X first, then Y."""
    (x, y), (to_x, to_y) = program.chip.tile_of(source.slot), program.chip.tile_of(target.slot)
    along_x = [(at, y) for at in range(x, to_x, 1 if to_x > x else -1)]
    along_y = [(to_x, at) for at in range(y, to_y, 1 if to_y > y else -1)]
    yield from pairwise([*along_x, *along_y, (to_x, to_y)])


class StepActivity(Shown):
    """One recording in one phase, step by step; several may be stacked, with a dimension in front.

    ``by_piece[name]`` (steps, pieces) for each of :data:`hw_model.description.counts.BY_CORE`; ``packets`` (steps,
    ways): packets on each way of :class:`hw_model.accounting.activity.Routes`; ``input_packets`` (steps, cores):
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
