"""The placed program as a graph: inputs and the populations' slices on cores, and what connects them, with counts."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

import hw_model as hw
from hw_model.arithmetic.fixed_point import IntArray
from hw_model.mapping.placement import Slice
from hw_model.program.chip_program import Core


@dataclass(frozen=True)
class InputNode:
    """An input: ``size`` lines of a phase."""

    id: str
    name: str
    phase: str
    size: int


@dataclass(frozen=True)
class SliceNode:
    """Compartments ``start`` to ``stop`` of a group, on a core."""

    id: str
    name: str
    phase: str
    start: int
    stop: int
    core: int
    spiking: bool

    @property
    def size(self) -> int:
        """Compartments of the slice."""
        return self.stop - self.start


@dataclass(frozen=True)
class SynapseEdge:
    """Synapses from one node to another: how many, over how many axons, and how far a spike travels."""

    source: str
    target: str
    synapses: int
    axons: int
    hops: int


@dataclass(frozen=True)
class JoinEdge:
    """Compartments that add their voltage to those of another node, one to one."""

    source: str
    target: str
    compartments: int


@dataclass(frozen=True, eq=False)
class ProgramGraph:
    """A placed program; nodes and edges in the program's order."""

    program: hw.ChipProgram
    inputs: tuple[InputNode, ...]
    slices: tuple[SliceNode, ...]
    synapses: tuple[SynapseEdge, ...]
    joins: tuple[JoinEdge, ...]


def placed_graph(program: hw.ChipProgram) -> ProgramGraph:
    """Return the graph of a program."""
    inputs = tuple(InputNode(f"i{k}", item.name, item.phase, item.size) for k, item in enumerate(program.inputs))
    slices, of_piece = [], {}
    for core in program.cores:
        for k, piece in enumerate(core.slices):
            node = SliceNode(
                f"c{core.number}s{k}",
                piece.group,
                core.phase,
                piece.start,
                piece.stop,
                core.number,
                piece.group in program.spiking,
            )
            of_piece[piece] = node
            slices.append(node)
    edges = [edge for core in program.cores for edge in _into(core, program, inputs, of_piece)]
    joins = [edge for core in program.cores for edge in _joins(core, of_piece)]
    return ProgramGraph(program, inputs, tuple(slices), tuple(edges), tuple(joins))


def _into(
    core: Core, program: hw.ChipProgram, inputs: tuple[InputNode, ...], of_piece: dict[Slice, SliceNode]
) -> list[SynapseEdge]:
    """Return the edges onto a core: its synapses, counted by the node of their axon's source and of their target."""
    axons = core.axons
    sources: list[tuple[str, int]] = []
    source_of_axon = np.full(axons.input_axons, -1, dtype=np.int64)
    for node in inputs:
        route = program.route_of(node.name)
        source_of_axon[route.axon[route.core == core.number]] = len(sources)
        sources.append((node.id, 0))
    for sender in program.cores_of(core.phase):
        here = sender.axons.out_core == core.number
        piece = _piece_of_compartment(sender)[sender.axons.out_compartment[here]]
        source_of_axon[sender.axons.out_axon[here]] = len(sources) + piece
        hops = sum(program.chip.hops(sender.slot, core.slot))
        sources += [(of_piece[p].id, hops) for p in sender.slices]

    axon = np.repeat(np.arange(axons.input_axons), np.diff(axons.list_start))
    pieces = len(core.slices)
    pair = source_of_axon[axon] * pieces + _piece_of_compartment(core)[axons.target]
    pairs, synapses = np.unique(pair, return_counts=True)
    used = np.unique(np.stack((pair, axon)), axis=1)[0]
    used_axons = np.searchsorted(used, pairs, side="right") - np.searchsorted(used, pairs)
    edges = []
    for number, count, used_count in np.stack((pairs, synapses, used_axons), axis=1).tolist():
        source, hops = sources[number // pieces]
        target = of_piece[core.slices[number % pieces]].id
        edges.append(SynapseEdge(source, target, count, used_count, hops))
    return edges


def _joins(core: Core, of_piece: dict[Slice, SliceNode]) -> list[JoinEdge]:
    piece_of = _piece_of_compartment(core)
    children = np.flatnonzero(core.parent >= 0)
    found = Counter(zip(piece_of[children].tolist(), piece_of[core.parent[children]].tolist(), strict=True))
    return [
        JoinEdge(of_piece[core.slices[child]].id, of_piece[core.slices[parent]].id, count)
        for (child, parent), count in sorted(found.items())
    ]


def _piece_of_compartment(core: Core) -> IntArray:
    """Return which slice of the core each compartment belongs to."""
    return np.repeat(np.arange(len(core.slices)), [piece.size for piece in core.slices])
