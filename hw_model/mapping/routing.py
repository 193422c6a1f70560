"""Give every spike a way: output axons, input axons and synapse lists.

Before: every compartment has a core.
After:  every source (input line or compartment) has one input axon on each core that it reaches, whose list holds each
        of its synapses there exactly once; every compartment has one output axon for each core that it reaches.
"""

from dataclasses import replace

import numpy as np

from hw_model.arithmetic.arrays import IntArray
from hw_model.description.chip import Chip
from hw_model.mapping.fan_in import FanIn, SynapseFormat, fan_in, first_source
from hw_model.mapping.graph import held
from hw_model.mapping.placement import PlacedGraph, Slice
from hw_model.mapping.synapse_lists import synapse_lists
from hw_model.values import Frozen


class AxonTables(Frozen, eq=False):
    """Axons and synapse lists of one core; compartments are numbered as on the core.

    Input axon j's list is rows ``list_start[j]..list_start[j + 1]`` of the synapse arrays, which may have 32 bits a
    number (:func:`hw_model.mapping.graph.held`). Output axon k carries the spikes of ``out_compartment[k]`` to input
    axon ``out_axon[k]`` of core ``out_core[k]``.
    """

    formats: tuple[SynapseFormat, ...]
    list_start: IntArray
    target: IntArray
    mantissa: IntArray
    delay: IntArray
    format_index: IntArray
    synapse_words: int
    out_compartment: IntArray
    out_core: IntArray
    out_axon: IntArray

    @property
    def input_axons(self) -> int:
        """Input axons of the core."""
        return len(self.list_start) - 1

    @property
    def axon_of_synapse(self) -> IntArray:
        """Input axon of every synapse."""
        return np.repeat(np.arange(self.input_axons), np.diff(self.list_start))

    @property
    def output_axons(self) -> int:
        """Output axons of the core."""
        return len(self.out_axon)


class RoutedCore(Frozen, eq=False):
    """One core: its slot on the board, the slices that live on it, and their axons."""

    number: int
    slot: int
    phase: str
    slices: tuple[Slice, ...]
    axons: AxonTables


class InputRoute(Frozen, eq=False):
    """Where the spikes of an input's lines go: row by row a line, a core and an input axon there."""

    input: str
    line: IntArray
    core: IntArray
    axon: IntArray


class RoutedGraph(Frozen, eq=False):
    """A placed graph with every axon and synapse list."""

    placed: PlacedGraph
    cores: tuple[RoutedCore, ...]
    input_routes: tuple[InputRoute, ...]


def route_axons(placed: PlacedGraph) -> RoutedGraph:
    """Number axons by source in network order, and list synapses by projection, then target."""
    graph, chip = placed.graph, placed.chip
    projections = fan_in(graph, chip)
    slices: list[list[Slice]] = [[] for _ in range(placed.cores)]
    for piece in placed.slices:
        slices[piece.core].append(piece)
    lists = [_lists(pieces, projections, chip) for pieces in slices]
    arrivals = _Arrivals(placed, [sources for sources, _ in lists])

    cores = []
    for number, (pieces, (_, tables)) in enumerate(zip(slices, lists, strict=True)):
        sender, out_core, out_axon = arrivals.sent_by_core(number)
        axons = replace(tables, out_compartment=sender, out_core=out_core, out_axon=out_axon)
        cores.append(RoutedCore(number, placed.slots[number], graph.phase_of(pieces[0].group), tuple(pieces), axons))
    routes = [InputRoute(item.name, *arrivals.sent_by_input(item.name)) for item in graph.inputs]
    routed = RoutedGraph(placed, tuple(cores), tuple(routes))
    check_routed(routed)
    return routed


def check_routed(routed: RoutedGraph) -> None:
    """Every synapse is in exactly one list; what cores hold is checked with the program that they become."""
    stored = sum(len(core.axons.target) for core in routed.cores)
    assert stored == sum(len(s.mantissa) for s in routed.placed.graph.synapses), "routing lost or doubled synapses"
    for core in routed.cores:
        words = routed.placed.words[core.number]
        assert core.axons.synapse_words == words, "placement counted other memory words"


class _Arrivals:
    """All input axons of all cores, ordered by their senders: input lines first, then compartments core by core."""

    def __init__(self, placed: PlacedGraph, sources: list[IntArray]) -> None:
        self._first = first_source(placed.graph)
        self._size = {node.name: node.size for node in placed.graph.nodes}
        self._lines = sum(item.size for item in placed.graph.inputs)
        self._per_core = placed.chip.limits.compartments_per_core
        sender = np.arange(sum(self._size.values()))
        for piece in placed.slices:
            sender[placed.sources_of(piece)] = (
                self._lines + piece.core * self._per_core + piece.offset + np.arange(piece.size)
            )
        unordered = sender[np.concatenate(sources)]
        order = np.argsort(unordered, kind="stable")
        self._sender = unordered[order]
        self._core = np.repeat(np.arange(len(sources)), [len(found) for found in sources])[order]
        self._axon = np.concatenate([np.arange(len(found)) for found in sources])[order]

    def sent_by_core(self, core: int) -> tuple[IntArray, IntArray, IntArray]:
        """Return (compartment, destination core, axon there) of the output axons of a core."""
        start = self._lines + core * self._per_core
        return self._between(start, start + self._per_core)

    def sent_by_input(self, name: str) -> tuple[IntArray, IntArray, IntArray]:
        """Return (line, destination core, axon there) of an input."""
        return self._between(self._first[name], self._first[name] + self._size[name])

    def _between(self, start: int, stop: int) -> tuple[IntArray, IntArray, IntArray]:
        low, high = np.searchsorted(self._sender, (start, stop))
        return self._sender[low:high] - start, self._core[low:high], self._axon[low:high]


def _lists(slices: list[Slice], projections: tuple[FanIn, ...], chip: Chip) -> tuple[IntArray, AxonTables]:
    """Return the source of each input axon of a core, and the core's tables, as yet without output axons."""
    here = [(p, piece) for p in projections for piece in slices if piece.group == p.target_group]
    formats = sorted({projection.format for projection, _ in here})
    empty = np.empty(0, dtype=np.int64)
    columns: list[tuple[IntArray, ...]] = [(empty,) * 6]
    for rank, (projection, piece) in enumerate(here):
        rows = projection.rows(piece.start, piece.stop)
        target = projection.targets(piece.start, piece.stop) - piece.start + piece.offset
        form = np.full(len(target), formats.index(projection.format))
        source, mantissa, delay = projection.source[rows], projection.mantissa[rows], projection.delay[rows]
        columns.append((source, np.full(len(target), rank), target, mantissa, delay, form))
    source, ranks, target, mantissa, delay, form = (np.concatenate(column) for column in zip(*columns, strict=True))
    order = np.lexsort((target, ranks, source))
    sources, starts = np.unique(source[order], return_index=True)
    list_start = np.append(starts, len(source))
    target, form = target[order], form[order]
    ends = np.array([piece.offset + piece.size for piece in slices])
    lists = synapse_lists(list_start, target, form, formats, ends, chip.synapse_memory)
    tables = AxonTables(
        formats=tuple(formats),
        list_start=list_start,
        target=held(target),
        mantissa=held(mantissa[order]),
        delay=held(delay[order]),
        format_index=held(form),
        synapse_words=int(lists.words.sum()),
        out_compartment=empty,
        out_core=empty,
        out_axon=empty,
    )
    return sources, tables
