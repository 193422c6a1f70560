"""Every level of the chip side as stable text, for people to read and for golden tests to compare.

Small arrays are written out in full. A large array is shown by its range and a digest, so that the text changes if any
value does. Functions with an underscore return the lines of one entry.
"""

import hashlib
from collections.abc import Iterable, Mapping

import numpy as np

from hw_model.mapping.fan_in import SynapseFormat
from hw_model.mapping.graph import CompartmentGraph, Compartments, Input, Phase, Readout, Synapses
from hw_model.mapping.placement import PlacedGraph, Slice
from hw_model.mapping.routing import InputRoute, RoutedCore, RoutedGraph
from hw_model.program.chip_program import ChipProgram, CompartmentProfile, Core
from hw_model.values import AnyArray

WRITTEN_OUT = 16
"""The most values of an array that is written out in full. Chosen by hand: they fit a line."""


def array_text(array: AnyArray) -> str:
    """Return an array as text: the value of a constant array, all values of a small array, else range and digest."""
    values = np.asarray(array)
    if values.size == 0:
        return "none"
    if (values == values.flat[0]).all():
        return f"{values.flat[0]}"
    if values.size <= WRITTEN_OUT:
        return " ".join(map(str, values.ravel().tolist()))
    # Integers are hashed as int64, so that the digest does not depend on the width that they are stored in.
    hashed_type = np.int64 if values.dtype.kind == "i" else None
    content = np.ascontiguousarray(values, hashed_type).tobytes()
    return f"{values.min()}..{values.max()} #{hashlib.sha256(content).hexdigest()[:12]}"


def ended(lines: Iterable[str]) -> str:
    """Return lines as a text, each ended by a line feed."""
    return "".join(f"{line}\n" for line in lines)


def compartments_text(graph: CompartmentGraph) -> str:
    """Return the text of a CompartmentGraph."""
    readout = [] if graph.readout is None else [f"  readout: {_readout(graph.readout)}"]
    return ended(
        [
            f"compartments {graph.name}",
            *(_phase(phase) for phase in graph.phases),
            *(_input(item) for item in graph.inputs),
            *(_group(group) for group in graph.groups),
            *(_synapses(synapses) for synapses in graph.synapses),
            *readout,
            f"  synapses pruned: {graph.synapses_pruned}",
        ]
    )


def placed_text(placed: PlacedGraph) -> str:
    """Return the text of a PlacedGraph: the slices of every core."""
    by_core = sorted(placed.slices, key=lambda piece: piece.core)
    return ended(
        [
            f"placed {placed.graph.name} on {placed.chip.name}: {placed.cores} cores",
            *(f"  core {piece.core}: {_slice(piece)}" for piece in by_core),
        ]
    )


def routed_text(routed: RoutedGraph) -> str:
    """Return the text of a RoutedGraph: axons and synapse lists of every core."""
    lines = [f"routed {routed.placed.graph.name}"]
    lines += [_input_route(route) for route in routed.input_routes]
    for core in routed.cores:
        lines += _axons(core)
    return ended(lines)


def program_text(program: ChipProgram) -> str:
    """Return the text of a ChipProgram: the tables of every core."""
    lines = program_heading(program.name, program.chip.name, program.provenance)
    for core in program.cores:
        lines += _core(core)
    return ended(lines)


def program_heading(name: str, chip: str, provenance: Mapping[str, str]) -> list[str]:
    """Return the first lines of a program's text, for chips of any kind: its name, its chip and its provenance."""
    return [
        f"program {name} for {chip}",
        *(f"  {key}: {value}" for key, value in provenance.items()),
    ]


def _phase(phase: Phase) -> str:
    steps = "any" if phase.steps is None else phase.steps
    start = ""
    if phase.align_events is not None:
        start = f", from the first with {phase.align_events} or more events on"
    return f"  phase {phase.name}: {steps} steps of {phase.axis}{start}"


def _input(item: Input) -> str:
    order = "as it comes"
    if item.positions is not None:
        order = f"transposed, positions {array_text(item.positions)}"
    first_lines = ""
    if item.first_lines is not None:
        first_lines = f", first lines {array_text(item.first_lines)}"
    return (
        f"  input {item.name}: {item.size} lines, phase {item.phase}, "
        f"plays {item.stream} {order}{first_lines}"
    )


