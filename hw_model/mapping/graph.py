"""The first level of the chip side: named groups of compartments and the synapses between them, not yet on cores.

CompartmentGraph -> PlacedGraph -> RoutedGraph -> ChipProgram
(this file)         placement      routing        program
"""

from collections.abc import Callable, Mapping
from dataclasses import field, fields
from typing import Any, Literal, get_args

import numpy as np

from hw_model.arithmetic.fixed_point import DECAY_ONE, WEIGHT_EXPONENTS, SignMode, weight_grid
from hw_model.description.chip import Chip
from hw_model.errors import InputError, TargetError
from hw_model.values import AnyArray, ArrayLike, FloatArray, Frozen, IntArray, sealed

Axis = Literal["time", "location"]
AXES: tuple[Axis, ...] = get_args(Axis)

MOST_CHARGES = 1 << 27
"""Charges that are due in later steps, of a phase: half a gigabyte, or a whole one in 64 bits."""


def read_only(array: object) -> IntArray:
    """Return an int64 copy that nobody can write to."""
    return sealed(np.array(array, dtype=np.int64))


def held(array: ArrayLike) -> AnyArray:
    """Return integers (n,), one for each synapse, that nobody can write to, in little memory.

    Equal ones, as delays mostly are, take that of one; others take 32 bits, or 64 where these do not hold them.
    """
    values = np.asarray(array)
    if len(values) and (values == values[0]).all():
        return np.broadcast_to(np.int64(values[0]), values.shape)
    narrow = values.astype(np.int32)
    return sealed(narrow if np.array_equal(narrow, values) else values.astype(np.int64))


def _keep(record: object, kept: Callable[[Any], AnyArray], *names: str) -> None:
    """Put what nobody can write to in the place of a record's arrays; what is None stays."""
    for name in names:
        if (value := getattr(record, name)) is not None:
            object.__setattr__(record, name, kept(value))


class Phase(Frozen):
    """One run over one step axis; ``steps`` is None where the recording, or the last visit of its channels, decides.

    With ``align_events`` a recording starts at the first step in which its streams have so many events together: what
    lies before is left out. Over time the phase begins there, and ends after its steps or with the recording; steps
    before and after are not run, and registers are 0 in them. A transposed phase takes that step for the first row.
    """

    name: str
    axis: Axis
    steps: int | None
    align_events: int | None = None


class Input(Frozen, eq=False):
    """``size`` input lines of a phase, fed from the recording ``stream`` (steps, channels).

    With ``positions`` None, line c spikes at step t where channel c does. Else through the transpose buffer: an event
    of channel c at step t becomes a spike of line ``first_lines[c] + t`` at step ``positions[c]``, both (channels,);
    ``first_lines`` None: 0 for all. Channels of one step have lines of their own.
    """

    name: str
    size: int
    phase: str
    stream: str
    positions: IntArray | None = None
    first_lines: IntArray | None = None

    def __post_init__(self) -> None:
        _keep(self, read_only, "positions", "first_lines")

    @property
    def channels(self) -> int:
        """Channels of the recording that feeds these lines."""
        return self.size if self.positions is None else len(self.positions)

    @property
    def rows(self) -> int:
        """Rows of a recording that the transpose buffer takes: one a line, from the highest of ``first_lines`` on."""
        return self.size if self.first_lines is None else self.size - int(self.first_lines.max(initial=0))

    @property
    def lines_are_shared(self) -> bool:
        """Whether two channels of one step have a line in common."""
        if self.positions is None:
            return False
        first_lines = np.zeros_like(self.positions) if self.first_lines is None else self.first_lines
        order = np.lexsort((first_lines, self.positions))
        one_step = np.diff(self.positions[order]) == 0
        return bool((one_step & (np.diff(first_lines[order]) < self.rows)).any())


class Compartments(Frozen, eq=False):
    """A group of ``size`` compartments; every parameter is an array (size,) of integers, or given as one for all.

    ``u = rz(u, decay_u) + q``; ``v = rz(v, decay_v) + u + bias``, plus the v of joined children; spike where
    ``v > 64 * threshold``. With ``joined_to``, compartment i adds its v to compartment i of that group, and neither
    spikes nor is reset.
    """

    name: str
    phase: str
    size: int
    decay_u: IntArray
    decay_v: IntArray
    threshold: IntArray
    bias_mantissa: IntArray
    bias_exponent: IntArray
    refractory: IntArray
    vmin: IntArray
    vmax: IntArray
    joined_to: str | None = None

    def __post_init__(self) -> None:
        names = (item.name for item in fields(self) if item.type == IntArray)
        _keep(self, lambda given: read_only(given if np.ndim(given) else np.full(self.size, given)), *names)

    @property
    def spiking(self) -> bool:
        """Whether these compartments can spike."""
        return self.joined_to is None

    @property
    def joined(self) -> IntArray:
        """1 for each compartment that adds its v to another, else 0."""
        return np.full(self.size, int(not self.spiking))


