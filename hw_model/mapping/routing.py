"""Route spikes from their sources to their synapses, through output axons, input axons and synapse lists.

Before: every compartment has a core.
After:  every source (input line or compartment) has one input axon on each core that it reaches, whose list holds each
        of its synapses there exactly once; every compartment has one output axon for each core that it reaches.

A spike takes this path: compartment -> output axon of its core -> input axon of the target core -> the synapse list of
this axon -> compartments. An input line goes straight to input axons.
"""

from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from hw_model.description.chip import Chip
from hw_model.mapping.fan_in import FanIn, SynapseFormat, fan_in, first_source
from hw_model.mapping.graph import compact
from hw_model.mapping.placement import PlacedGraph, Slice
from hw_model.mapping.synapse_lists import synapse_lists
from hw_model.values import Frozen, IntArray


class AxonTables(Frozen, eq=False):
    """Axons and synapse lists of one core; compartments are numbered as on the core.

    The synapse arrays are ``target``, ``mantissa``, ``delay`` and ``format_index``, an index into ``formats``. Input
    axon j has rows ``list_start[j]..list_start[j + 1]`` of them. They may have 32 bits per value
    (:func:`hw_model.mapping.graph.compact`). All lists together take ``synapse_words`` words of memory. Output axon k
    carries the spikes of ``out_compartment[k]`` to input axon ``out_axon[k]`` of core ``out_core[k]``.
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
    """Where the spikes of an input's lines go: row i leads from ``line[i]`` to input axon ``axon[i]`` of a core."""

    input: str
    line: IntArray
    core: IntArray
    axon: IntArray


class RoutedGraph(Frozen, eq=False):
    """A placed graph with every axon and synapse list."""

    placed: PlacedGraph
    cores: tuple[RoutedCore, ...]
    input_routes: tuple[InputRoute, ...]


class Destinations(Frozen, eq=False):
    """Where the spikes of senders go: row i leads from ``sender[i]`` to input axon ``axon[i]`` of ``core[i]``.

    Arrays are (rows,), ordered by sender. :func:`_first_sender` says how senders are numbered.
    """

    sender: IntArray
    core: IntArray
    axon: IntArray

    def of(self, start: int, stop: int) -> "Destinations":
        """Return the destinations of senders ``start..stop``, which are numbered from 0 in the result."""
        low, high = np.searchsorted(self.sender, (start, stop))
        return Destinations(self.sender[low:high] - start, self.core[low:high], self.axon[low:high])


def route_axons(placed: PlacedGraph) -> RoutedGraph:
    """Number the input axons of a core by source in network order; order an axon's synapses by projection, target."""
    graph = placed.graph
    projections = fan_in(graph, placed.chip)
    destinations = _destinations(placed)
    cores = []
    for number, slices_of_core in groupby(placed.slices, key=lambda piece: piece.core):
        slices = tuple(slices_of_core)
        first_sender = _first_sender(placed, number)
        end_sender = first_sender + placed.chip.limits.compartments_per_core
        output = destinations.of(first_sender, end_sender)
        axons = _axon_tables(slices, projections, placed.chip, output)
        phase = graph.phase_of(slices[0].group)
        cores.append(RoutedCore(number, placed.slots[number], phase, slices, axons))
    first_line = first_source(graph)
    routes = []
    for item in graph.inputs:
        begin = first_line[item.name]
        reached = destinations.of(begin, begin + item.size)
        routes.append(InputRoute(item.name, reached.sender, reached.core, reached.axon))
    routed = RoutedGraph(placed, tuple(cores), tuple(routes))
    check_routed(routed)
    return routed


def check_routed(routed: RoutedGraph) -> None:
    """Assert that there are as many synapses in lists as in the graph.

    The contents of cores are checked later, with the program that they become (:mod:`hw_model.program.check`).
    """
    stored = sum(len(core.axons.target) for core in routed.cores)
    assert stored == sum(len(s.mantissa) for s in routed.placed.graph.synapses), (
        "routing lost or doubled synapses"
    )


