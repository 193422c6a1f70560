"""The last level: everything a chip is loaded with, core by core, and how a recording is played to it.

Before (``assemble``): a routed graph, parameters by group.
After:  every core has its compartments in profiles, its axons and synapse lists; nothing refers to a group any more
        but the slices, which give results their names back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.arithmetic.fixed_point import WEIGHT_SHIFT, IntArray, effective_weight
from hw_model.description.chip import Chip
from hw_model.errors import InputError
from hw_model.mapping.graph import CompartmentGraph, Compartments, Input, Phase, Readout
from hw_model.mapping.placement import Slice
from hw_model.mapping.routing import AxonTables, InputRoute, RoutedCore, RoutedGraph


@dataclass(frozen=True, order=True)
class CompartmentProfile:
    """Settings that compartments of a core share; ``joined`` ones add their v to their parent and do not spike."""

    decay_u: int
    decay_v: int
    refractory: int
    joined: int


@dataclass(frozen=True, eq=False)
class Core:
    """One core: ``profile[i]``, ``threshold[i]``, bias and ``parent[i]`` (-1: none) configure compartment i.

    ``number`` counts the program's cores, ``slot`` those of the board (chip ``slot // cores_per_chip``).
    ``threshold`` indexes ``thresholds``, which are mantissas. Children come before their parents.
    """

    number: int
    slot: int
    phase: str
    slices: tuple[Slice, ...]
    profiles: tuple[CompartmentProfile, ...]
    thresholds: tuple[int, ...]
    vmin: int
    vmax: int
    profile: IntArray
    threshold: IntArray
    bias_mantissa: IntArray
    bias_exponent: IntArray
    parent: IntArray
    axons: AxonTables

    @property
    def compartments(self) -> int:
        """Compartments on the core."""
        return len(self.profile)

    def setting(self, name: str) -> IntArray:
        """Return a profile setting for every compartment, shape (compartments,)."""
        return np.array([getattr(profile, name) for profile in self.profiles], dtype=np.int64)[self.profile]

    @property
    def slice_of_compartment(self) -> IntArray:
        """Number of the slice that each compartment belongs to, shape (compartments,)."""
        return np.repeat(np.arange(len(self.slices)), [piece.size for piece in self.slices])

    @property
    def threshold_voltage(self) -> IntArray:
        """Voltage that v must exceed, ``64 * mantissa``, shape (compartments,)."""
        return np.array(self.thresholds, dtype=np.int64)[self.threshold] << WEIGHT_SHIFT

    @property
    def effective_weights(self) -> IntArray:
        """Weights as they are added to q, ``64 * floor(mantissa * 2^exponent)``, shape (synapses,)."""
        exponents = np.array([form.exponent for form in self.axons.formats], dtype=np.int64)
        return effective_weight(self.axons.mantissa, exponents[self.axons.format_index])

    @property
    def bias(self) -> IntArray:
        """Bias values, ``mantissa * 2^exponent``, shape (compartments,)."""
        return self.bias_mantissa << self.bias_exponent


@dataclass(frozen=True, eq=False)
class ChipProgram:
    """A program for a chip; phases run one after the other, each over its own step axis."""

    name: str
    chip: Chip
    phases: tuple[Phase, ...]
    inputs: tuple[Input, ...]
    input_routes: tuple[InputRoute, ...]
    cores: tuple[Core, ...]
    readout: Readout | None
    synapses_pruned: int
    provenance: dict[str, str]
    step_seconds: float | None = None
    """Seconds of a time step; None where nothing says it."""
    event_threshold: int | None = None
    """Events that a bin of a recording must exceed to be 1; None where nothing says it."""

    def cores_of(self, phase: str) -> tuple[Core, ...]:
        """Return the cores that run in a phase."""
        return tuple(core for core in self.cores if core.phase == phase)

    def inputs_of(self, phase: str) -> tuple[Input, ...]:
        """Return the inputs of a phase."""
        return tuple(item for item in self.inputs if item.phase == phase)

    def route_of(self, name: str) -> InputRoute:
        """Return where an input's lines go."""
        return next(route for route in self.input_routes if route.input == name)

    def columns_of(self, phase: str) -> dict[str, slice]:
        """Return the columns of every group in arrays over a phase's compartments, groups one after the other."""
        columns, first = {}, 0
        for name in dict.fromkeys(piece.group for core in self.cores_of(phase) for piece in core.slices):
            columns[name] = slice(first, first + self.populations[name])
            first += self.populations[name]
        return columns

    def columns_of_core(self, core: Core) -> IntArray:
        """Return the column of every compartment of a core, in arrays over its phase's compartments."""
        columns = self.columns_of(core.phase)
        parts = [columns[p.group].start + np.arange(p.start, p.stop) for p in core.slices]
        joined: IntArray = np.concatenate(parts)
        return joined

    @property
    def streams(self) -> dict[str, int]:
        """Recordings that the program expects, by name, with their channels."""
        return {item.stream: item.channels for item in self.inputs}

    @cached_property
    def spiking(self) -> frozenset[str]:
        """Names of the groups that can spike."""
        return frozenset(
            piece.group
            for core in self.cores
            for piece in core.slices
            if not core.profiles[core.profile[piece.offset]].joined
        )

    @cached_property
    def populations(self) -> dict[str, int]:
        """Names and sizes of all compartment groups, in order of their cores."""
        sizes: dict[str, int] = {}
        for core in self.cores:
            for piece in core.slices:
                sizes[piece.group] = max(sizes.get(piece.group, 0), piece.stop)
        return sizes

    def save(self, folder: str | Path) -> None:
        """Write ``program.yaml`` and ``program.npz`` into a folder; see :mod:`hw_model.program.file`."""
        from hw_model.program.file import save_program

        save_program(self, folder)


