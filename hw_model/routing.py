"""Give every spike a way: output axons, input axons and synapse lists.

Before: every compartment has a core.
After:  every source (input line or compartment) has one input axon on each core that it reaches, whose list holds each
        of its synapses there exactly once; every compartment has one output axon for each core that it reaches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw_model.chip_description import Chip
from hw_model.errors import TargetError
from hw_model.fan_in import FanIn, SynapseFormat, fan_in, first_source
from hw_model.fixed_point import IntArray
from hw_model.placement import PlacedGraph, Slice


@dataclass(frozen=True, eq=False)
class AxonTables:
    """Axons and synapse lists of one core; compartments are numbered as on the core.

    Input axon j's list is rows ``list_start[j]..list_start[j + 1]`` of the synapse arrays. Output axon k carries the
    spikes of ``out_compartment[k]`` to input axon ``out_axon[k]`` of core ``out_core[k]``.
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
    def output_axons(self) -> int:
        """Output axons of the core."""
        return len(self.out_axon)


@dataclass(frozen=True, eq=False)
class RoutedCore:
    """One core: the slices that live on it, and their axons."""

    number: int
    phase: str
    slices: tuple[Slice, ...]
    axons: AxonTables


@dataclass(frozen=True, eq=False)
class InputRoute:
    """Where the spikes of an input's lines go: row by row a line, a core and an input axon there."""

    input: str
    line: IntArray
    core: IntArray
    axon: IntArray


@dataclass(frozen=True, eq=False)
class RoutedGraph:
    """A placed graph with every axon and synapse list."""

    placed: PlacedGraph
    cores: tuple[RoutedCore, ...]
    input_routes: tuple[InputRoute, ...]


def route_axons(placed: PlacedGraph) -> RoutedGraph:
    """Number axons by source in network order, and list synapses by projection, then target."""
    graph, chip = placed.graph, placed.chip
    projections = fan_in(graph, chip)
    slices = [tuple(piece for piece in placed.slices if piece.core == core) for core in range(placed.cores)]
    lists = [_lists(pieces, projections, chip) for pieces in slices]
    source = np.concatenate([found.sources for found in lists])
    to_core = np.repeat(np.arange(placed.cores), [len(found.sources) for found in lists])
    to_axon = np.concatenate([np.arange(len(found.sources)) for found in lists])

    at = _Whereabouts(placed)
    cores = []
    for number, (pieces, found) in enumerate(zip(slices, lists, strict=True)):
        mine = np.flatnonzero(at.core[source] == number)
        sender = at.compartment[source[mine]]
        mine = mine[np.lexsort((to_core[mine], sender))]
        cores.append(
            RoutedCore(
                number=number,
                phase=graph.phase_of(pieces[0].group),
                slices=pieces,
                axons=AxonTables(
                    formats=found.formats,
                    list_start=found.list_start,
                    target=found.target,
                    mantissa=found.mantissa,
                    delay=found.delay,
                    format_index=found.format_index,
                    synapse_words=found.words,
                    out_compartment=at.compartment[source[mine]],
                    out_core=to_core[mine],
                    out_axon=to_axon[mine],
                ),
            )
        )
    first = first_source(graph)
    routes = []
    for item in graph.inputs:
        line = source - first[item.name]
        mine = np.flatnonzero((line >= 0) & (line < item.size))
        mine = mine[np.lexsort((to_core[mine], line[mine]))]
        routes.append(InputRoute(item.name, line[mine], to_core[mine], to_axon[mine]))
    routed = RoutedGraph(placed, tuple(cores), tuple(routes))
    check_routed(routed)
    return routed


def check_routed(routed: RoutedGraph) -> None:
    """Every synapse is in exactly one list, and no core has more axons or memory than the chip allows."""
    graph, chip = routed.placed.graph, routed.placed.chip
    stored = sum(len(core.axons.target) for core in routed.cores)
    assert stored == sum(len(s.mantissa) for s in graph.synapses), "routing lost or doubled synapses"
    limits = chip.limits
    for core in routed.cores:
        axons = core.axons
        rows = (
            (
                "output axons",
                axons.output_axons,
                limits.output_axons_per_core,
                "Reach fewer cores: use fewer weight bits.",
            ),
            ("input axons", axons.input_axons, limits.input_axons_per_core, "Lower the fan-in."),
            ("synapse memory words", axons.synapse_words, limits.synapse_words_per_core, "Use fewer weight bits."),
            ("synapse formats", len(axons.formats), limits.synapse_formats_per_core, "Use fewer weight exponents."),
        )
        for what, measured, limit, fix in rows:
            if measured > limit:
                names = ", ".join(sorted({piece.group for piece in core.slices}))
                raise TargetError(
                    f"core {core.number} with {names}",
                    f"{measured} {what} do not fit",
                    measured=f"{chip.name} holds {limit} a core",
                    fix=fix,
                )


class _Whereabouts:
    """Core and number there of every source; input lines have core -1."""

    def __init__(self, placed: PlacedGraph) -> None:
        first = first_source(placed.graph)
        count = sum(node.size for node in placed.graph.nodes)
        self.core = np.full(count, -1, dtype=np.int64)
        self.compartment = np.full(count, -1, dtype=np.int64)
        for piece in placed.slices:
            sources = slice(first[piece.group] + piece.start, first[piece.group] + piece.stop)
            self.core[sources] = piece.core
            self.compartment[sources] = piece.offset + np.arange(piece.size)


@dataclass(frozen=True, eq=False)
class _Lists:
    """Synapse lists of one core; ``sources[j]`` is the source of input axon j."""

    sources: IntArray
    list_start: IntArray
    target: IntArray
    mantissa: IntArray
    delay: IntArray
    format_index: IntArray
    formats: tuple[SynapseFormat, ...]
    words: int


def _lists(slices: tuple[Slice, ...], projections: tuple[FanIn, ...], chip: Chip) -> _Lists:
    here = [(p, piece) for p in projections for piece in slices if piece.group == p.target_group]
    formats = sorted({projection.format for projection, _ in here})
    empty = np.empty(0, dtype=np.int64)
    columns: list[tuple[IntArray, ...]] = [(empty,) * 6]
    words = 0
    for rank, (projection, piece) in enumerate(here):
        rows = projection.rows(piece.start, piece.stop)
        target = projection.target[rows] - piece.start + piece.offset
        form = np.full(len(target), formats.index(projection.format))
        source, mantissa, delay = projection.source[rows], projection.mantissa[rows], projection.delay[rows]
        columns.append((source, np.full(len(target), rank), target, mantissa, delay, form))
        words += projection.words(piece.start, piece.stop, chip)
    source, ranks, target, mantissa, delay, form = (np.concatenate(column) for column in zip(*columns, strict=True))
    order = np.lexsort((target, ranks, source))
    sources, starts = np.unique(source[order], return_index=True)
    list_start = np.append(starts, len(source))
    return _Lists(sources, list_start, target[order], mantissa[order], delay[order], form[order], tuple(formats), words)
