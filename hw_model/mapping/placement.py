"""Give every compartment a core.

Before: a checked CompartmentGraph.
After:  every compartment is in exactly one slice on one core; joined compartments share a core, children first; a core
        serves one phase and no core exceeds a limit. Cores are numbered in network order, and sit on the board so.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from hw_model.arithmetic.fixed_point import WEIGHT_BITS
from hw_model.description.chip import Chip
from hw_model.errors import TargetError
from hw_model.mapping.core_load import Piece, first_broken, fitting, synapses
from hw_model.mapping.fan_in import FanIn, fan_in, first_source
from hw_model.mapping.graph import CompartmentGraph
from hw_model.values import Frozen, IntArray


class Slice(Frozen):
    """Compartments ``start..stop`` of a group, on a core from compartment ``offset`` on."""

    group: str
    core: int
    start: int
    stop: int
    offset: int

    @property
    def size(self) -> int:
        """Compartments in the slice."""
        return self.stop - self.start


class PlacedGraph(Frozen, eq=False):
    """A graph with the core of every compartment; core i sits at ``slots[i]`` of the board.

    Slot ``k`` is core ``k % cores_per_chip`` of chip ``k // cores_per_chip``. ``axons[i]`` are the sources that reach
    core i, numbered as :func:`hw_model.mapping.fan_in.first_source` does, ascending.
    """

    graph: CompartmentGraph
    chip: Chip
    slices: tuple[Slice, ...]
    slots: tuple[int, ...]
    axons: tuple[IntArray, ...]

    @property
    def cores(self) -> int:
        """Cores in use; they are numbered from 0."""
        return len(self.axons)

    def core_of_source(self) -> IntArray:
        """Return the core of every source, -1 for input lines."""
        core = np.full(sum(node.size for node in self.graph.nodes), -1, dtype=np.int64)
        for piece in self.slices:
            core[self.sources_of(piece)] = piece.core
        return core

    def sources_of(self, piece: Slice) -> slice:
        """Return the numbers of a slice's compartments among all sources."""
        first = first_source(self.graph)[piece.group]
        return slice(first + piece.start, first + piece.stop)


def place_cores(graph: CompartmentGraph, chip: Chip) -> PlacedGraph:
    """Fill cores in network order, never going back, so equal inputs place equally.

    Output axons depend on where the targets went. Where a core has too many, its populations get fewer neurons a core
    and all is placed again. A graph that fits in no way is a ``TargetError``.
    """
    incoming = fan_in(graph, chip)
    most_neurons: dict[str, int] = {}
    while True:
        placed = _fill(graph, chip, incoming, most_neurons)
        crowded = _crowded_by_output(placed)
        if not crowded:
            break
        for name, neurons in crowded.items():
            if neurons < 1:
                raise _too_many_targets(placed, name)
            most_neurons[name] = neurons
    if placed.cores > chip.cores:
        raise _too_many_cores(placed, incoming, most_neurons)
    check_placed(placed)
    return placed


def check_placed(placed: PlacedGraph) -> None:
    """Every compartment is placed exactly once; what cores hold is checked with the program that they become."""
    seen = {group.name: np.zeros(group.size, dtype=np.int64) for group in placed.graph.groups}
    for piece in placed.slices:
        seen[piece.group][piece.start : piece.stop] += 1
    for name, times in seen.items():
        assert (times == 1).all(), f"placement lost or doubled compartments of {name!r}"


def populations(graph: CompartmentGraph, phase: str, incoming: Sequence[FanIn]) -> list[Piece]:
    """Return the neurons of groups joined to each other, in network order of their roots, children before parents."""
    # From each group up to the one that it is joined to in the end, its root.
    joins_of = {
        group.name: graph.joins(group.name) for group in graph.groups if group.phase == phase
    }
    pieces = []
    for root in joins_of:
        names = [name for name, joins in joins_of.items() if joins[-1] == root]
        if not names:
            continue
        children_first = sorted(names, key=lambda name: -len(joins_of[name]))
        groups = [graph.group(name) for name in children_first]
        projections = [p for p in incoming if p.target_group in names]
        pieces.append(Piece(groups, projections, 0, graph.group(root).size))
    return pieces


def _fill(
    graph: CompartmentGraph, chip: Chip, incoming: Sequence[FanIn], most_neurons: Mapping[str, int]
) -> PlacedGraph:
    """Put populations on cores, as many neurons of each as fit, at most ``most_neurons`` of those named there."""
    cores: list[list[Piece]] = []
    for phase in graph.phases:
        cores.append([])
        for population in populations(graph, phase.name, incoming):
            if cores[-1] and graph.part(cores[-1][-1].root) != graph.part(population.root):
                cores.append([])
            _fill_population(cores, population, chip, most_neurons.get(population.root))
        if not cores[-1]:
            cores.pop()
    slices = [piece for number, pieces in enumerate(cores) for piece in _slices(number, pieces)]
    return PlacedGraph(
        graph=graph,
        chip=chip,
        slices=tuple(slices),
        slots=tuple(range(len(cores))),
        axons=tuple(synapses(pieces, chip)[0] for pieces in cores),
    )