def assemble(routed: RoutedGraph) -> ChipProgram:
    """Collect profiles and compartment tables of every core, in core order."""
    graph = routed.placed.graph
    cores = tuple(_core(core, graph) for core in routed.cores)
    program = ChipProgram(
        name=graph.name,
        chip=routed.placed.chip,
        phases=graph.phases,
        inputs=graph.inputs,
        input_routes=routed.input_routes,
        cores=cores,
        readout=graph.readout,
        synapses_pruned=graph.synapses_pruned,
        provenance=graph.provenance,
    )
    check_program(program)
    return program


def check_program(program: ChipProgram) -> None:
    """Tables agree in length, indices are in range, children come before parents, every limit holds."""
    limits = program.chip.limits
    input_axons = np.array([core.axons.input_axons for core in program.cores], dtype=np.int64)
    slots = [core.slot for core in program.cores]
    if len(set(slots)) != len(slots) or not all(0 <= slot < program.chip.cores for slot in slots):
        raise _broken("cores", "slots")
    for core in program.cores:
        axons, where = core.axons, f"core {core.number}"
        rules: tuple[tuple[str, bool], ...] = (
            ("compartments", core.compartments <= limits.compartments_per_core),
            ("profiles", len(core.profiles) <= limits.compartment_profiles_per_core),
            ("thresholds", len(core.thresholds) <= limits.threshold_profiles_per_core),
            ("formats", len(axons.formats) <= limits.synapse_formats_per_core),
            ("input axons", axons.input_axons <= limits.input_axons_per_core),
            ("output axons", axons.output_axons <= limits.output_axons_per_core),
            ("synapse words", axons.synapse_words <= limits.synapse_words_per_core),
            ("slices", sum(piece.size for piece in core.slices) == core.compartments),
            ("profile indices", _within(core.profile, len(core.profiles))),
            ("threshold indices", _within(core.threshold, len(core.thresholds))),
            ("parents", bool(((core.parent == -1) | (core.parent > np.arange(core.compartments))).all())),
            ("parents' range", bool((core.parent < core.compartments).all())),
            ("list starts", bool((np.diff(axons.list_start) >= 0).all())),
            ("list ends", len(axons.list_start) > 0 and axons.list_start[-1] == len(axons.target)),
            ("list begins", len(axons.list_start) > 0 and axons.list_start[0] == 0),
            ("targets", _within(axons.target, core.compartments)),
            ("format indices", _within(axons.format_index, len(axons.formats))),
            ("delays", _within(axons.delay, program.chip.registers.delay_max + 1)),
            ("senders", _within(axons.out_compartment, core.compartments)),
        )
        for what, holds in rules:
            if not holds:
                raise _broken(where, what)
        _check_destinations(input_axons, axons.out_core, axons.out_axon, where)
    for route in program.input_routes:
        _check_destinations(input_axons, route.core, route.axon, f"input {route.input!r}")


def _check_destinations(input_axons: IntArray, core: IntArray, axon: IntArray, where: str) -> None:
    if not _within(core, len(input_axons)) or not ((axon >= 0) & (axon < input_axons[core])).all():
        raise _broken(where, "destinations")


def _within(values: IntArray, stop: int) -> bool:
    return bool(((values >= 0) & (values < stop)).all())


def _broken(where: str, what: str) -> InputError:
    return InputError(where, f"its {what} do not make a program", fix="Compile it again.")


def _core(routed: RoutedCore, graph: CompartmentGraph) -> Core:
    groups = [graph.group(piece.group) for piece in routed.slices]

    def column(name: str) -> IntArray:
        parts = [getattr(g, name)[p.start : p.stop] for g, p in zip(groups, routed.slices, strict=True)]
        joined: IntArray = np.concatenate(parts)
        return joined

    sizes = [piece.size for piece in routed.slices]
    joined = np.repeat([int(not group.spiking) for group in groups], sizes)
    rows = np.stack((column("decay_u"), column("decay_v"), column("refractory"), joined))
    profiles, profile = np.unique(rows, axis=1, return_inverse=True)
    thresholds, threshold = np.unique(column("threshold"), return_inverse=True)
    return Core(
        number=routed.number,
        slot=routed.slot,
        phase=routed.phase,
        slices=routed.slices,
        profiles=tuple(CompartmentProfile(*map(int, row)) for row in profiles.T),
        thresholds=tuple(map(int, thresholds)),
        vmin=int(groups[0].vmin[routed.slices[0].start]),
        vmax=int(groups[0].vmax[routed.slices[0].start]),
        profile=profile.reshape(-1).astype(np.int64),
        threshold=threshold.reshape(-1).astype(np.int64),
        bias_mantissa=column("bias_mantissa"),
        bias_exponent=column("bias_exponent"),
        parent=_parents(routed.slices, groups),
        axons=routed.axons,
    )


def _parents(slices: tuple[Slice, ...], groups: list[Compartments]) -> IntArray:
    parents = []
    for piece, group in zip(slices, groups, strict=True):
        beside: Any = [p for p in slices if p.group == group.joined_to and p.start == piece.start]
        parents.append(beside[0].offset + np.arange(piece.size) if beside else np.full(piece.size, -1))
    joined: IntArray = np.concatenate(parents).astype(np.int64)
    return joined
