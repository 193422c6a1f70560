"""Count what a batch did in a phase: synaptic operations, packets, hops, updates.

A spike of a source (an input line or a compartment) always has the same effects: it reaches the
same synapses and sends the same packets. So these effects are collected once per phase, and counts
are spikes times effects, either over whole recordings (:func:`count_totals`) or step by step and
core by core, as latency needs them (:func:`count_steps`).

A *piece* is the share of a group of compartments that lies on one core. A *way* is the path that
packets take from a piece to another core (:mod:`hw_model.accounting.mesh_routes`).
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, lru_cache

import numpy as np

from hw_model.accounting.mesh_routes import PER_PACKET, Routes, routes_of
from hw_model.description.counts import BY_CORE, COUNTED
from hw_model.engine.trace import PLAYED, TOTALS, PhaseInput, PhaseTrace
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.program.pieces import Pieces, pieces_of
from hw_model.values import ByteArray, Frozen, IntArray, Shown, ranges


class StepActivity(Shown):
    """The counts of one recording in one phase, step by step; :func:`stacked` ones have an axis of recordings in front.

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
        """Return a count, stored or derived, (steps, cores)."""
        if name == "packets_received":
            received = self.input_packets.copy()
            # Several ways end at the same core, and `+=` would add only one of them.
            np.add.at(received.T, self.routes.target, self.packets.T)
            return received
        return counted(self.by_core, name)


def counted(counts: Mapping[str, IntArray], name: str) -> IntArray:
    """Return one of the counts, or one that is derived from them."""
    if name == "neuron_updates_inactive":
        return counts["neuron_updates"] - counts["neuron_updates_active"]
    if name == "hops":
        return counts["hops_x"] + counts["hops_y"]
    return counts[name]


def stacked(items: Sequence[StepActivity]) -> StepActivity:
    """Return recordings of one phase and of equal length, stacked, (recordings, steps, ...)."""
    first = items[0]
    return StepActivity(
        pieces=first.pieces,
        routes=first.routes,
        by_piece={
            name: np.stack([item.by_piece[name] for item in items]) for name in first.by_piece
        },
        packets=np.stack([item.packets for item in items]),
        input_packets=np.stack([item.input_packets for item in items]),
        buffered=np.stack([item.buffered for item in items]),
    )


PER_SPIKE = ("synaptic_ops", "spikes", *PER_PACKET, "input_packets")
"""Counts that are sums over the spikes and input events of a recording."""
_COLUMNS_OF_TOTALS = np.array([COUNTED.index(name) for name in (*PER_SPIKE, *TOTALS, *PLAYED)])
"""Columns of a table of counts, in the order in which :func:`count_totals` has them."""


def count_totals(
    program: ChipProgram, phase: str, played: PhaseInput, trace: PhaseTrace
) -> IntArray:
    """Return the counts of every recording, (batch, fields of Counts): spikes of each source times their effects."""
    table = np.zeros((len(trace.sent), len(COUNTED)), dtype=np.int64)
    # b: recording, s: source, c: count. Twice as fast as numpy's `@`, which has no fast product of integers; that of
    # floats would wake the threads of BLAS, which then spin while they wait.
    of_spikes = np.einsum("bs,cs->bc", trace.sent, fan_out(program, phase))
    table[:, _COLUMNS_OF_TOTALS] = np.concatenate(
        (of_spikes, trace.totals, played.counts.T), axis=1
    )
    return table


def count_steps(
    program: ChipProgram, phase: str, played: PhaseInput, trace: PhaseTrace
) -> list[StepActivity]:
    """Return the counts of every recording, step by step and core by core."""
    effects = _effects_of_spikes(program, phase)
    pieces = pieces_of(program, phase)
    routes = routes_of(program, phase)
    step = np.arange(played.steps)
    is_run = (step >= played.start[:, None]) & (step < played.stop[:, None])
    activity = []
    for recording, spikes in enumerate(trace.spikes):
        counts = effects.of(np.concatenate((played.lines(recording), spikes), axis=1))
        counts["neuron_updates"] = is_run[recording, :, None] * pieces.size
        counts["neuron_updates_active"] = trace.active[recording].astype(np.int64)
        activity.append(_step_activity(pieces, routes, counts))
    return activity


