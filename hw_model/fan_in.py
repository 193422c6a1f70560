"""The synapses of a graph ordered by target, so that the part on a core is a slice; placement and routing share it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw_model.chip_description import Chip
from hw_model.fixed_point import IntArray
from hw_model.graph import CompartmentGraph, Synapses
from hw_model.weights import SignMode


@dataclass(frozen=True, order=True)
class SynapseFormat:
    """How a run of synapses is stored; dense lists need no index bits."""

    weight_bits: int
    sign_mode: SignMode
    exponent: int
    delay_bits: int
    index_bits: int

    @property
    def bits_per_synapse(self) -> int:
        """Bits of one synapse; learning tags are not used."""
        return self.weight_bits + self.delay_bits + self.index_bits


@dataclass(frozen=True, eq=False)
class FanIn:
    """A projection by target, under a name of its own.

    ``source`` counts through all inputs and groups of the graph, see :func:`first_source`.

    The synapses onto target i are rows ``start[i]..start[i + 1]``, in order of their sources.
    """

    name: str
    target_group: str
    format: SynapseFormat
    start: IntArray
    target: IntArray
    source: IntArray
    mantissa: IntArray
    delay: IntArray

    def rows(self, start: int, stop: int) -> slice:
        """Return the rows of all synapses onto targets ``start..stop``."""
        return slice(int(self.start[start]), int(self.start[stop]))

    def lengths(self, start: int, stop: int) -> IntArray:
        """Return how many synapses each source has onto targets ``start..stop``, for sources that have any."""
        return np.unique(self.source[self.rows(start, stop)], return_counts=True)[1]

    def words_of(self, lengths: IntArray, chip: Chip, bits: int | None = None) -> int:
        """Return the memory words of lists of these lengths; ``bits`` a synapse, by default the format's."""
        kinds, times = np.unique(lengths, return_counts=True)
        each = self.format.bits_per_synapse if bits is None else bits
        return sum(chip.synapse_memory.words(int(n), each) * int(k) for n, k in zip(kinds, times, strict=True))


def first_source(graph: CompartmentGraph) -> dict[str, int]:
    """Number all input lines, then all compartments, in network order; return each name's first number."""
    first, count = {}, 0
    for node in graph.nodes:
        first[node.name] = count
        count += node.size
    return first


def fan_in(graph: CompartmentGraph, chip: Chip) -> tuple[FanIn, ...]:
    """Return every projection of the graph by target."""
    first = first_source(graph)
    return tuple(
        _fan_in(f"{number} {synapses.source} -> {synapses.target}", synapses, first[synapses.source], graph, chip)
        for number, synapses in enumerate(graph.synapses)
    )


def _fan_in(name: str, synapses: Synapses, first: int, graph: CompartmentGraph, chip: Chip) -> FanIn:
    targets = graph.group(synapses.target).size
    order = np.argsort(synapses.target_index, kind="stable")
    target = synapses.target_index[order]
    return FanIn(
        name=name,
        target_group=synapses.target,
        format=_format(synapses, targets, chip),
        start=np.searchsorted(target, np.arange(targets + 1)),
        target=target,
        source=synapses.source_index[order] + first,
        mantissa=synapses.mantissa[order],
        delay=synapses.delay[order],
    )


def _format(synapses: Synapses, targets: int, chip: Chip) -> SynapseFormat:
    """A list needs no index where every source reaches every target once: then any range of targets is contiguous."""
    pairs = synapses.source_index * targets + synapses.target_index
    full = len(pairs) % targets == 0 and np.array_equal(pairs, np.arange(len(pairs)))
    index_bits = 0 if full else (chip.limits.compartments_per_core - 1).bit_length()
    return SynapseFormat(synapses.weight_bits, synapses.sign_mode, synapses.exponent, synapses.delay_bits, index_bits)
