"""The rules that a program must obey before it is played, because compiled loops do not check indices.

The same rules hold for programs that the passes assemble and for programs from files.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import SIGN_MODES
from hw_model.description.chip import Chip, Registers
from hw_model.errors import InputError
from hw_model.mapping.check_graph import can_start
from hw_model.mapping.graph import AXES, Input
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import IntArray

MAX_STEPS, MAX_LINES = 10_000_000, 10_000_000
"""Largest number of steps of a phase, and of lines of an input: far more than a chip is used for."""
MAX_WEIGHT = 1e100
"""Largest magnitude of a readout's weight: scores and their bounds stay in float64."""
_OF_COMPARTMENTS = ("profile", "threshold", "bias_mantissa", "bias_exponent", "parent")
OF_SYNAPSES = ("target", "mantissa", "delay", "format_index")
_OF_OUTPUTS = ("out_compartment", "out_core", "out_axon")


def check_program(program: ChipProgram) -> None:
    """Check that tables agree in length, numbers fit their registers, indices are in range and limits hold.

    Raises ``InputError`` with the first place whose entries break a rule.
    """
    phases = [phase.name for phase in program.phases]
    streams = program.streams
    registers = program.chip.registers
    _check("phases", [
        ("names", len(set(phases)) == len(phases)),
        ("axes", all(phase.axis in AXES for phase in program.phases)),
        ("steps", all(phase.steps is None or _whole([phase.steps], 1, MAX_STEPS) for phase in program.phases)),
        ("starts", all(_whole([phase.align_events or 1], 1, MAX_LINES) for phase in program.phases)
         and all(can_start(phase, program.inputs) for phase in program.phases)),
    ])  # fmt: skip
    for index, core in enumerate(program.cores):
        _check(f"core {core.number}", _table_rules(index, core, phases, registers))
        _check(f"core {core.number}", _limit_rules(core, program.chip))
    for item, route in zip(program.inputs, program.input_routes, strict=True):
        steps = next((phase.steps for phase in program.phases if phase.name == item.phase), None)
        _check(f"input {item.name!r}", [
            ("sizes", _whole([item.size], 1, MAX_LINES)),
            ("phases", item.phase in phases),
            ("channels", item.channels == streams[item.stream]),
            ("positions", _within(item.visits[0], 0, (steps or MAX_STEPS) - 1)),
            ("first lines", _first_lines_fit(item)),
            ("routes", len(route.line) == len(route.core) == len(route.axon)),
            ("lines", _within(route.line, 0, item.size - 1)),
        ])  # fmt: skip
    _check_groups(program)
    _check_ways(program)


def _first_lines_fit(item: Input) -> bool:
    """Tell whether there is one line per channel, and channels of the same step do not share lines."""
    first, at = item.first_lines, item.positions
    fit = first is None or (
        at is not None and len(first) == len(at) and _within(first, 0, item.size - 1)
    )
    return fit and not item.lines_are_shared


def _table_rules(
    index: int, core: Core, phases: Sequence[str], registers: Registers
) -> list[tuple[str, bool]]:
    axons, count = core.axons, core.compartments
    domains = loihi.domains(registers)
    ends = np.cumsum([0, *(piece.stop - piece.start for piece in core.slices)]).tolist()
    return [
        ("phases", core.phase in phases),
        ("compartment tables", all(len(getattr(core, name)) == count for name in _OF_COMPARTMENTS)),
        ("synapse tables", len({len(getattr(axons, name)) for name in OF_SYNAPSES}) == 1),
        ("output tables", len({len(getattr(axons, name)) for name in _OF_OUTPUTS}) == 1),
        ("slices", [piece.offset for piece in core.slices] + [count] == ends and count > 0),
        ("slices' places", all(p.core == index and 0 <= p.start < p.stop for p in core.slices)),
        ("thresholds", _whole(core.thresholds, *domains["threshold"])),
        ("voltage limits", _whole([-core.vmin, core.vmax], 0, registers.voltage_max)),
        ("biases", _within(core.bias_mantissa, *domains["bias_mantissa"])),
        ("bias exponents", _within(core.bias_exponent, *domains["bias_exponent"])),
        ("weights", _within(axons.mantissa, *loihi.MANTISSAS)),
        ("decays", all(_whole([p.decay_u, p.decay_v], *loihi.DECAYS) for p in core.profiles)),
        ("refractory periods", all(_whole([p.refractory], *domains["refractory"]) for p in core.profiles)),
        ("joints", all(_whole([p.joined], 0, 1) for p in core.profiles)),
        ("formats", all(
            form.weight_bits in registers.weight_bits and form.sign_mode in SIGN_MODES
            and loihi.EXPONENTS.holds(form.exponent) and _whole([form.delay_bits, form.index_bits], 0, 64)
            for form in axons.formats
        )),
    ]  # fmt: skip