def busiest_activity(program: ChipProgram, phase: str, sent: ByteArray) -> StepActivity:
    """Count what spikes, (steps, lines + columns), do in steps in which every compartment is active.

    Worst cases are computed from it: the spikes need not be possible in any recording.
    """
    pieces = pieces_of(program, phase)
    counts = _effects_of_spikes(program, phase).of(sent)
    every_compartment = np.tile(pieces.size, (len(sent), 1))
    counts["neuron_updates"] = every_compartment
    counts["neuron_updates_active"] = every_compartment
    return _step_activity(pieces, routes_of(program, phase), counts)


def _step_activity(pieces: Pieces, routes: Routes, counts: Mapping[str, IntArray]) -> StepActivity:
    """Return an activity with the counts of a table of :class:`_Effects`, and those of updates."""
    return StepActivity(
        pieces=pieces,
        routes=routes,
        by_piece={name: counts[name] for name in BY_CORE},
        packets=counts["packets"],
        input_packets=counts["input_packets"],
        buffered=counts["buffered"][:, 0],
    )


class _Effects(Frozen, eq=False):
    """What a spike of each source (input lines, then columns) adds to a table of counts with a row per step.

    The entries of a source follow each other: those of source s are ``entries[s]`` many, from
    ``first_entry[s]`` on. Entry k adds ``amount[k]`` to column ``table_column[k]`` of the table.
    Each count has the columns ``columns[name]`` of the table, which has ``width`` in all.
    """

    first_entry: IntArray
    entries: IntArray
    table_column: IntArray
    amount: IntArray
    columns: dict[str, slice]
    width: int

    def of(self, sent: ByteArray) -> dict[str, IntArray]:
        """Follow every spike (steps, sources) to its effects; return the counts, (steps, columns) each."""
        steps, sources = sent.shape
        # Bytes of 0 and 1 are also booleans, among which numpy finds the true ones fastest.
        step, source = np.divmod(np.flatnonzero(sent.view(np.bool_)), sources)
        entries = self.entries[source]
        entry = ranges(self.first_entry[source], entries)
        cell = np.repeat(step, entries) * self.width + self.table_column[entry]
        # `bincount` with weights adds in float64, which is exact: sums of small integers stay below 2^53.
        sums = np.bincount(cell, self.amount[entry], steps * self.width)
        table = sums.reshape(steps, self.width).astype(np.int64)
        return {name: table[:, columns] for name, columns in self.columns.items()}


class _Entries(Frozen, eq=False):
    """Effects on one count: a spike of ``source[k]`` adds ``amount[k]`` to its column ``column[k]``."""

    count: str
    source: IntArray
    column: IntArray
    amount: IntArray


@lru_cache(maxsize=8)
def _effects_of_spikes(program: ChipProgram, phase: str) -> _Effects:
    """Collect the effects of the spikes of a phase, sorted by source.

    The cache is keyed by the identity of the program.
    """
    pieces = pieces_of(program, phase)
    routes = routes_of(program, phase)
    cores = program.cores_of(phase)
    lines = sum(item.size for item in program.inputs_of(phase))
    compartments = sum(core.compartments for core in cores)
    width_of = dict.fromkeys(("synaptic_ops", "spikes", *PER_PACKET), len(pieces.group))
    width_of |= {"packets": len(routes.piece), "input_packets": len(cores), "buffered": 1}
    columns = _side_by_side(width_of)

    parts = [
        *_effects_of_sending(pieces, routes, lines, compartments),
        _effects_on_buffer(program, phase),
    ]
    for index, core in enumerate(cores):
        sources = program.senders[core.number]
        parts.append(_effects_on_synapses(core, sources, int(pieces.of_core[index])))
        parts.append(_effects_of_arriving(index, sources[sources < lines]))

    source = np.concatenate([part.source for part in parts])
    table_column = np.concatenate([columns[part.count].start + part.column for part in parts])
    amount = np.concatenate([part.amount for part in parts])
    by_source = np.argsort(source, kind="stable")
    # Most packets add nothing to some counts, such as hops within a tile: entries of 0 only take time.
    by_source = by_source[amount[by_source] > 0]
    entries = np.bincount(source[by_source], minlength=lines + compartments)
    return _Effects(
        first_entry=np.cumsum(entries) - entries,
        entries=entries,
        table_column=table_column[by_source],
        amount=amount[by_source],
        columns=columns,
        width=sum(width_of.values()),
    )


