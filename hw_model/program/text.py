"""Every level of the chip side as stable text, for people to read and for golden tests to compare.

Small arrays are written out. Large ones are shown by their range and a digest, so any change of a value shows.
"""

import hashlib
from collections.abc import Iterator

import numpy as np

from hw_model.mapping.fan_in import SynapseFormat
from hw_model.mapping.graph import CompartmentGraph, Compartments, Input, Synapses
from hw_model.mapping.placement import PlacedGraph
from hw_model.mapping.routing import RoutedCore, RoutedGraph
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import AnyArray

WRITTEN_OUT = 16
"""Largest number of values of an array that is written out."""


def array_text(array: AnyArray) -> str:
    """Return the one value of a constant array, the values of a small array, or else range and digest."""
    values = np.asarray(array)
    if values.size == 0:
        return "none"
    if (values == values.flat[0]).all():
        return f"{values.flat[0]}"
    if values.size <= WRITTEN_OUT:
        return " ".join(map(str, values.ravel().tolist()))
    content = np.ascontiguousarray(values, np.int64 if values.dtype.kind == "i" else None).tobytes()
    return f"{values.min()}..{values.max()} #{hashlib.sha256(content).hexdigest()[:12]}"


def compartments_text(graph: CompartmentGraph) -> str:
    """Return the text of a CompartmentGraph."""

    def lines() -> Iterator[str]:
        yield f"compartments {graph.name}"
        for phase in graph.phases:
            late = "" if phase.align_events is None else f", from the first with {phase.align_events} or more events on"
            steps = phase.steps if phase.steps is not None else "any"
            yield f"  phase {phase.name}: {steps} steps of {phase.axis}{late}"
        yield from (_input(item) for item in graph.inputs)
        yield from (_group(group) for group in graph.groups)
        yield from (_synapses(synapses) for synapses in graph.synapses)
        if graph.readout is not None:
            first = graph.readout.from_step
            what = {name: f"largest potential, from step {step} on," for name, step in first.items()}
            terms = (f"{weight:g} * {what.get(name, 'spikes')} of {name}" for name, weight in graph.readout.terms)
            yield "  readout: " + " + ".join(terms)
        yield f"  synapses pruned: {graph.synapses_pruned}"

    return "\n".join(lines()) + "\n"


def placed_text(placed: PlacedGraph) -> str:
    """Return the text of a PlacedGraph: the slices of every core."""
    lines = [f"placed {placed.graph.name} on {placed.chip.name}: {placed.cores} cores"]
    lines += [
        f"  core {s.core}: {s.group}[{s.start}:{s.stop}] at {s.offset}"
        for s in sorted(placed.slices, key=lambda s: s.core)
    ]
    return "\n".join(lines) + "\n"


def routed_text(routed: RoutedGraph) -> str:
    """Return the text of a RoutedGraph: axons and synapse lists of every core."""
    lines = [f"routed {routed.placed.graph.name}"]
    for route in routed.input_routes:
        lines.append(f"  input {route.input}: {len(route.line)} axons to cores {array_text(np.unique(route.core))}")
    for core in routed.cores:
        lines += _axons(core)
    return "\n".join(lines) + "\n"


def program_text(program: ChipProgram) -> str:
    """Return the text of a ChipProgram: tables of every core."""
    lines = [f"program {program.name} for {program.chip.name}"]
    lines += [f"  {key}: {value}" for key, value in program.provenance.items()]
    for core in program.cores:
        lines += _core(core)
        lines += _axons(core)
    return "\n".join(lines) + "\n"


def _input(item: Input) -> str:
    played = "as it comes" if item.positions is None else f"transposed, positions {array_text(item.positions)}"
    if item.first_lines is not None:
        played += f", first lines {array_text(item.first_lines)}"
    return f"  input {item.name}: {item.size} lines, phase {item.phase}, plays {item.stream} {played}"


def _group(g: Compartments) -> str:
    kind = f"joined to {g.joined_to}" if g.joined_to else f"threshold {array_text(g.threshold)}"
    parts = [f"  group {g.name}: {g.size}, phase {g.phase}, decay_u {array_text(g.decay_u)}"]
    parts += [f"decay_v {array_text(g.decay_v)}", kind]
    if g.bias_mantissa.any():
        parts.append(f"bias {array_text(g.bias_mantissa)} * 2^{array_text(g.bias_exponent)}")
    if (g.refractory != 1).any():
        parts.append(f"refractory {array_text(g.refractory)}")
    return ", ".join(parts)


def _synapses(s: Synapses) -> str:
    return (
        f"  synapses {s.source} -> {s.target}: {len(s.mantissa)}, {s.weight_bits}-bit {s.sign_mode}, "
        f"exponent {s.exponent}, delay {array_text(s.delay)}, mantissa {array_text(s.mantissa)}, "
        f"from {array_text(s.source_index)}, to {array_text(s.target_index)}"
    )


def _format(form: SynapseFormat) -> str:
    kind = f"{form.index_bits} index bits" if form.index_bits else "dense"
    return f"{form.weight_bits}-bit {form.sign_mode} exponent {form.exponent} ({form.delay_bits} delay bits, {kind})"


def _axons(core: RoutedCore | Core) -> Iterator[str]:
    a = core.axons
    yield f"  core {core.number} (phase {core.phase}): {a.input_axons} input axons, {a.output_axons} output axons"
    for form in a.formats:
        yield f"    format {_format(form)}"
    yield f"    synapses: {len(a.target)} in {a.synapse_words} words, target {array_text(a.target)}"
    yield f"    mantissa {array_text(a.mantissa)}, delay {array_text(a.delay)}, lists at {array_text(a.list_start)}"
    yield f"    from {array_text(a.out_compartment)} to core {array_text(a.out_core)} axon {array_text(a.out_axon)}"


def _core(core: Core) -> Iterator[str]:
    yield f"  core {core.number} (slot {core.slot}, phase {core.phase}): {core.compartments} compartments"
    yield f"    v in {core.vmin}..{core.vmax}"
    for piece in core.slices:
        yield f"    {piece.group}[{piece.start}:{piece.stop}] at {piece.offset}"
    for p in core.profiles:
        kind = ", joined" if p.joined else ""
        yield f"    profile decay_u {p.decay_u}, decay_v {p.decay_v}, refractory {p.refractory}{kind}"
    yield f"    threshold mantissas {' '.join(map(str, core.thresholds))}"
    yield f"    profile of {array_text(core.profile)}, threshold of {array_text(core.threshold)}"
    yield f"    parent of {array_text(core.parent)}, bias {array_text(core.bias)}"