class Synapses(Frozen, eq=False):
    """Synapses from ``source`` (input or compartments) to ``target``, one row each, ordered by source, then target.

    Their arrays may have 32 bits a number, see :func:`held`.
    """

    source: str
    target: str
    source_index: IntArray
    target_index: IntArray
    mantissa: IntArray
    delay: IntArray
    exponent: int
    weight_bits: int
    sign_mode: SignMode

    def __post_init__(self) -> None:
        _keep(self, held, "source_index", "target_index", "mantissa", "delay")

    @property
    def delay_bits(self) -> int:
        """Bits that the longest delay needs in a synapse format."""
        return int(self.delay.max(initial=0)).bit_length()


class Readout(Frozen):
    """Class scores: what populations of one size give, weighted and added. Ties go to the first class.

    A population gives its spike counts; with ``potentials_from``, its largest potentials from that step on: v as the
    threshold sees it, of neurons that do not spike. One value is for all, None among several for a population that
    gives its spikes.
    """

    populations: tuple[str, ...]
    weights: tuple[float, ...]
    potentials_from: int | tuple[int | None, ...] | None = None

    @property
    def from_step(self) -> dict[str, int]:
        """The populations that give potentials, each with its first step."""
        given = self.potentials_from
        each = given if isinstance(given, tuple) else (given,) * len(self.populations)
        return {name: first for name, first in zip(self.populations, each, strict=True) if first is not None}

    @property
    def terms(self) -> list[tuple[str, float]]:
        """The populations with their weights."""
        return list(zip(self.populations, self.weights, strict=True))

    def scores(self, spikes: Mapping[str, AnyArray], potential: Mapping[str, AnyArray]) -> FloatArray:
        """Return the scores (batch, classes) of spikes and potentials (batch, steps, classes) by population."""
        first = self.from_step
        given = [
            largest(potential[name], first[name]) if name in first else spikes[name].sum(axis=1, dtype=np.float64)
            for name in self.populations
        ]
        total: FloatArray = np.zeros(np.shape(given[0]))
        # In the order in which a simulation adds them, so that float sums are equal to the last bit.
        for weight, part in zip(self.weights, given, strict=True):
            total += weight * part
        return total


def largest(potential: AnyArray, first: int) -> FloatArray:
    """Return the largest potentials (batch, n) of (batch, steps, n) from step ``first`` on; of no steps, 0."""
    rows = potential[:, first:]
    return np.asarray(rows.max(axis=1) if rows.shape[1] else np.zeros(rows.shape[::2]), dtype=np.float64)


class CompartmentGraph(Frozen, eq=False):
    """A whole network as compartments and synapses of integers."""

    name: str
    phases: tuple[Phase, ...]
    inputs: tuple[Input, ...]
    groups: tuple[Compartments, ...]
    synapses: tuple[Synapses, ...]
    readout: Readout | None = None
    synapses_pruned: int = 0
    provenance: dict[str, str] = field(default_factory=dict)
    """Texts that a saved program carries: where it came from and how it was made."""
    apart: tuple[str, ...] = ()
    """Parts whose groups, which begin with ``part/``, get cores of their own."""

    def part(self, name: str) -> str:
        """Return the part that a group belongs to."""
        return next((part for part in self.apart if name.startswith(f"{part}/")), "")

    @property
    def nodes(self) -> tuple[Input | Compartments, ...]:
        """Return all that can send spikes: inputs, then groups."""
        return (*self.inputs, *self.groups)

    def group(self, name: str) -> Compartments:
        """Return a group by name."""
        return next(group for group in self.groups if group.name == name)

    def joins(self, name: str) -> list[str]:
        """Return a group and those that it is joined to, one after the other."""
        way = [name]
        while (parent := self.group(way[-1]).joined_to) is not None:
            way.append(parent)
        return way

    def phase_of(self, name: str) -> str:
        """Return the phase of an input or group."""
        return next(node.phase for node in self.nodes if node.name == name)