def _side_by_side(width_of: Mapping[str, int]) -> dict[str, slice]:
    """Return the columns of each count in a table that holds all of them side by side."""
    columns = {}
    begin = 0
    for name, width in width_of.items():
        columns[name] = slice(begin, begin + width)
        begin += width
    return columns


def _effects_of_sending(
    pieces: Pieces, routes: Routes, lines: int, compartments: int
) -> Iterator[_Entries]:
    """Yield the effects of a spike of a compartment up to the arrival of its packets.

    The compartment of column c is source ``lines + c``.
    """
    compartment = np.arange(compartments)
    yield _Entries("spikes", lines + compartment, pieces.of_column, np.ones_like(compartment))
    column, way, packets = routes.sent
    yield _Entries("packets", lines + column, way, packets)
    for name, per_packet in routes.per_packet.items():
        yield _Entries(name, lines + column, routes.piece[way], per_packet[way] * packets)


def _effects_on_buffer(program: ChipProgram, phase: str) -> _Entries:
    """Return the effect of input events that come out of the transpose buffer: one read each."""
    inputs = program.inputs_of(phase)
    is_transposed = np.repeat(
        [item.positions is not None for item in inputs], [item.size for item in inputs]
    )
    line = np.flatnonzero(is_transposed)
    return _Entries("buffered", line, np.zeros_like(line), np.ones_like(line))


def _effects_on_synapses(core: Core, sources: IntArray, first_piece: int) -> _Entries:
    """Return how many synapses a spike reaches in each piece of a core.

    Axon a of the core is driven by ``sources[a]``. ``first_piece`` is the number, in the phase, of the core's first.
    """
    axons = core.axons
    pieces = len(core.slices)
    piece_of_synapse = core.slice_of_compartment[axons.target]
    synapses = np.bincount(axons.axon_of_synapse * pieces + piece_of_synapse)
    reached = np.flatnonzero(synapses)
    axon, piece = np.divmod(reached, pieces)
    return _Entries("synaptic_ops", sources[axon], first_piece + piece, synapses[reached])


def _effects_of_arriving(core_index: int, input_lines: IntArray) -> _Entries:
    """Return the packets of input events to a core: one per event of a line that reaches it."""
    core = np.full_like(input_lines, core_index)
    return _Entries("input_packets", input_lines, core, np.ones_like(input_lines))


@lru_cache(maxsize=8)
def fan_out(program: ChipProgram, phase: str) -> IntArray:
    """Return what one spike of each source adds to each of :data:`PER_SPIKE`, (counts, lines + columns)."""
    effects = _effects_of_spikes(program, phase)
    names = list(effects.columns)
    widths = [columns.stop - columns.start for columns in effects.columns.values()]
    count_of_column = np.repeat(np.arange(len(names)), widths)
    sources = len(effects.entries)
    source = np.repeat(np.arange(sources), effects.entries)
    cell = source * len(names) + count_of_column[effects.table_column]
    sums = np.bincount(cell, effects.amount, sources * len(names)).astype(np.int64)
    by_count = sums.reshape(sources, len(names)).T
    return np.ascontiguousarray(by_count[[names.index(name) for name in PER_SPIKE]])
