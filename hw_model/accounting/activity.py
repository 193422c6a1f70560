"""Count what a batch did in a phase, from its spikes and from the effects of one spike of each source."""

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache

import numpy as np

from hw_model.accounting.mesh_routes import PER_PACKET, Routes, routes_of
from hw_model.description.counts import BY_CORE, COUNTED
from hw_model.engine.trace import PLAYED, TOTALS, PhaseInput, PhaseTrace
from hw_model.program.chip_program import ChipProgram
from hw_model.program.pieces import Pieces, pieces_of
from hw_model.values import ByteArray, Frozen, IntArray, Shown


class StepActivity(Shown):
    """One recording in one phase, step by step; several may be stacked, with one more dimension in front.

    - ``by_piece[name]`` (steps, pieces), for each of :data:`hw_model.description.counts.BY_CORE`
    - ``packets`` (steps, ways): packets on each way of :class:`hw_model.accounting.mesh_routes.Routes`
    - ``input_packets`` (steps, cores): packets that bring input events
    - ``buffered`` (steps,): events read from the transpose buffer
    """

    pieces: Pieces
    routes: Routes
    by_piece: dict[str, IntArray]
    packets: IntArray
    input_packets: IntArray
    buffered: IntArray

    @property
    def steps(self) -> int:
        """Steps of the phase."""
        return int(self.buffered.shape[-1])

    @cached_property
    def by_core(self) -> dict[str, IntArray]:
        """The same counts by core, (steps, cores)."""
        return {name: self.pieces.of_pieces(counts) for name, counts in self.by_piece.items()}

    def count(self, name: str) -> IntArray:
        """Return a count, kept or derived, (steps, cores)."""
        if name == "packets_received":
            arrived = self.input_packets.copy()
            np.add.at(arrived.T, self.routes.target, self.packets.T)
            return arrived
        return counted(self.by_core, name)


def counted(kept: Mapping[str, IntArray], name: str) -> IntArray:
    """Return a count, either one that is kept or one derived from these."""
    if name == "neuron_updates_inactive":
        return kept["neuron_updates"] - kept["neuron_updates_active"]
    return kept["hops_x"] + kept["hops_y"] if name == "hops" else kept[name]


def stacked(items: Sequence[StepActivity]) -> StepActivity:
    """Return recordings of one phase and of equal length, stacked, (recordings, steps, ...)."""
    first = items[0]
    by_piece = {name: np.stack([item.by_piece[name] for item in items]) for name in first.by_piece}
    rest = (
        np.stack(arrays)
        for arrays in zip(*((i.packets, i.input_packets, i.buffered) for i in items), strict=True)
    )
    return StepActivity(first.pieces, first.routes, by_piece, *rest)


PER_SPIKE = ("synaptic_ops", "spikes", *PER_PACKET, "input_packets")
"""Counts that are sums over the spikes and input events of a recording."""
_ADDED_UP = np.array([COUNTED.index(name) for name in (*PER_SPIKE, *TOTALS, *PLAYED)])


def count_totals(
    program: ChipProgram, phase: str, played: PhaseInput, trace: PhaseTrace
) -> IntArray:
    """Return the counts of every recording, (batch, fields of Counts): spikes of each source times their effects."""
    table = np.zeros((len(trace.sent), len(COUNTED)), dtype=np.int64)
    # Twice as fast as a product of matrices; that of floats would wake threads, which then wait at full speed.
    of_spikes = np.einsum("bs,cs->bc", trace.sent, fan_out(program, phase))
    table[:, _ADDED_UP] = np.concatenate((of_spikes, trace.totals, played.counts.T), axis=1)
    return table


def count_steps(
    program: ChipProgram, phase: str, played: PhaseInput, trace: PhaseTrace
) -> list[StepActivity]:
    """Return the counts of every recording, step by step and core by core."""
    causes, pieces, routes = (
        _causes(program, phase),
        pieces_of(program, phase),
        routes_of(program, phase),
    )
    step, found = np.arange(played.steps), []
    runs = (step >= played.start[:, None]) & (step < played.stop[:, None])
    for i, spikes in enumerate(trace.spikes):
        counts = causes.of(np.concatenate((played.lines(i), spikes), axis=1))
        counts["neuron_updates"] = runs[i, :, None] * pieces.size
        counts["neuron_updates_active"] = trace.active[i].astype(np.int64)
        by_piece = {name: counts[name] for name in BY_CORE}
        others = counts["packets"], counts["input_packets"], counts["buffered"][:, 0]
        found.append(StepActivity(pieces, routes, by_piece, *others))
    return found


