"""Give every compartment a core.

Before: a checked CompartmentGraph.
After:  every compartment is in exactly one slice on one core; joined compartments share a core, children first; a core
        serves one phase and no core exceeds a limit. Cores are numbered in network order, and core i is in slot i of
        the board, until :mod:`hw_model.mapping.arrangement` moves it.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from hw_model.arithmetic.fixed_point import WEIGHT_BITS
from hw_model.description.chip import Chip
from hw_model.errors import TargetError
from hw_model.mapping.core_load import (
    PopulationPart,
    axons_and_words,
    count_fitting_neurons,
    first_exceeded_limit,
)
from hw_model.mapping.fan_in import FanIn, fan_in, first_source
from hw_model.mapping.graph import CompartmentGraph
from hw_model.values import Frozen, IntArray


class Slice(Frozen):
    """Compartments ``start..stop`` of a group, which are compartments ``offset``, ``offset + 1``, ... of a core."""

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
    """Fill cores in network order, never going back to an earlier core, so equal graphs are placed equally.

    A compartment takes an output axon for each core that it reaches, which is known only once its targets are placed.
    If a core then has too many output axons, its populations get fewer neurons per core, and everything is placed
    again. A graph that does not fit is a ``TargetError``.
    """
    incoming = fan_in(graph, chip)
    # The most neurons per core of populations that were found to take too many output axons. The numbers shrink from
    # round to round, until every core has few enough or not even one neuron of a population fits a core.
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
    """Assert that every compartment is placed exactly once.

    The contents of cores are checked later, with the program that they become (:mod:`hw_model.program.check`).
    """
    times_placed = {
        group.name: np.zeros(group.size, dtype=np.int64) for group in placed.graph.groups
    }
    for piece in placed.slices:
        times_placed[piece.group][piece.start : piece.stop] += 1
    for name, times in times_placed.items():
        assert (times == 1).all(), f"placement lost or doubled compartments of {name!r}"


def populations(
    graph: CompartmentGraph, phase: str, incoming: Sequence[FanIn]
) -> list[PopulationPart]:
    """Return the populations of a phase, in network order of their roots, each as a part with all its neurons.

    A population is all groups that are joined to each other, children before parents.
    """
    # The path from each group along its joins up to its root.
    path_of = {
        group.name: graph.joins(group.name) for group in graph.groups if group.phase == phase
    }
    parts = []
    for root in path_of:
        names = [name for name, path in path_of.items() if path[-1] == root]
        if not names:
            # This group is joined to another one, so it belongs to that one's population.
            continue
        # The longer the path to the root, the deeper the group lies below it.
        children_first = sorted(names, key=lambda name: -len(path_of[name]))
        groups = [graph.group(name) for name in children_first]
        projections = [p for p in incoming if p.target_group in names]
        parts.append(PopulationPart(groups, projections, 0, graph.group(root).size))
    return parts


def _fill(
    graph: CompartmentGraph, chip: Chip, incoming: Sequence[FanIn], most_neurons: Mapping[str, int]
) -> PlacedGraph:
    """Put populations on cores, as many neurons of each as fit.

    A population that ``most_neurons`` names gets at most that many neurons per core.
    """
    cores: list[list[PopulationPart]] = []
    for phase in graph.phases:
        # A core runs in one phase only.
        cores.append([])
        for population in populations(graph, phase.name, incoming):
            # Populations of different parts of the network share no core, see `CompartmentGraph.apart`.
            if cores[-1] and graph.part(cores[-1][-1].root) != graph.part(population.root):
                cores.append([])
            _fill_population(cores, population, chip, most_neurons.get(population.root))
        if not cores[-1]:
            cores.pop()
    slices: list[Slice] = []
    for number, parts in enumerate(cores):
        slices += _slices(number, parts)
    return PlacedGraph(
        graph=graph,
        chip=chip,
        slices=tuple(slices),
        slots=tuple(range(len(cores))),
        axons=tuple(axons_and_words(parts, chip)[0] for parts in cores),
    )


def _fill_population(
    cores: list[list[PopulationPart]],
    population: PopulationPart,
    chip: Chip,
    most_neurons: int | None,
) -> None:
    """Add the neurons of a population to the last of ``cores``, and append further cores as they fill up."""
    neurons_per_core = population.stop if most_neurons is None else most_neurons
    start = 0
    while start < population.stop:
        stop = min(population.stop, start + neurons_per_core)
        unplaced = replace(population, start=start, stop=stop)
        neurons = count_fitting_neurons(cores[-1], unplaced, chip)
        if neurons:
            cores[-1].append(replace(unplaced, stop=start + neurons))
        elif not cores[-1]:
            # Not even one neuron fits an empty core.
            raise _too_large(replace(unplaced, stop=start + 1), chip)
        start += neurons
        # The core is full if no neuron fitted. With `most_neurons` on it, its output axons are used up, so that no
        # other population can use the rest of it.
        if neurons == 0 or neurons == most_neurons:
            cores.append([])


def _slices(core: int, parts: list[PopulationPart]) -> Iterator[Slice]:
    """Yield a slice for each group of each part on a core, one after the other."""
    offset = 0
    for part in parts:
        for group in part.groups:
            yield Slice(group.name, core, part.start, part.stop, offset)
            offset += part.stop - part.start


def _crowded_by_output(placed: PlacedGraph) -> dict[str, int]:
    """Return, for populations on cores with too many output axons, how many neurons they may have per core.

    On such a core, the slice with the most output axons shrinks until the core fits. If not even one of its neurons
    fits next to the other slices, every slice of the core is limited to what a core of its own would hold. The numbers
    are estimates, from the mean of output axons per neuron; if they are too high, placement comes here again.
    """
    limit = placed.chip.limits.output_axons_per_core
    crowded: dict[str, int] = {}
    for output_axons in _output_axons_by_core(placed):
        excess = sum(output_axons.values()) - limit
        if excess <= 0:
            continue
        largest = max(output_axons, key=lambda piece: output_axons[piece])
        allowed_axons = output_axons[largest] - excess
        neurons_of = {largest: largest.size * allowed_axons // output_axons[largest]}
        if neurons_of[largest] < 1:
            neurons_of = {
                piece: min(piece.size, piece.size * limit // axons)
                for piece, axons in output_axons.items()
                if axons > 0
            }
        for piece, neurons in neurons_of.items():
            crowded[piece.group] = min(crowded.get(piece.group, neurons), neurons)
    return crowded


def _output_axons_by_core(placed: PlacedGraph) -> Iterable[dict[Slice, int]]:
    """Return a dictionary per core of the output axons that each slice takes, one for each core reached."""
    sources = sum(node.size for node in placed.graph.nodes)
    cores_reached = np.bincount(np.concatenate(placed.axons), minlength=sources)
    axons_of_core: dict[int, dict[Slice, int]] = {}
    for piece in placed.slices:
        axons = int(cores_reached[placed.sources_of(piece)].sum())
        axons_of_core.setdefault(piece.core, {})[piece] = axons
    return axons_of_core.values()


def _too_large(neuron: PopulationPart, chip: Chip) -> TargetError:
    """Return the error for a single neuron that an empty core cannot hold."""
    exceeded = first_exceeded_limit([neuron], chip)
    # The caller has found that the neuron does not fit, so there is such a limit.
    assert exceeded is not None
    return TargetError(
        f"population {neuron.root!r}",
        f"{exceeded.use} {exceeded.what} of neuron {neuron.start} do not fit one core",
        measured=f"{chip.name} holds {exceeded.limit}",
        fix=exceeded.fix,
    )


def _too_many_cores(
    placed: PlacedGraph, incoming: tuple[FanIn, ...], most_neurons: Mapping[str, int]
) -> TargetError:
    """Return the error for a network that needs more cores than the board has.

    It says how many chips would be enough and, if narrower weights alone would be enough, the most bits that fit.
    """
    graph = placed.graph
    chip = placed.chip
    chips = math.ceil(placed.cores / chip.limits.cores_per_chip)
    fix = f"Give a chip file with chips: {chips}, if the board has as many"
    widest = max((p.format.weight_bits for p in incoming), default=1)
    narrower_bits = sorted((bits for bits in WEIGHT_BITS if bits < widest), reverse=True)
    for bits in narrower_bits:
        # Only the room that the weights take matters here, so they keep their values.
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
    """Return the error for a neuron with more output axons than a core has."""
    limit = placed.chip.limits.output_axons_per_core
    what = f"a neuron reaches more cores than a core has output axons ({placed.cores} cores in all)"
    fix = "Connect it to fewer populations, or relay its spikes through compartments."
    return TargetError(
        f"population {name!r}",
        what,
        measured=f"{placed.chip.name} holds {limit} output axons",
        fix=fix,
    )