def _fill_population(
    cores: list[list[Piece]], population: Piece, chip: Chip, most_neurons: int | None
) -> None:
    """Add the neurons of a population to the last of ``cores``, and begin further ones as they fill up."""
    neurons_of_core = population.stop if most_neurons is None else most_neurons
    start = 0
    while start < population.stop:
        stop = min(population.stop, start + neurons_of_core)
        left = replace(population, start=start, stop=stop)
        neurons = fitting(cores[-1], left, chip)
        if neurons:
            cores[-1].append(replace(left, stop=start + neurons))
        elif not cores[-1]:
            raise _too_large(replace(left, stop=start + 1), chip)
        start += neurons
        # After as many as may be, the room left is for no other: its output axons are used up.
        if neurons == 0 or neurons == most_neurons:
            cores.append([])


def _slices(core: int, pieces: list[Piece]) -> Iterator[Slice]:
    """Yield the slices of a core's pieces, one after the other."""
    offset = 0
    for piece in pieces:
        for group in piece.groups:
            yield Slice(group.name, core, piece.start, piece.stop, offset)
            offset += piece.stop - piece.start


def _crowded_by_output(placed: PlacedGraph) -> dict[str, int]:
    """Return the populations of cores with too many output axons, and how many neurons of each fit a core.

    Of several on one core it is the one with the most that gives way; where not one neuron of it fits next to the
    others, each is to have cores of its own.
    """
    limit = placed.chip.limits.output_axons_per_core
    crowded: dict[str, int] = {}
    for output_axons in _output_axons_by_core(placed):
        excess = sum(output_axons.values()) - limit
        if excess <= 0:
            continue
        largest = max(output_axons, key=lambda piece: output_axons[piece])
        axons_left = output_axons[largest] - excess
        neurons_of = {largest: largest.size * axons_left // output_axons[largest]}
        if neurons_of[largest] < 1:
            neurons_of = {
                piece: min(piece.size, piece.size * limit // axons)
                for piece, axons in output_axons.items()
                if axons
            }
        for piece, neurons in neurons_of.items():
            crowded[piece.group] = min(crowded.get(piece.group, neurons), neurons)
    return crowded


def _output_axons_by_core(placed: PlacedGraph) -> Iterable[dict[Slice, int]]:
    """Return how many output axons each slice of each core takes: one for each core that a compartment reaches."""
    sources = sum(node.size for node in placed.graph.nodes)
    cores_reached = np.bincount(np.concatenate(placed.axons), minlength=sources)
    axons_of_core: dict[int, dict[Slice, int]] = {}
    for piece in placed.slices:
        axons = int(cores_reached[placed.sources_of(piece)].sum())
        axons_of_core.setdefault(piece.core, {})[piece] = axons
    return axons_of_core.values()


def _too_large(neuron: Piece, chip: Chip) -> TargetError:
    broken = first_broken([neuron], chip)
    assert broken is not None
    return TargetError(
        f"population {neuron.root!r}",
        f"{broken.use} {broken.what} of neuron {neuron.start} do not fit one core",
        measured=f"{chip.name} holds {broken.limit}",
        fix=broken.fix,
    )


def _too_many_cores(
    placed: PlacedGraph, incoming: tuple[FanIn, ...], most_neurons: Mapping[str, int]
) -> TargetError:
    """Say how many chips would do, and, where narrower weights alone would, the most bits that do."""
    graph = placed.graph
    chip = placed.chip
    chips = math.ceil(placed.cores / chip.limits.cores_per_chip)
    fix = f"Give a chip file with chips: {chips}, if the board has as many"
    widest = max((p.format.weight_bits for p in incoming), default=1)
    for bits in sorted((b for b in WEIGHT_BITS if b < widest), reverse=True):
        narrow = [
            replace(p, format=replace(p.format, weight_bits=min(bits, p.format.weight_bits)))
            for p in incoming
        ]
        if _fill(graph, chip, narrow, most_neurons).cores <= chip.cores:
            fix += f", or use {bits} weight bits"
            break
    measured = f"{chip.name} has {chip.cores} on {chip.chips} chip{'s' * (chip.chips > 1)}"
    return TargetError(
        f"network {graph.name!r}",
        f"{placed.cores} cores are needed",
        measured=measured,
        fix=f"{fix}.",
    )


def _too_many_targets(placed: PlacedGraph, name: str) -> TargetError:
    limit = placed.chip.limits.output_axons_per_core
    what = f"a neuron reaches more cores than a core has output axons ({placed.cores} cores in all)"
    fix = "Connect it to fewer populations, or relay its spikes through compartments."
    return TargetError(
        f"population {name!r}",
        what,
        measured=f"{placed.chip.name} holds {limit} output axons",
        fix=fix,
    )
