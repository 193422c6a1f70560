"""Collect what every core is loaded with.

Before: a RoutedGraph, with parameters by group.
After:  a ChipProgram. Every core has its compartments, in profiles, its axons and its synapse lists. Only the slices
        still refer to groups, so that results get their names back.
"""

from typing import Any

import numpy as np

from hw_model.mapping.core_load import PROFILE
from hw_model.mapping.graph import CompartmentGraph, Compartments
from hw_model.mapping.placement import Slice
from hw_model.mapping.routing import RoutedCore, RoutedGraph
from hw_model.program.check import check_program
from hw_model.program.chip_program import ChipProgram, CompartmentProfile, Core
from hw_model.values import IntArray, picked


def assemble(routed: RoutedGraph) -> ChipProgram:
    """Collect the profiles and compartment tables of every core, in core order."""
    graph = routed.placed.graph
    cores = tuple(_core(core, graph) for core in routed.cores)
    fields = picked(graph, "name", "phases", "inputs", "readout", "synapses_pruned", "provenance")
    program = ChipProgram(
        **fields, chip=routed.placed.chip, input_routes=routed.input_routes, cores=cores
    )
    check_program(program)
    return program


def _core(routed: RoutedCore, graph: CompartmentGraph) -> Core:
    groups = [graph.group(piece.group) for piece in routed.slices]

    def column(name: str) -> IntArray:
        parts = [
            getattr(g, name)[p.start : p.stop] for g, p in zip(groups, routed.slices, strict=True)
        ]
        return np.concatenate(parts)

    profiles, profile = np.unique(
        np.stack([column(name) for name in PROFILE]), axis=1, return_inverse=True
    )
    thresholds, threshold = np.unique(column("threshold"), return_inverse=True)
    return Core(
        **picked(routed, "number", "slot", "phase", "slices", "axons"),
        profiles=tuple(CompartmentProfile(*map(int, row)) for row in profiles.T),
        thresholds=tuple(map(int, thresholds)),
        vmin=int(groups[0].vmin[routed.slices[0].start]),
        vmax=int(groups[0].vmax[routed.slices[0].start]),
        profile=profile.reshape(-1).astype(np.int64),
        threshold=threshold.reshape(-1).astype(np.int64),
        bias_mantissa=column("bias_mantissa"),
        bias_exponent=column("bias_exponent"),
        parent=_parents(routed.slices, groups),
    )


def _parents(slices: tuple[Slice, ...], groups: list[Compartments]) -> IntArray:
    parents = []
    for piece, group in zip(slices, groups, strict=True):
        beside: Any = [p for p in slices if p.group == group.joined_to and p.start == piece.start]
        parents.append(
            beside[0].offset + np.arange(piece.size) if beside else np.full(piece.size, -1)
        )
    return np.concatenate(parents).astype(np.int64)