def check_graph(graph: CompartmentGraph, chip: Chip) -> None:
    """Check the whole level; the first broken rule is an ``InputError`` or, for a chip limit, a ``TargetError``."""
    _check_names(graph)
    for item in graph.inputs:
        _check_visits(item, next(phase for phase in graph.phases if phase.name == item.phase))
    for group in graph.groups:
        _check_group(graph, group, chip)
    for synapses in graph.synapses:
        _check_synapses(graph, synapses, chip)
    _check_charges(graph)
    if graph.readout is not None:
        sizes = {graph.group(name).size for name in graph.readout.populations}
        if len(sizes) != 1:
            raise InputError("readout", f"its populations differ in size: {sorted(sizes)}", fix="Make them equal.")


def _check_charges(graph: CompartmentGraph) -> None:
    """Every compartment of a phase keeps the charges of as many steps as the phase's longest delay."""
    for phase in graph.phases:
        names = {group.name: group.size for group in graph.groups if group.phase == phase.name}
        delays = [int(part.delay.max(initial=0)) for part in graph.synapses if part.target in names]
        kept, compartments = max(delays, default=0) + 2, sum(names.values())
        if kept * compartments > MOST_CHARGES:
            raise TargetError(
                f"phase {phase.name!r}",
                "its longest delay keeps more charges under way than are simulated",
                measured=f"{kept} steps of {compartments} compartments against {MOST_CHARGES}",
                fix="Shorten the delay, or relay the spike through compartments.",
            )


def _check_names(graph: CompartmentGraph) -> None:
    names = [node.name for node in graph.nodes]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{name!r}", "two inputs or groups have this name", fix="Rename one of them.")
    phases = {phase.name for phase in graph.phases}
    for node in graph.nodes:
        if node.phase not in phases:
            raise InputError(f"{node.name!r}", f"its phase {node.phase!r} does not exist", fix="Name a phase.")
        if node.size < 1:
            raise InputError(f"{node.name!r}", "it is empty", measured=f"size {node.size}", fix="Give it a size.")


def _check_visits(item: Input, phase: Phase) -> None:
    """Channels are visited within the phase, on lines that exist and are theirs alone in that step."""
    if item.positions is None:
        return
    where, lines = f"input {item.name!r}", item.first_lines
    outside = item.positions[(item.positions < 0) | (item.positions >= (phase.steps or np.inf))]
    if len(outside):
        measured = f"step {outside[0]} of {phase.steps}, counted from 0"
        fix = "Give the phase more steps."
        raise InputError(where, "a channel is visited outside its phase", measured=measured, fix=fix)
    if lines is not None and (lines.shape != item.positions.shape or lines.min(initial=0) < 0 or item.rows < 1):
        raise InputError(
            where,
            "its first lines do not fit",
            measured=f"{len(lines)} within {lines.min(initial=0)}..{lines.max(initial=0)} against "
            f"{item.channels} within 0..{item.size - 1}",
            fix="Give one a channel.",
        )
    if item.lines_are_shared:
        raise InputError(where, "two channels of one step share lines", fix="Give each lines of its own.")


def _parameter_rules(chip: Chip) -> tuple[tuple[str, int, int, str], ...]:
    """Rows: parameter, lowest, highest, way out."""
    r = chip.registers
    bias = 1 << r.bias_mantissa_bits
    return (
        ("decay_u", 0, DECAY_ONE, "Give an effective decay, what is subtracted from 4096."),
        ("decay_v", 0, DECAY_ONE, "Give an effective decay, what is subtracted from 4096."),
        ("threshold", 0, r.threshold_mantissa_max, "The threshold is 64 times this mantissa: scale the weights down."),
        ("bias_mantissa", -bias, bias - 1, "Raise the bias exponent or scale the bias down."),
        ("bias_exponent", 0, r.bias_exponent_max, "Use a smaller exponent and a larger mantissa."),
        ("refractory", 1, r.refractory_max, "Shorten the refractory period; 1 blocks no step."),
    )


def _check_group(graph: CompartmentGraph, group: Compartments, chip: Chip) -> None:
    for rule in _parameter_rules(chip):
        _check_range(group, *rule)
    _check_voltage_limits(group, chip)
    if group.joined_to is None:
        return
    parent = next((other for other in graph.groups if other.name == group.joined_to), None)
    if parent is None or parent.phase != group.phase or parent.size != group.size or parent is group:
        fix = "Join to another group of the same size and phase."
        raise InputError(f"compartments {group.name!r}", f"cannot be joined to {group.joined_to!r}", fix=fix)
    if any(s.source == group.name for s in graph.synapses):
        what = "joined compartments do not spike, so no synapse can start there"
        fix = f"Connect from {group.joined_to!r}."
        raise InputError(f"compartments {group.name!r}", what, fix=fix)


