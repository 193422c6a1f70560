"""Collect what every core is loaded with: the last step of mapping.

Before: a RoutedGraph, with parameters by group.
After:  a ChipProgram. Every core has tables of its compartments, axons and synapse lists. Parameters that many
        compartments share are stored once, as a *profile*. Only the slices still refer to groups, so that results can
        be reported by the names of groups.
"""

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
    """Return a core's tables: its slices one after the other, equal profiles and thresholds stored once."""
    groups = [graph.group(piece.group) for piece in routed.slices]

    def parameter(name: str) -> IntArray:
        """Return a parameter of all compartments of the core, (compartments,)."""
        parts = [
            getattr(group, name)[piece.start : piece.stop]
            for group, piece in zip(groups, routed.slices, strict=True)
        ]
        return np.concatenate(parts)

    profile_parameters = np.stack([parameter(name) for name in PROFILE])
    # Column p of `profiles` is profile p; `profile` is the number of each compartment's profile.
    profiles, profile = np.unique(profile_parameters, axis=1, return_inverse=True)
    thresholds, threshold = np.unique(parameter("threshold"), return_inverse=True)
    # Placement puts only compartments of equal voltage limits on one core, so the first ones stand for all.
    first_compartment = routed.slices[0].start
    return Core(
        **picked(routed, "number", "slot", "phase", "slices", "axons"),
        profiles=tuple(CompartmentProfile(*map(int, row)) for row in profiles.T),
        thresholds=tuple(map(int, thresholds)),
        vmin=int(groups[0].vmin[first_compartment]),
        vmax=int(groups[0].vmax[first_compartment]),
        # Some versions of numpy give the inverse the shape of the input.
        profile=profile.reshape(-1).astype(np.int64),
        threshold=threshold.reshape(-1).astype(np.int64),
        bias_mantissa=parameter("bias_mantissa"),
        bias_exponent=parameter("bias_exponent"),
        parent=_parents(routed.slices, groups),
    )


def _parents(slices: tuple[Slice, ...], groups: list[Compartments]) -> IntArray:
    """Return the compartment of the core that each compartment is joined to, (compartments,), or -1."""
    parents = []
    for piece, group in zip(slices, groups, strict=True):
        # Joined groups are placed together: the same range of the parent's group is on this core.
        parent_slices = [
            parent
            for parent in slices
            if parent.group == group.joined_to and parent.start == piece.start
        ]
        if parent_slices:
            parents.append(parent_slices[0].offset + np.arange(piece.size))
        else:
            parents.append(np.full(piece.size, -1))
    return np.concatenate(parents).astype(np.int64)
