"""Check a graph of compartments against the rules of networks and the limits of the chip's registers.

This is the first step of mapping. Later steps rely on it: they do not check names, shapes or ranges again. An error
names the group or synapses, so that a user recognises a part of their network. Limits of a core, such as its number of
axons, are checked when cores are filled (:mod:`hw_model.mapping.core_load`).
"""

from collections.abc import Iterable
from dataclasses import fields

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import weight_grid
from hw_model.arithmetic.loihi import Domain
from hw_model.description.chip import Chip
from hw_model.errors import InputError, TargetError, counted
from hw_model.mapping.graph import CompartmentGraph, Compartments, Input, Phase, Synapses
from hw_model.values import IntArray

MOST_CHARGES = 1 << 27
"""The most charges of a phase that can be under way to later steps. In the simulator's memory, 2^27 charges take half
a gigabyte as 32-bit integers, and a gigabyte as 64-bit integers."""

_EFFECTIVE = f"Give an effective decay, what is subtracted from {loihi.FORGETS}."
WAYS_OUT = {
    "decay_u": _EFFECTIVE,
    "decay_v": _EFFECTIVE,
    "threshold": "Give a 64th of the threshold, or scale the weights down.",
    "bias_mantissa": "Raise the bias exponent or scale the bias down.",
    "bias_exponent": "Use a smaller exponent and a larger mantissa.",
    "refractory": "Shorten the refractory period; 1 blocks no step.",
}
"""What to do about a parameter that is out of its range. Parameters are checked in this order, so the first wrong one
is reported."""


def check_graph(graph: CompartmentGraph, chip: Chip) -> None:
    """Raise an error for the first broken rule: ``TargetError`` for a limit of the chip, else ``InputError``."""
    # Names come first, since every later check finds groups and phases by their names.
    _check_names(graph)
    for phase in graph.phases:
        if not can_start(phase, graph.inputs):
            measured = f"align_events {phase.align_events}, axis {phase.axis!r}"
            fix = "Align to 1 event or more, with inputs of this axis alone."
            raise InputError(
                f"phase {phase.name!r}", "it cannot be aligned", measured=measured, fix=fix
            )
    for item in graph.inputs:
        _check_visits(item, next(phase for phase in graph.phases if phase.name == item.phase))
    for group in graph.groups:
        _check_group(graph, group, chip)
    for synapses in graph.synapses:
        _check_synapses(graph, synapses, chip)
    _check_charges(graph)
    _check_readout(graph)


def can_start(phase: Phase, inputs: Iterable[Input]) -> bool:
    """Return whether the phase can start where it says.

    Without ``align_events`` it starts with the recording. With it, either all inputs of the phase go through the
    transpose buffer (a location phase) or none does (a time phase): otherwise the inputs would start apart.
    """
    if phase.align_events is None:
        return True
    inputs_of_phase = [item for item in inputs if item.phase == phase.name]
    are_transposed = {item.positions is not None for item in inputs_of_phase}
    return phase.align_events >= 1 and are_transposed == {phase.axis == "location"}


def _check_readout(graph: CompartmentGraph) -> None:
    """Raise InputError unless the readout names groups of one size: neuron i of each votes for class i."""
    if graph.readout is None:
        return
    size_of = {group.name: group.size for group in graph.groups}
    for name in graph.readout.populations:
        if name not in size_of:
            fix = "Read out groups of compartments of this graph."
            raise InputError("readout", f"{name!r} is not a group of compartments", fix=fix)
    sizes = {size_of[name] for name in graph.readout.populations}
    if not sizes:
        raise InputError(
            "readout", "it names no population", fix="Name one, or leave out the readout."
        )
    if len(sizes) > 1:
        raise InputError(
            "readout", f"its populations differ in size: {sorted(sizes)}", fix="Make them equal."
        )


def _check_charges(graph: CompartmentGraph) -> None:
    """Raise TargetError if the charges under way in a phase need more memory than the simulator allows.

    The simulator keeps a ring of charges per compartment, as long as the longest delay of the phase requires.
    """
    for phase in graph.phases:
        size_of = {group.name: group.size for group in graph.groups if group.phase == phase.name}
        synapses_of_phase = [item for item in graph.synapses if item.target in size_of]
        delays = [int(synapses.delay.max(initial=0)) for synapses in synapses_of_phase]
        # A spike of step t arrives in step t + 1 + delay: with step t itself, the ring has delay + 2 slots.
        slots = max(delays, default=0) + 2
        compartments = sum(size_of.values())
        if slots * compartments > MOST_CHARGES:
            what = "its longest delay keeps more charges in flight than the simulator allows"
            measured = (
                f"{slots} steps of {counted(compartments, 'compartment')} against {MOST_CHARGES}"
            )
            fix = "Shorten the delay, or relay the spike through compartments."
            raise TargetError(f"phase {phase.name!r}", what, measured=measured, fix=fix)


