"""Order the synapses of a graph by target, and choose the format in which each projection is stored.

Placement and routing put a range of targets on a core. Ordered by target, their synapses are one slice of the arrays.
A *format* says how many bits a synapse takes; a core can hold few formats, so some projections have to share one.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from hw_model.arithmetic.fixed_point import SignMode
from hw_model.description.chip import Chip
from hw_model.mapping.graph import CompartmentGraph, Synapses, compact
from hw_model.values import AnyArray, Frozen, IntArray


class SynapseFormat(Frozen, order=True):
    """How the synapses of a list are stored: the bits of their fields, and the sign and exponent that they share.

    ``index_bits`` are for the target's number. A *dense* list has none: its targets follow one another without gaps.
    """

    weight_bits: int
    sign_mode: SignMode
    exponent: int
    delay_bits: int
    index_bits: int

    @property
    def bits_per_synapse(self) -> int:
        """Bits of one synapse. Loihi's synapses can also have tag bits for learning; we use none."""
        return self.weight_bits + self.delay_bits + self.index_bits

    def joins(self, other: "SynapseFormat") -> bool:
        """Return whether one format can hold the synapses of both unchanged.

        Fields can be widened, while signs and exponents have to be equal. A wider weight field only adds low bits, so
        all values of the narrower grid are on the wider one, too.
        """
        return (self.sign_mode, self.exponent) == (other.sign_mode, other.exponent)

    def widened(self, other: "SynapseFormat") -> "SynapseFormat":
        """Return the narrowest format that holds the synapses of both."""
        fields = ("weight_bits", "delay_bits", "index_bits")
        return replace(
            self, **{name: max(getattr(self, name), getattr(other, name)) for name in fields}
        )


class FanIn(Frozen, eq=False):
    """A projection with its synapses ordered by target, as in a CSC or CSR matrix.

    The synapses onto target i are rows ``start[i]..start[i + 1]`` of ``source``, ``mantissa`` and ``delay``, ordered
    by source. Sources are numbered through all inputs and groups of the graph, see :func:`first_source`. No two
    projections have the same ``name``.
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
        """The key by which a core merges synapse lists of a source.

        Projections in one format share a list. A dense list belongs to one projection alone, since its targets have
        to follow one another.
        """
        return self.format if self.format.index_bits else self.name

    def rows(self, start: int, stop: int) -> slice:
        """Return the rows of all synapses onto targets ``start..stop``."""
        return slice(int(self.start[start]), int(self.start[stop]))

    def targets(self, start: int, stop: int) -> IntArray:
        """Return the target of every synapse onto targets ``start..stop``, in the order of :meth:`rows`."""
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
    """Return every projection of the graph ordered by target, in the narrowest format that holds it.

    Groups that are joined to each other have to be on one core. If together they have more formats than a core can
    hold, some projections share a wider format, see :func:`share_formats`.
    """
    # Groups that are joined to each other have the same root, which identifies them as one population.
    roots = [graph.joins(synapses.target)[-1] for synapses in graph.synapses]
    narrowest = [
        _narrowest_format(synapses, graph.group(synapses.target).size, chip)
        for synapses in graph.synapses
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

    Up to ``limit`` formats stay as they are. While there are more, the two formats whose union costs the fewest
    additional bits are merged. This ends, too, if no two of them can be merged; placement then reports the limit.
    Only memory is spent: no weight and no delay changes.
    """
    stored_as = {form: form for form in synapses}
    count_of = Counter(synapses)
    while len(count_of) > limit:
        # Sorted, so that of equally cheap pairs the choice does not depend on the order of projections.
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
    """Return how many more bits the synapses of two formats take in their common, wider format."""
    wide = pair[0].widened(pair[1]).bits_per_synapse
    return sum(count_of[form] * (wide - form.bits_per_synapse) for form in pair)


def _fan_in(
    number: int, synapses: Synapses, form: SynapseFormat, first: int, graph: CompartmentGraph
) -> FanIn:
    """Return projection ``number`` ordered by target; ``first`` is the number of its first source."""
    # Stable: the synapses onto one target stay in the order of their sources.
    order = np.argsort(synapses.target_index, kind="stable")
    targets = graph.group(synapses.target).size
    synapses_by_target = np.bincount(synapses.target_index, minlength=targets)
    return FanIn(
        name=f"{number} {synapses.source} -> {synapses.target}",
        target_group=synapses.target,
        format=form,
        start=np.append(0, np.cumsum(synapses_by_target)),
        source=compact(synapses.source_index[order] + first),
        mantissa=compact(synapses.mantissa[order]),
        delay=compact(synapses.delay[order]),
    )


def _narrowest_format(synapses: Synapses, targets: int, chip: Chip) -> SynapseFormat:
    """Return the narrowest format that holds a projection onto a group of ``targets`` compartments.

    If every source reaches every target exactly once, lists can be dense: whatever range of targets a core gets, the
    targets of each list follow one another.
    """
    # In int64, since the product of two 32-bit indices may not fit 32 bits.
    pairs = synapses.source_index.astype(np.int64) * targets + synapses.target_index
    # Synapses are ordered by source, then target: all-to-all means 0, 1, 2, ... without gaps or repeats.
    is_all_to_all = len(pairs) % targets == 0 and np.array_equal(pairs, np.arange(len(pairs)))
    # Else enough bits for the number of any compartment of a core.
    index_bits = 0 if is_all_to_all else (chip.limits.compartments_per_core - 1).bit_length()
    return SynapseFormat(
        synapses.weight_bits, synapses.sign_mode, synapses.exponent, synapses.delay_bits, index_bits
    )