def _group(group: Compartments) -> str:
    """Return the line of a group; the defaults, a bias of 0 and a refractory count of 1, are left out."""
    text = (
        f"  group {group.name}: {group.size}, phase {group.phase}, "
        f"decay_u {array_text(group.decay_u)}, decay_v {array_text(group.decay_v)}"
    )
    if group.joined_to is not None:
        text += f", joined to {group.joined_to}"
    else:
        text += f", threshold {array_text(group.threshold)}"
    if group.bias_mantissa.any():
        exponent = array_text(group.bias_exponent)
        text += f", bias {array_text(group.bias_mantissa)} * 2^{exponent}"
    if (group.refractory != 1).any():
        text += f", refractory {array_text(group.refractory)}"
    return text


def _synapses(synapses: Synapses) -> str:
    return (
        f"  synapses {synapses.source} -> {synapses.target}: {len(synapses.mantissa)}, "
        f"{synapses.weight_bits}-bit {synapses.sign_mode}, exponent {synapses.exponent}, "
        f"delay {array_text(synapses.delay)}, mantissa {array_text(synapses.mantissa)}, "
        f"from {array_text(synapses.source_index)}, to {array_text(synapses.target_index)}"
    )


def _readout(readout: Readout) -> str:
    """Return the formula of the class scores."""
    reading_of = {
        name: f"largest potential, from step {step} on," for name, step in readout.from_step.items()
    }
    terms = " + ".join(
        f"{weight:g} * {reading_of.get(name, 'spikes')} of {name}" for name, weight in readout.terms
    )
    return terms if readout.tie_class is None else f"{terms}; ties predict {readout.tie_class}"


def _slice(piece: Slice) -> str:
    return f"{piece.group}[{piece.start}:{piece.stop}] at {piece.offset}"


def _input_route(route: InputRoute) -> str:
    cores = array_text(np.unique(route.core))
    return f"  input {route.input}: {len(route.line)} axons to cores {cores}"


def _core(core: Core) -> list[str]:
    """Return the lines of a core: its voltage limits, slices, tables and axons."""
    return [
        f"  core {core.number} (slot {core.slot}, phase {core.phase}): "
        f"{core.compartments} compartments",
        f"    v in {core.vmin}..{core.vmax}",
        *(f"    {_slice(piece)}" for piece in core.slices),
        *(_profile(profile) for profile in core.profiles),
        f"    threshold mantissas {' '.join(map(str, core.thresholds))}",
        f"    profile of {array_text(core.profile)}, threshold of {array_text(core.threshold)}",
        f"    parent of {array_text(core.parent)}, bias {array_text(core.bias)}",
        *_axons(core),
    ]


def _profile(profile: CompartmentProfile) -> str:
    joined = ", joined" if profile.joined else ""
    return (
        f"    profile decay_u {profile.decay_u}, decay_v {profile.decay_v}, "
        f"refractory {profile.refractory}{joined}"
    )


def _axons(core: RoutedCore | Core) -> list[str]:
    """Return the lines of a core's axons and synapse lists."""
    axons = core.axons
    return [
        f"  core {core.number} (phase {core.phase}): "
        f"{axons.input_axons} input axons, {axons.output_axons} output axons",
        *(_format(synapse_format) for synapse_format in axons.formats),
        f"    synapses: {len(axons.target)} in {axons.synapse_words} words, "
        f"target {array_text(axons.target)}",
        f"    mantissa {array_text(axons.mantissa)}, delay {array_text(axons.delay)}, "
        f"lists at {array_text(axons.list_start)}",
        f"    from {array_text(axons.out_compartment)} to core {array_text(axons.out_core)} "
        f"axon {array_text(axons.out_axon)}",
    ]


def _format(synapse_format: SynapseFormat) -> str:
    index_bits = synapse_format.index_bits
    index = f"{index_bits} index bits" if index_bits else "dense"
    return (
        f"    format {synapse_format.weight_bits}-bit {synapse_format.sign_mode} "
        f"exponent {synapse_format.exponent} ({synapse_format.delay_bits} delay bits, {index})"
    )
