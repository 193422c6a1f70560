"""The synapses of a graph ordered by target, so that the part on a core is a slice; placement and routing share it."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from hw_model.arithmetic.fixed_point import SignMode
from hw_model.description.chip import Chip
from hw_model.mapping.graph import CompartmentGraph, Synapses, held
from hw_model.values import AnyArray, Frozen, IntArray


class SynapseFormat(Frozen, order=True):
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

    def joins(self, other: "SynapseFormat") -> bool:
        """Whether one format can hold the synapses of both unchanged: fields can be widened, exponents and signs not.

        A wider weight field adds low bits to the grid, so the mantissas stay on it.
        """
        return (self.sign_mode, self.exponent) == (other.sign_mode, other.exponent)

    def widened(self, other: "SynapseFormat") -> "SynapseFormat":
        """Return the narrowest format that holds the synapses of both."""
        fields = ("weight_bits", "delay_bits", "index_bits")
        return replace(
            self, **{name: max(getattr(self, name), getattr(other, name)) for name in fields}
        )


class FanIn(Frozen, eq=False):
    """A projection by target, under a name of its own.

    ``source`` counts through all inputs and groups of the graph, see :func:`first_source`.

    The synapses onto target i are rows ``start[i]..start[i + 1]``, in order of their sources.
    """

    name: str
    target_group: str
    format: SynapseFormat
    start: IntArray
    source: AnyArray
    mantissa: AnyArray
    delay: AnyArray

    @property
    def lists(self) -> SynapseFormat | str:
        """What its synapse lists go by on a core: those of one format are one list, dense ones are each their own."""
        return self.format if self.format.index_bits else self.name

    def rows(self, start: int, stop: int) -> slice:
        """Return the rows of all synapses onto targets ``start..stop``."""
        return slice(int(self.start[start]), int(self.start[stop]))

    def targets(self, start: int, stop: int) -> IntArray:
        """Return the targets of these synapses."""
        return np.repeat(np.arange(start, stop), np.diff(self.start[start : stop + 1]))


def first_source(graph: CompartmentGraph) -> dict[str, int]:
    """Number all input lines, then all compartments, in network order; return each name's first number."""
    first_of_name = {}
    count = 0
    for node in graph.nodes:
        first_of_name[node.name] = count
        count += node.size
    return first_of_name


def fan_in(graph: CompartmentGraph, chip: Chip) -> tuple[FanIn, ...]:
    """Return every projection of the graph by target.

    Each is in the narrowest format that holds it. Groups joined to each other are on one core: where they have more
    formats than a core holds, some come to share one, see :func:`share_formats`.
    """
    # Groups joined to each other are told by the parent of all of them.
    roots = [graph.joins(synapses.target)[-1] for synapses in graph.synapses]
    narrowest = [
        _format(synapses, graph.group(synapses.target).size, chip) for synapses in graph.synapses
    ]
    counts: dict[str, Counter[SynapseFormat]] = {root: Counter() for root in roots}
    for root, form, synapses in zip(roots, narrowest, graph.synapses, strict=True):
        counts[root][form] += len(synapses.mantissa)
    limit = chip.limits.synapse_formats_per_core
    stored_as = {root: share_formats(count, limit) for root, count in counts.items()}
    first = first_source(graph)
    projections = []
    for number, synapses in enumerate(graph.synapses):
        form = stored_as[roots[number]][narrowest[number]]
        projections.append(_fan_in(number, synapses, form, first[synapses.source], graph))
    return tuple(projections)


def share_formats(
    synapses: Mapping[SynapseFormat, int], limit: int
) -> dict[SynapseFormat, SynapseFormat]:
    """Return the format in which the synapses of each format are stored, given how many synapses each has.

    Up to ``limit`` formats stay as they are. Of more, the two for which it takes the fewest bits in all share one, and
    so on, until they are few enough or no two can. Only memory is spent: no weight and no delay changes.
    """
    stored_as = {form: form for form in synapses}
    count_of = Counter(synapses)
    while len(count_of) > limit:
        pairs = [pair for pair in combinations(sorted(count_of), 2) if pair[0].joins(pair[1])]
        if not pairs:
            break
        cheapest = min(pairs, key=lambda pair: _bits_added(pair, count_of))
        wide = cheapest[0].widened(cheapest[1])
        count_of[wide] += sum(count_of.pop(form) for form in cheapest)
        for form, stored_form in stored_as.items():
            if stored_form in cheapest:
                stored_as[form] = wide
    return stored_as


def _bits_added(
    pair: tuple[SynapseFormat, SynapseFormat], count_of: Mapping[SynapseFormat, int]
) -> int:
    """Return the bits of memory that it takes to store the synapses of two formats in one."""
    wide = pair[0].widened(pair[1]).bits_per_synapse
    return sum(count_of[form] * (wide - form.bits_per_synapse) for form in pair)


def _fan_in(
    number: int, synapses: Synapses, form: SynapseFormat, first: int, graph: CompartmentGraph
) -> FanIn:
    """Return a projection ordered by target, in a format; ``first`` is the number of its first source."""
    order = np.argsort(synapses.target_index, kind="stable")
    targets = graph.group(synapses.target).size
    synapses_by_target = np.bincount(synapses.target_index, minlength=targets)
    return FanIn(
        name=f"{number} {synapses.source} -> {synapses.target}",
        target_group=synapses.target,
        format=form,
        start=np.append(0, np.cumsum(synapses_by_target)),
        source=held(synapses.source_index[order] + first),
        mantissa=held(synapses.mantissa[order]),
        delay=held(synapses.delay[order]),
    )


def _format(synapses: Synapses, targets: int, chip: Chip) -> SynapseFormat:
    """A list needs no index where every source reaches every target once: then any range of targets is contiguous."""
    pairs = synapses.source_index.astype(np.int64) * targets + synapses.target_index
    full = len(pairs) % targets == 0 and np.array_equal(pairs, np.arange(len(pairs)))
    index_bits = 0 if full else (chip.limits.compartments_per_core - 1).bit_length()
    return SynapseFormat(
        synapses.weight_bits, synapses.sign_mode, synapses.exponent, synapses.delay_bits, index_bits
    )