def _first_sender(placed: PlacedGraph, core: int) -> int:
    """Return the number of a core's first compartment as a sender.

    Senders are numbered by place, unlike sources, which are numbered in network order: first all input lines, then the
    compartments of core 0, core 1, ... Every core takes as many numbers as compartments fit a core, so that the
    senders of a core are one range.
    """
    lines = sum(item.size for item in placed.graph.inputs)
    return lines + core * placed.chip.limits.compartments_per_core


def _destinations(placed: PlacedGraph) -> Destinations:
    """Return the destinations of all senders, ordered by sender, then core."""
    # Input lines come first in both numberings, so they keep their numbers.
    sender_of_source = np.arange(len(placed.core_of_source()))
    for piece in placed.slices:
        first_sender = _first_sender(placed, piece.core) + piece.offset
        sender_of_source[placed.sources_of(piece)] = first_sender + np.arange(piece.size)
    sender = sender_of_source[np.concatenate(placed.axons)]
    axons_of_core = [len(sources) for sources in placed.axons]
    core = np.repeat(np.arange(placed.cores), axons_of_core)
    axon = np.concatenate([np.arange(axons) for axons in axons_of_core])
    # Stable: the rows of a sender stay in the order of cores.
    by_sender = np.argsort(sender, kind="stable")
    return Destinations(sender[by_sender], core[by_sender], axon[by_sender])


class _Synapses(NamedTuple):
    """Synapses of a core, arrays (synapses,), before they are sorted into lists.

    ``rank`` numbers the pairs of a projection and a slice of the core that it ends on. ``format_index`` is an index
    into the formats of the core.
    """

    source: IntArray
    rank: IntArray
    target: IntArray
    mantissa: IntArray
    delay: IntArray
    format_index: IntArray


def _axon_tables(
    slices: Sequence[Slice], projections: Sequence[FanIn], chip: Chip, output: Destinations
) -> AxonTables:
    """Return the axons and synapse lists of a core; ``output`` is the destinations of its compartments."""
    ending_on_core = [
        (projection, piece)
        for projection in projections
        for piece in slices
        if piece.group == projection.target_group
    ]
    formats = sorted({projection.format for projection, _ in ending_on_core})
    synapses = _synapses_of_core(ending_on_core, formats)
    # The last key of lexsort is the first to sort by: source, then projection, then target.
    by_source = np.lexsort((synapses.target, synapses.rank, synapses.source))
    # Every source that occurs gets an input axon, whose list begins at its first synapse.
    _, first_synapses = np.unique(synapses.source[by_source], return_index=True)
    list_start = np.append(first_synapses, len(by_source))
    target = synapses.target[by_source]
    format_index = synapses.format_index[by_source]
    slice_ends = np.array([piece.offset + piece.size for piece in slices])
    lists = synapse_lists(
        list_start, target, format_index, formats, slice_ends, chip.synapse_memory
    )
    return AxonTables(
        formats=tuple(formats),
        list_start=list_start,
        target=compact(target),
        mantissa=compact(synapses.mantissa[by_source]),
        delay=compact(synapses.delay[by_source]),
        format_index=compact(format_index),
        synapse_words=int(lists.words.sum()),
        out_compartment=output.sender,
        out_core=output.core,
        out_axon=output.axon,
    )


def _synapses_of_core(
    ending_on_core: Sequence[tuple[FanIn, Slice]], formats: Sequence[SynapseFormat]
) -> _Synapses:
    """Return the synapses of all projections onto slices of a core, one pair after the other."""
    # Begin with empty arrays, so that there is something to concatenate for a core without synapses.
    none = np.empty(0, dtype=np.int64)
    parts = [_Synapses(none, none, none, none, none, none)]
    for rank, (projection, piece) in enumerate(ending_on_core):
        rows = projection.rows(piece.start, piece.stop)
        target = projection.targets(piece.start, piece.stop) - piece.start + piece.offset
        part = _Synapses(
            source=projection.source[rows],
            rank=np.full(len(target), rank),
            target=target,
            mantissa=projection.mantissa[rows],
            delay=projection.delay[rows],
            format_index=np.full(len(target), formats.index(projection.format)),
        )
        parts.append(part)
    return _Synapses(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