def _check_names(graph: CompartmentGraph) -> None:
    """Raise InputError unless inputs and groups have different names, existing phases and at least one member."""
    names = [node.name for node in graph.nodes]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"{name!r}", "two inputs or groups have this name", fix="Rename one of them."
            )
    phases = {phase.name for phase in graph.phases}
    for node in graph.nodes:
        if node.phase not in phases:
            raise InputError(
                f"{node.name!r}", f"its phase {node.phase!r} does not exist", fix="Name a phase."
            )
        if node.size < 1:
            raise InputError(
                f"{node.name!r}", "it is empty", measured=f"size {node.size}", fix="Give it a size."
            )


def _check_visits(item: Input, phase: Phase) -> None:
    """Raise InputError unless channels are visited within the phase, on existing lines that they do not share.

    A visit is the step in which the transpose buffer plays a channel. An input without positions has no visits.
    """
    if item.positions is None:
        return
    where = f"input {item.name!r}"
    lines = item.first_lines
    # A phase without a number of steps lasts until its last visit, so no visit is too late.
    end = phase.steps or np.inf
    outside = item.positions[(item.positions < 0) | (item.positions >= end)]
    if len(outside):
        measured = f"step {outside[0]} of {phase.steps}, counted from 0"
        fix = "Give the phase more steps."
        raise InputError(
            where, "a channel is visited outside its phase", measured=measured, fix=fix
        )
    if lines is not None and (
        lines.shape != item.positions.shape or lines.min(initial=0) < 0 or item.rows < 1
    ):
        first_lines = f"{len(lines)} within {lines.min(initial=0)}..{lines.max(initial=0)}"
        measured = f"{first_lines} against {item.channels} within 0..{item.size - 1}"
        raise InputError(
            where, "its first lines do not fit", measured=measured, fix="Give one per channel."
        )
    if item.lines_are_shared:
        raise InputError(
            where, "two channels of one step share lines", fix="Give each lines of its own."
        )


def _check_group(graph: CompartmentGraph, group: Compartments, chip: Chip) -> None:
    """Check a group's parameters and, if it is joined to another group, that the two fit together."""
    domains = loihi.domains(chip.registers)
    for name, fix in WAYS_OUT.items():
        _check_range(group, name, domains[name], fix)
    _check_voltage_limits(group, chip)
    if group.joined_to is None:
        return
    parent = next((other for other in graph.groups if other.name == group.joined_to), None)
    if (
        parent is None
        or parent.phase != group.phase
        or parent.size != group.size
        or parent is group
    ):
        fix = "Join to another group of the same size and phase."
        raise InputError(
            f"compartments {group.name!r}", f"cannot be joined to {group.joined_to!r}", fix=fix
        )
    if any(s.source == group.name for s in graph.synapses):
        what = "joined compartments do not spike, so no synapse can start there"
        raise InputError(
            f"compartments {group.name!r}", what, fix=f"Connect from {group.joined_to!r}."
        )


def _check_range(group: Compartments, name: str, domain: Domain, fix: str) -> None:
    """Check that a parameter has one value per compartment, each within its register's range."""
    values: IntArray = getattr(group, name)
    where = f"compartments {group.name!r}"
    if values.shape != (group.size,):
        raise InputError(
            where, f"{name} has shape {values.shape}, not ({group.size},)", fix="Give one each."
        )
    wrong = np.flatnonzero(~domain.holds(values))
    if len(wrong):
        measured = f"{values[wrong[0]]} against {domain.low}..{domain.high}"
        raise TargetError(
            where, f"{name} of compartment {wrong[0]} is out of range", measured=measured, fix=fix
        )


def _check_voltage_limits(group: Compartments, chip: Chip) -> None:
    """Raise TargetError for a vmin or vmax that the chip cannot be set to: it stores only the exponent k of each."""
    rules = (
        ("vmin", loihi.voltage_minima(chip.registers), "1 - 2^k"),
        ("vmax", loihi.voltage_maxima(chip.registers), "2^(9 + 2k) - 1"),
    )
    for name, settings, formula in rules:
        for value in np.unique(getattr(group, name)).tolist():
            if value not in settings:
                nearest = min(settings, key=lambda setting: abs(setting - value))
                what = f"{name} {value} is not of the form {formula}"
                raise TargetError(
                    f"compartments {group.name!r}", what, fix=f"The nearest is {nearest}."
                )