def _limit_rules(core: Core, chip: Chip) -> list[tuple[str, bool]]:
    """Rules about the limits of a core and the indices in its tables; children come before their parents."""
    limits, axons, count = chip.limits, core.axons, core.compartments
    starts = axons.list_start
    return [
        ("compartments", count <= limits.compartments_per_core),
        ("profiles", len(core.profiles) <= limits.compartment_profiles_per_core),
        ("thresholds", len(core.thresholds) <= limits.threshold_profiles_per_core),
        ("formats", len(axons.formats) <= limits.synapse_formats_per_core),
        ("input axons", axons.input_axons <= limits.input_axons_per_core),
        ("output axons", axons.output_axons <= limits.output_axons_per_core),
        ("synapse words", axons.synapse_words <= limits.synapse_words_per_core),
        ("profile indices", _within(core.profile, 0, len(core.profiles) - 1)),
        ("threshold indices", _within(core.threshold, 0, len(core.thresholds) - 1)),
        ("parents", bool(((core.parent == -1) | (core.parent > np.arange(count))).all())),
        ("parents' range", _within(core.parent, -1, count - 1)),
        ("list starts", bool((np.diff(starts) >= 0).all())),
        ("list ends", len(starts) > 0 and starts[-1] == len(axons.target)),
        ("list begins", len(starts) > 0 and starts[0] == 0),
        ("targets", _within(axons.target, 0, count - 1)),
        ("format indices", _within(axons.format_index, 0, len(axons.formats) - 1)),
        ("delays", _within(axons.delay, *loihi.domains(chip.registers)["delay"])),
        ("senders", _within(axons.out_compartment, 0, count - 1)),
    ]


def _check_ways(program: ChipProgram) -> None:
    """Check that every core has its own place on the board, and every input axon one sender, in its core's phase."""
    slots = [core.slot for core in program.cores]
    _check(
        "cores",
        [("slots", len(set(slots)) == len(slots) and _whole(slots, 0, program.chip.cores - 1))],
    )
    input_axons = np.array([core.axons.input_axons for core in program.cores], dtype=np.int64)
    begin = np.cumsum([0, *input_axons])
    phases = [phase.name for phase in program.phases]
    phase_of = np.array([phases.index(core.phase) for core in program.cores], dtype=np.int64)
    ways = [
        (f"core {core.number}", core.phase, core.axons.out_core, core.axons.out_axon)
        for core in program.cores
    ]
    for item, route in zip(program.inputs, program.input_routes, strict=True):
        ways.append((f"input {route.input!r}", item.phase, route.core, route.axon))
    senders = np.zeros(begin[-1], dtype=np.int64)
    for where, phase, core, axon in ways:
        exists = _within(core, 0, len(input_axons) - 1) and bool(
            ((axon >= 0) & (axon < input_axons[core])).all()
        )
        _check(
            where,
            [("destinations", exists and bool((phase_of[core] == phases.index(phase)).all()))],
        )
        np.add.at(senders, begin[core] + axon, 1)
    for there, many in zip(program.cores, np.split(senders, begin[1:-1]), strict=True):
        _check(f"core {there.number}", [("input axons", bool((many == 1).all()))])


def _check_groups(program: ChipProgram) -> None:
    """Check that slices cover every group once, in one phase, and that the readout's populations are of one size."""
    pieces: dict[str, list[tuple[int, int, str]]] = {}
    for core in program.cores:
        for piece in core.slices:
            pieces.setdefault(piece.group, []).append((piece.start, piece.stop, core.phase))
    for name, found in pieces.items():
        found.sort()
        starts, stops = [start for start, *_ in found], [stop for _, stop, _ in found]
        one_phase = len({phase for *_, phase in found}) == 1
        _check(
            f"compartments {name!r}",
            [("slices", starts == [0, *stops[:-1]]), ("phases", one_phase)],
        )
    if program.readout is not None:
        sizes = {program.populations.get(name) for name in program.readout.populations}
        small = all(abs(weight) <= MAX_WEIGHT for weight in program.readout.weights)
        _check(
            "readout", [("populations", len(sizes) == 1 and None not in sizes), ("weights", small)]
        )
        tie_class = program.readout.tie_class
        classes = program.populations[program.readout.populations[0]]
        _check("readout", [("class for ties", tie_class is None or 0 <= tie_class < classes)])


def _check(where: str, rules: Iterable[tuple[str, bool]]) -> None:
    for what, holds in rules:
        if not holds:
            raise InputError(where, f"its {what} do not make a program", fix="Compile it again.")


def _within(values: IntArray, low: int, high: int) -> bool:
    return bool(((values >= low) & (values <= high)).all())


def _whole(values: Iterable[object], low: int, high: int) -> bool:
    return all(
        isinstance(value, int) and not isinstance(value, bool) and low <= value <= high
        for value in values
    )
