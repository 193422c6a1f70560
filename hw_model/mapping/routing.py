"""Give every spike a way: output axons, input axons and synapse lists.

Before: every compartment has a core.
After:  every source (input line or compartment) has one input axon on each core that it reaches, whose list holds each
        of its synapses there exactly once; every compartment has one output axon for each core that it reaches.
"""

from collections.abc import Callable, Sequence
from itertools import groupby

import numpy as np

from hw_model.description.chip import Chip
from hw_model.mapping.fan_in import FanIn, SynapseFormat, fan_in, first_source
from hw_model.mapping.graph import held
from hw_model.mapping.placement import PlacedGraph, Slice
from hw_model.mapping.synapse_lists import synapse_lists
from hw_model.values import Frozen, IntArray


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


Ways = tuple[IntArray, IntArray, IntArray]
"""Rows of (sender, destination core, input axon there)."""


def route_axons(placed: PlacedGraph) -> RoutedGraph:
    """Number axons by source in network order, and list synapses by projection, then target."""
    graph, per_core = placed.graph, placed.chip.limits.compartments_per_core
    projections, first, sent = fan_in(graph, placed.chip), first_source(graph), _sent(placed)
    lines = sum(item.size for item in graph.inputs)
    cores = []
    for number, found in groupby(placed.slices, key=lambda piece: piece.core):
        slices, start = tuple(found), lines + number * per_core
        axons = _tables(slices, projections, placed.chip, sent(start, start + per_core))
        cores.append(
            RoutedCore(number, placed.slots[number], graph.phase_of(slices[0].group), slices, axons)
        )
    routes = [
        InputRoute(item.name, *sent(first[item.name], first[item.name] + item.size))
        for item in graph.inputs
    ]
    routed = RoutedGraph(placed, tuple(cores), tuple(routes))
    check_routed(routed)
    return routed


def check_routed(routed: RoutedGraph) -> None:
    """Every synapse is in exactly one list; what cores hold is checked with the program that they become."""
    stored = sum(len(core.axons.target) for core in routed.cores)
    assert stored == sum(len(s.mantissa) for s in routed.placed.graph.synapses), (
        "routing lost or doubled synapses"
    )


def _sent(placed: PlacedGraph) -> Callable[[int, int], Ways]:
    """Return what tells where senders ``start..stop`` reach: input lines by number, then the compartments of each core.

    A core has as many numbers as compartments fit it.
    """
    lines, per_core = (
        sum(item.size for item in placed.graph.inputs),
        placed.chip.limits.compartments_per_core,
    )
    number = np.arange(len(placed.core_of_source()))
    for piece in placed.slices:
        number[placed.sources_of(piece)] = (
            lines + piece.core * per_core + piece.offset + np.arange(piece.size)
        )
    unordered = number[np.concatenate(placed.axons)]
    order = np.argsort(unordered, kind="stable")
    sender = unordered[order]
    core = np.repeat(np.arange(placed.cores), [len(found) for found in placed.axons])[order]
    axon = np.concatenate([np.arange(len(found)) for found in placed.axons])[order]

    def sent(start: int, stop: int) -> Ways:
        low, high = np.searchsorted(sender, (start, stop))
        return sender[low:high] - start, core[low:high], axon[low:high]

    return sent


def _tables(
    slices: Sequence[Slice], projections: Sequence[FanIn], chip: Chip, output: Ways
) -> AxonTables:
    """Return the tables of a core, given its output axons."""
    here = [(p, piece) for p in projections for piece in slices if piece.group == p.target_group]
    formats = sorted({projection.format for projection, _ in here})
    columns: list[tuple[IntArray, ...]] = [(np.empty(0, dtype=np.int64),) * 6]
    for rank, (projection, piece) in enumerate(here):
        rows = projection.rows(piece.start, piece.stop)
        target = projection.targets(piece.start, piece.stop) - piece.start + piece.offset
        form = np.full(len(target), formats.index(projection.format))
        source, mantissa, delay = (
            projection.source[rows],
            projection.mantissa[rows],
            projection.delay[rows],
        )
        columns.append((source, np.full(len(target), rank), target, mantissa, delay, form))
    source, ranks, target, mantissa, delay, form = (
        np.concatenate(column) for column in zip(*columns, strict=True)
    )
    order = np.lexsort((target, ranks, source))
    _, starts = np.unique(source[order], return_index=True)
    list_start = np.append(starts, len(source))
    target, form = target[order], form[order]
    ends = np.array([piece.offset + piece.size for piece in slices])
    lists = synapse_lists(list_start, target, form, formats, ends, chip.synapse_memory)
    synapses = held(target), held(mantissa[order]), held(delay[order]), held(form)
    return AxonTables(tuple(formats), list_start, *synapses, int(lists.words.sum()), *output)
