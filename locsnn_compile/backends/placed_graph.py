"""The placed program as a graph: inputs and the populations' slices on cores, and what connects them, with counts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

import hw_model as hw
from hw_model.program.chip_program import Core

Values = Mapping[str, str | int | bool]
Edge = tuple[str, str, Values]


@dataclass(frozen=True, eq=False)
class ProgramGraph:
    """Nodes by their names, and edges (source, target, values), in the program's order.

    A node is an ``input`` or a slice of ``compartments``, ``start`` to ``stop`` of a group on a core. An edge counts
    ``synapses``, the axons that they come over and the hops of a spike, or the compartments that are ``joined`` one to
    one: they add their voltage to those of the target.
    """

    program: hw.ChipProgram
    nodes: dict[str, Values]
    edges: tuple[Edge, ...]


def placed_graph(program: hw.ChipProgram) -> ProgramGraph:
    """Return the graph of a program."""
    nodes: dict[str, Values] = {
        f"i{k}": {"kind": "input", "name": item.name, "phase": item.phase, "size": item.size}
        for k, item in enumerate(program.inputs)
    }
    for core in program.cores:
        x, y = program.chip.tile_of(core.slot)
        for k, piece in enumerate(core.slices):
            nodes[_slice(core, k)] = {
                "kind": "compartments", "name": piece.group, "phase": core.phase, "size": piece.size,
                "start": piece.start, "stop": piece.stop, "core": core.number, "slot": core.slot,
                "tile_x": x, "tile_y": y, "spiking": piece.group in program.spiking,
            }  # fmt: skip
    synapses = [edge for core in program.cores for edge in _into(core, program)]
    joins = [edge for core in program.cores for edge in _joins(core)]
    return ProgramGraph(program, nodes, (*synapses, *joins))


def _slice(core: Core, number: int) -> str:
    return f"c{core.number}s{number}"


def _into(core: Core, program: hw.ChipProgram) -> Iterator[Edge]:
    """Yield the edges onto a core: its synapses, counted by the node of their axon's source and of their target."""
    axons = core.axons
    sources: list[tuple[str, int]] = []
    source_of_axon = np.full(axons.input_axons, -1, dtype=np.int64)
    for k, item in enumerate(program.inputs):
        route = program.route_of(item.name)
        source_of_axon[route.axon[route.core == core.number]] = k
        sources.append((f"i{k}", 0))
    for sender in program.cores_of(core.phase):
        here = sender.axons.out_core == core.number
        piece = sender.slice_of_compartment[sender.axons.out_compartment[here]]
        source_of_axon[sender.axons.out_axon[here]] = len(sources) + piece
        hops = sum(program.chip.hops(sender.slot, core.slot))
        sources += [(_slice(sender, k), hops) for k in range(len(sender.slices))]

    axon, pieces = axons.axon_of_synapse, len(core.slices)
    pair = source_of_axon[axon] * pieces + core.slice_of_compartment[axons.target]
    pairs, synapses = np.unique(pair, return_counts=True)
    used = np.unique(np.stack((pair, axon)), axis=1)[0]
    used_axons = np.searchsorted(used, pairs, side="right") - np.searchsorted(used, pairs)
    for number, count, used_count in np.stack((pairs, synapses, used_axons), axis=1).tolist():
        source, hops = sources[number // pieces]
        values = {"kind": "synapses", "synapses": count, "axons": used_count, "hops": hops}
        yield source, _slice(core, number % pieces), values


def _joins(core: Core) -> Iterator[Edge]:
    piece_of, children = core.slice_of_compartment, np.flatnonzero(core.parent >= 0)
    found = Counter(zip(piece_of[children].tolist(), piece_of[core.parent[children]].tolist(), strict=True))
    for (child, parent), count in sorted(found.items()):
        yield _slice(core, child), _slice(core, parent), {"kind": "joined", "compartments": count}