class _Causes(Frozen, eq=False):
    """The effects of a spike of each source (input lines, then columns) on the columns of a table of counts.

    Source s adds to the table's columns ``caused[k]``, ``times[k]`` times each, for the ``many[s]`` entries k from
    ``first[s]``. ``columns`` are those of each count, out of ``width`` in all.
    """

    first: IntArray
    many: IntArray
    caused: IntArray
    times: IntArray
    columns: dict[str, slice]
    width: int

    def of(self, sent: ByteArray) -> dict[str, IntArray]:
        """Follow every spike (steps, sources) to its effects; return the counts, (steps, columns) each."""
        # Bytes of 0 and 1 are also booleans, among which numpy finds the true ones fastest.
        step, source = np.divmod(np.flatnonzero(sent.view(np.bool_)), sent.shape[1])
        many = self.many[source]
        entry = np.arange(many.sum()) + np.repeat(
            self.first[source] - (np.cumsum(many) - many), many
        )
        at = np.repeat(step, many) * self.width + self.caused[entry]
        sums = np.bincount(at, self.times[entry], len(sent) * self.width).reshape(
            len(sent), self.width
        )
        table = sums.astype(np.int64)
        return {name: table[:, columns] for name, columns in self.columns.items()}


@lru_cache(maxsize=8)
def _causes(program: ChipProgram, phase: str) -> _Causes:
    """Collect the effects of the spikes of a phase, entry by entry: source, count, its column, how often."""
    cores, pieces, routes = (
        program.cores_of(phase),
        pieces_of(program, phase),
        routes_of(program, phase),
    )
    inputs = program.inputs_of(phase)
    buffered = np.flatnonzero(
        np.repeat([i.positions is not None for i in inputs], [i.size for i in inputs])
    )
    lines, own = (
        sum(item.size for item in inputs),
        np.arange(sum(core.compartments for core in cores)),
    )
    sender, way, packets = routes.sent
    entries: list[tuple[str, IntArray, IntArray, IntArray]] = [
        ("spikes", lines + own, pieces.of_column, np.ones_like(own)),
        ("packets", lines + sender, way, packets),
        *(
            (name, lines + sender, routes.piece[way], each[way] * packets)
            for name, each in routes.per_packet.items()
        ),
        ("buffered", buffered, np.zeros_like(buffered), np.ones_like(buffered)),
    ]
    for index, core in enumerate(cores):
        axons, source = core.axons, program.senders[core.number]
        shape = (axons.input_axons, len(core.slices))
        tally = np.bincount(
            axons.axon_of_synapse * shape[1] + core.slice_of_compartment[axons.target]
        )
        axon, piece = np.divmod(np.flatnonzero(tally), shape[1])
        entries.append(
            ("synaptic_ops", source[axon], pieces.of_core[index] + piece, tally[tally > 0])
        )
        fed = source[source < lines]
        entries.append(("input_packets", fed, np.full_like(fed, index), np.ones_like(fed)))
    widths = dict.fromkeys(("synaptic_ops", "spikes", *PER_PACKET), len(pieces.group))
    widths |= {"packets": len(routes.piece), "input_packets": len(cores), "buffered": 1}
    ends = dict(zip(widths, np.cumsum([*widths.values()]).tolist(), strict=True))
    begin = {name: end - widths[name] for name, end in ends.items()}
    rows = ((sender, begin[name] + at, many) for name, sender, at, many in entries)
    source, caused, times = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    order = np.argsort(source, kind="stable")
    order = order[times[order] > 0]
    many = np.bincount(source[order], minlength=lines + len(own))
    columns = {name: slice(begin[name], end) for name, end in ends.items()}
    return _Causes(
        np.cumsum(many) - many, many, caused[order], times[order], columns, sum(widths.values())
    )


@lru_cache(maxsize=8)
def fan_out(program: ChipProgram, phase: str) -> IntArray:
    """Return what one spike of each source adds to each of :data:`PER_SPIKE`, (counts, lines + columns)."""
    causes = _causes(program, phase)
    names = list(causes.columns)
    count = np.repeat(
        np.arange(len(names)), [part.stop - part.start for part in causes.columns.values()]
    )
    source = np.repeat(np.arange(len(causes.many)), causes.many)
    at = source * len(names) + count[causes.caused]
    sums = np.bincount(at, causes.times, len(causes.many) * len(names)).astype(np.int64)
    return np.ascontiguousarray(
        sums.reshape(-1, len(names)).T[[names.index(name) for name in PER_SPIKE]]
    )