def _check_range(group: Compartments, name: str, low: int, high: int, fix: str) -> None:
    values: IntArray = getattr(group, name)
    where = f"compartments {group.name!r}"
    if values.shape != (group.size,):
        raise InputError(where, f"{name} has shape {values.shape}, not ({group.size},)", fix="Give one a compartment.")
    bad = np.flatnonzero((values < low) | (values > high))
    if len(bad):
        measured = f"{values[bad[0]]} against {low}..{high}"
        raise TargetError(where, f"{name} of compartment {bad[0]} is out of range", measured=measured, fix=fix)


def voltage_minima(chip: Chip) -> list[int]:
    """Return the lower voltage limits a core can be set to: ``1 - 2^k``, and the register's own end."""
    return [1 - (1 << k) for k in range(chip.registers.voltage_bits + 1)]


def voltage_maxima(chip: Chip) -> list[int]:
    """Return the upper voltage limits a core can be set to: ``2^(9 + 2k) - 1``, and the register's own end."""
    forms = [(1 << b) - 1 for b in range(9, chip.registers.voltage_bits, 2)]
    return [*forms, chip.registers.voltage_max]


def _check_voltage_limits(group: Compartments, chip: Chip) -> None:
    rules = (("vmin", voltage_minima(chip), "1 - 2^k"), ("vmax", voltage_maxima(chip), "2^(9 + 2k) - 1"))
    for name, settings, formula in rules:
        for value in np.unique(getattr(group, name)).tolist():
            if value not in settings:
                nearest = min(settings, key=lambda setting: abs(setting - value))
                what = f"{name} {value} is not of the form {formula}"
                fix = f"The nearest is {nearest}."
                raise TargetError(f"compartments {group.name!r}", what, fix=fix)


def _check_synapses(graph: CompartmentGraph, synapses: Synapses, chip: Chip) -> None:
    where = f"synapses {synapses.source!r} -> {synapses.target!r}"
    sizes = {node.name: node.size for node in graph.nodes}
    targets = {group.name for group in graph.groups}
    if synapses.source not in sizes or synapses.target not in targets:
        raise InputError(where, "an end does not exist", fix="Add it before connecting.")
    if graph.phase_of(synapses.source) != graph.phase_of(synapses.target):
        raise InputError(where, "the ends are in different phases", fix="Connect within one phase.")
    for values, size in (
        (synapses.source_index, sizes[synapses.source]),
        (synapses.target_index, sizes[synapses.target]),
    ):
        if len(values) and (values.min() < 0 or values.max() >= size):
            raise InputError(where, "an index is outside its group", fix="Correct the indices.")
    lengths = {len(getattr(synapses, f.name)) for f in fields(synapses) if f.type == IntArray}
    if len(lengths) != 1:
        raise InputError(where, "the synapse arrays differ in length", fix="Give one row a synapse.")
    grid = weight_grid(synapses.weight_bits, synapses.sign_mode)
    if synapses.weight_bits not in chip.registers.weight_bits:
        measured = f"{chip.name} has weight_bits_max {chip.registers.weight_bits_max}"
        fix = "Use narrower weights."
        raise TargetError(where, f"weights of {synapses.weight_bits} bits are too wide", measured=measured, fix=fix)
    bad = np.flatnonzero(grid.off_grid(synapses.mantissa))
    if len(bad):
        raise TargetError(
            where,
            f"weight {synapses.mantissa[bad[0]]} is not on the grid of {grid.weight_bits}-bit {grid.sign_mode} weights",
            measured=f"multiples of {grid.step} in {grid.low}..{grid.high}; {len(bad)} of {len(synapses.mantissa)} off",
            fix="Round the weights onto the grid first.",
        )
    if synapses.exponent not in WEIGHT_EXPONENTS:
        measured = f"{synapses.exponent} against -8..7"
        raise TargetError(where, "the weight exponent is out of range", measured=measured, fix="Rescale the weights.")
    delays = synapses.delay[(synapses.delay < 0) | (synapses.delay > chip.registers.delay_max)]
    if len(delays):
        measured = f"{delays[0]} against 0..{chip.registers.delay_max} steps"
        fix = "Relay the spike through a compartment, or shorten the delay."
        raise TargetError(where, "a delay is out of range", measured=measured, fix=fix)
