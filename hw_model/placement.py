"""Give every compartment a core.

Before: a checked CompartmentGraph.
After:  every compartment is in exactly one slice on one core; joined compartments share a core, children first; a core
        serves one phase; no core exceeds a limit that placement can see (output axons are known only after routing).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import groupby

import numpy as np

from hw_model.chip_description import Chip
from hw_model.errors import TargetError
from hw_model.fan_in import FanIn, SynapseFormat, fan_in
from hw_model.fixed_point import IntArray
from hw_model.graph import CompartmentGraph, Compartments


@dataclass(frozen=True)
class Slice:
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


@dataclass(frozen=True, eq=False)
class PlacedGraph:
    """A graph with the core of every compartment."""

    graph: CompartmentGraph
    chip: Chip
    slices: tuple[Slice, ...]

    @property
    def cores(self) -> int:
        """Cores in use; they are numbered from 0."""
        return max(piece.core for piece in self.slices) + 1


def place_cores(graph: CompartmentGraph, chip: Chip) -> PlacedGraph:
    """Fill cores in network order, never going back, so equal inputs place equally."""
    projections = fan_in(graph, chip)
    slices: list[Slice] = []
    core = -1
    for phase in graph.phases:
        load: _Load | None = None
        for cluster in _clusters(graph, phase.name):
            incoming = [p for p in projections if p.target_group in cluster.names]
            start = 0
            while start < cluster.size:
                stop, grown = _largest_fit(cluster, incoming, start, load, chip) if load else (start, None)
                if grown is None:
                    core, load = core + 1, _Load()
                    stop, grown = _largest_fit(cluster, incoming, start, load, chip)
                    if grown is None:
                        raise _too_large(cluster, incoming, start, chip)
                offset = load.compartments if load else 0
                for group in cluster.groups:
                    slices.append(Slice(group.name, core, start, stop, offset))
                    offset += stop - start
                start, load = stop, grown
    if core >= chip.cores:
        raise TargetError(
            f"network {graph.name!r}",
            f"{core + 1} cores are needed",
            measured=f"{chip.name} has {chip.cores} on {chip.chips} chip(s)",
            fix="Use a chip file whose board has more chips, or fewer weight bits.",
        )
    placed = PlacedGraph(graph, chip, tuple(slices))
    check_placed(placed)
    return placed


def check_placed(placed: PlacedGraph) -> None:
    """Every compartment placed exactly once, and no core holds more compartments than the chip allows."""
    for group in placed.graph.groups:
        seen = np.zeros(group.size, dtype=np.int64)
        for piece in placed.slices:
            if piece.group == group.name:
                seen[piece.start : piece.stop] += 1
        assert (seen == 1).all(), f"placement lost or doubled compartments of {group.name!r}"
    for core in range(placed.cores):
        used = sum(piece.size for piece in placed.slices if piece.core == core)
        assert used <= placed.chip.limits.compartments_per_core, f"placement overfilled core {core}"


@dataclass(frozen=True)
class _Cluster:
    """Groups joined to each other, children first: neuron i is compartment i of each."""

    groups: tuple[Compartments, ...]

    @property
    def size(self) -> int:
        return self.groups[0].size

    @property
    def names(self) -> frozenset[str]:
        return frozenset(group.name for group in self.groups)


def _clusters(graph: CompartmentGraph, phase: str) -> list[_Cluster]:
    """Return joined groups together, in network order of their roots, children before parents."""

    def path(group: Compartments) -> tuple[str, ...]:
        return (group.name,) if group.joined_to is None else (*path(graph.group(group.joined_to)), group.name)

    groups = [group for group in graph.groups if group.phase == phase]
    order = {group.name: i for i, group in enumerate(groups)}
    groups.sort(key=lambda group: (order[path(group)[0]], -len(path(group))))
    return [_Cluster(tuple(members)) for _, members in groupby(groups, key=lambda group: path(group)[0])]


@dataclass(frozen=True, eq=False)
class _Load:
    """What a core holds so far."""

    compartments: int = 0
    profiles: frozenset[tuple[int, ...]] = frozenset()
    thresholds: frozenset[int] = frozenset()
    voltage_limits: frozenset[tuple[int, int]] = frozenset()
    formats: frozenset[SynapseFormat] = frozenset()
    axons: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    words: int = 0

    def plus(self, cluster: _Cluster, incoming: list[FanIn], start: int, stop: int, chip: Chip) -> _Load:
        profiles, thresholds, limits = set(self.profiles), set(self.thresholds), set(self.voltage_limits)
        for g in cluster.groups:
            rows = np.stack((g.decay_u, g.decay_v, g.refractory))[:, start:stop]
            profiles |= {(*map(int, row), int(g.spiking)) for row in np.unique(rows, axis=1).T}
            thresholds |= set(map(int, np.unique(g.threshold[start:stop])))
            limits |= {(int(a), int(b)) for a, b in np.unique(np.stack((g.vmin, g.vmax))[:, start:stop], axis=1).T}
        words, axons = self.words, [self.axons]
        for projection in incoming:
            axons.append(projection.source[projection.rows(start, stop)])
            words += projection.words(start, stop, chip)
        return _Load(
            self.compartments + len(cluster.groups) * (stop - start),
            frozenset(profiles),
            frozenset(thresholds),
            frozenset(limits),
            self.formats | {p.format for p in incoming},
            np.unique(np.concatenate(axons)),
            words,
        )

    def broken(self, chip: Chip) -> tuple[str, int, int, str] | None:
        """Return the first limit exceeded, as (what, measured, limit, fix)."""
        limits = chip.limits
        rows = (
            ("compartments", self.compartments, limits.compartments_per_core, "Join fewer compartments to a neuron."),
            ("input axons", len(self.axons), limits.input_axons_per_core, "Lower the fan-in of a neuron."),
            ("synapse memory words", self.words, limits.synapse_words_per_core, "Use fewer weight bits."),
            ("synapse formats", len(self.formats), limits.synapse_formats_per_core, "Use fewer exponents and widths."),
            ("compartment profiles", len(self.profiles), limits.compartment_profiles_per_core, "Share decays."),
            ("threshold profiles", len(self.thresholds), limits.threshold_profiles_per_core, "Share thresholds."),
            ("pairs of voltage limits", len(self.voltage_limits), 1, "Joined compartments need equal vmin and vmax."),
        )  # fmt: skip
        return next((row for row in rows if row[1] > row[2]), None)


def _largest_fit(
    cluster: _Cluster, incoming: list[FanIn], start: int, load: _Load, chip: Chip
) -> tuple[int, _Load | None]:
    """Return the largest ``stop`` whose neurons still fit beside ``load``, and the load then; by bisection."""
    room = (chip.limits.compartments_per_core - load.compartments) // len(cluster.groups)
    low, best = start, None
    high = min(cluster.size, start + room)
    probe = high
    while low < high:
        grown = load.plus(cluster, incoming, start, probe, chip)
        if grown.broken(chip) is None:
            low, best = probe, grown
        else:
            high = probe - 1
        probe = (low + high + 1) // 2
    return low, best


def _too_large(cluster: _Cluster, incoming: list[FanIn], start: int, chip: Chip) -> TargetError:
    broken = _Load().plus(cluster, incoming, start, start + 1, chip).broken(chip)
    assert broken is not None
    what, measured, limit, fix = broken
    return TargetError(
        f"population {cluster.groups[-1].name!r}",
        f"{measured} {what} of neuron {start} do not fit one core",
        measured=f"{chip.name} holds {limit}",
        fix=fix,
    )