def _check_synapses(graph: CompartmentGraph, synapses: Synapses, chip: Chip) -> None:
    """Check the ends of synapses first, then their weights and delays."""
    where = f"synapses {synapses.source!r} -> {synapses.target!r}"
    _check_ends(graph, synapses, where)
    _check_weights(synapses, chip, where)
    _check_delays(synapses, chip, where)


def _check_ends(graph: CompartmentGraph, synapses: Synapses, where: str) -> None:
    """Raise InputError if an end does not exist, the ends are in different phases, or arrays differ in length."""
    sizes = {node.name: node.size for node in graph.nodes}
    if synapses.target in {item.name for item in graph.inputs}:
        raise InputError(where, "an input takes no synapses", fix="Connect it the other way round.")
    if synapses.source not in sizes or synapses.target not in sizes:
        raise InputError(
            where, "it joins something that does not exist", fix="Add it before connecting."
        )
    if graph.phase_of(synapses.source) != graph.phase_of(synapses.target):
        raise InputError(where, "the ends are in different phases", fix="Connect within one phase.")
    for values, end in (
        (synapses.source_index, synapses.source),
        (synapses.target_index, synapses.target),
    ):
        if len(values) and (values.min() < 0 or values.max() >= sizes[end]):
            raise InputError(where, "an index is outside its group", fix="Correct the indices.")
    lengths = {len(getattr(synapses, f.name)) for f in fields(synapses) if f.type == IntArray}
    if len(lengths) != 1:
        raise InputError(
            where, "the synapse arrays differ in length", fix="Give one row per synapse."
        )


def _check_weights(synapses: Synapses, chip: Chip, where: str) -> None:
    """Raise TargetError for weights that no synapse of the chip can store."""
    grid = weight_grid(synapses.weight_bits, synapses.sign_mode)
    if synapses.weight_bits not in chip.registers.weight_bits:
        measured = f"{chip.name} has weight_bits_max {chip.registers.weight_bits_max}"
        fix = "Use narrower weights."
        raise TargetError(
            where,
            f"weights of {synapses.weight_bits} bits are too wide",
            measured=measured,
            fix=fix,
        )
    off_grid = np.flatnonzero(grid.off_grid(synapses.mantissa))
    if len(off_grid):
        kind = f"{grid.weight_bits}-bit {grid.sign_mode} weights"
        fix = "Round the weights onto the grid first."
        what = f"weight {synapses.mantissa[off_grid[0]]} is not on the grid of {kind}"
        all_weights = counted(len(synapses.mantissa), "weight")
        measured = f"multiples of {grid.step} in {grid.low}..{grid.high}; {len(off_grid)} of {all_weights} off"
        raise TargetError(where, what, measured=measured, fix=fix)
    exponents = loihi.EXPONENTS
    if not exponents.holds(synapses.exponent):
        measured = f"{synapses.exponent} against {exponents.low}..{exponents.high}"
        raise TargetError(
            where,
            "the weight exponent is out of range",
            measured=measured,
            fix="Rescale the weights.",
        )


def _check_delays(synapses: Synapses, chip: Chip, where: str) -> None:
    """Raise TargetError for delays that no synapse of the chip can store.

    The error says how many compartments, one after the other, would relay the longest delay.
    """
    delays = synapses.delay
    domain = loihi.domains(chip.registers)["delay"]
    longest_delay = domain.high
    outside = delays[~domain.holds(delays)]
    if len(outside):
        worst = int(outside[np.abs(outside).argmax()])
        all_delays = counted(len(delays), "delay")
        measured = (
            f"{worst} against 0..{longest_delay} steps; {len(outside)} of {all_delays} outside"
        )
        # Every synapse takes one step more than its delay. So k relays, which make k + 1 synapses, reach a total
        # delay of (k + 1) * (longest_delay + 1) - 1.
        relays = counted(worst // (longest_delay + 1), "compartment")
        fix = (
            f"Relay the spike through {relays}, or shorten the delay."
            if worst > 0
            else "Give 0 or more."
        )
        raise TargetError(where, "a delay is out of range", measured=measured, fix=fix)
