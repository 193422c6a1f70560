"""The rules that a program must obey before it is played, because compiled loops do not check indices.

The same rules hold for programs that the passes assemble and for programs from files.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import SIGN_MODES
from hw_model.description.chip import Chip, Registers
from hw_model.errors import InputError
from hw_model.mapping.check_graph import can_start
from hw_model.mapping.fan_in import SynapseFormat
from hw_model.mapping.graph import AXES, MAX_LINES, MAX_STEPS, Input
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import IntArray

MAX_WEIGHT = 1e100
"""Largest magnitude of a readout's weight: scores and their bounds stay in float64."""
MAX_FIELD_BITS = 64
"""Widest field of a synapse format."""
_OF_COMPARTMENTS = ("profile", "threshold", "bias_mantissa", "bias_exponent", "parent")
OF_SYNAPSES = ("target", "mantissa", "delay", "format_index")
_OF_OUTPUTS = ("out_compartment", "out_core", "out_axon")


class Rule(NamedTuple):
    """What of a program must be right, as the message names it, and whether it is."""

    subject: str
    holds: bool


class Sender(NamedTuple):
    """What sends spikes to input axons of cores: a core or an input."""

    where: str
    phase: str
    core: IntArray
    axon: IntArray


def check_program(program: ChipProgram) -> None:
    """Check that tables agree in length, numbers fit their registers, indices are in range and limits hold.

    Raises ``InputError`` with the first place whose entries break a rule.
    """
    _check("phases", _phase_rules(program))
    # Rules about indices and limits rely on tables that agree in length.
    for index, core in enumerate(program.cores):
        where = f"core {core.number}"
        _check(where, _table_rules(index, core, program))
        _check(where, _limit_rules(core, program.chip))
    _check_inputs(program)
    _check_groups(program)
    _check_readout(program)
    _check("cores", _slot_rules(program))
    _check_destinations(program)


def _phase_rules(program: ChipProgram) -> list[Rule]:
    phases = program.phases
    steps = [phase.steps for phase in phases if phase.steps is not None]
    starts = [phase.align_events or 1 for phase in phases]
    # Files may hold anything: only whole numbers are compared with others.
    can_start_all = _whole(starts, 1, MAX_LINES) and all(
        can_start(phase, program.inputs) for phase in phases
    )
    return [
        Rule("names", len({phase.name for phase in phases}) == len(phases)),
        Rule("axes", all(phase.axis in AXES for phase in phases)),
        Rule("steps", _whole(steps, 1, MAX_STEPS)),
        Rule("starts", can_start_all),
    ]


def _table_rules(index: int, core: Core, program: ChipProgram) -> list[Rule]:
    """Return the rules about tables of a core: their lengths, and the numbers in them."""
    phases = [phase.name for phase in program.phases]
    return [
        Rule("phases", core.phase in phases),
        *_length_rules(index, core),
        *_number_rules(core, program.chip.registers),
    ]


def _length_rules(index: int, core: Core) -> list[Rule]:
    count = core.compartments
    sizes = [piece.stop - piece.start for piece in core.slices]
    ends = np.cumsum([0, *sizes]).tolist()
    offsets = [piece.offset for piece in core.slices]
    places = all(piece.core == index and 0 <= piece.start < piece.stop for piece in core.slices)
    of_compartments = _lengths(core, _OF_COMPARTMENTS)
    return [
        Rule("compartment tables", of_compartments == {count}),
        Rule("synapse tables", len(_lengths(core.axons, OF_SYNAPSES)) == 1),
        Rule("output tables", len(_lengths(core.axons, _OF_OUTPUTS)) == 1),
        Rule("slices", [*offsets, count] == ends and count > 0),
        Rule("slices' places", places),
    ]


def _lengths(tables: object, names: Iterable[str]) -> set[int]:
    return {len(getattr(tables, name)) for name in names}


def _number_rules(core: Core, registers: Registers) -> list[Rule]:
    domains = loihi.domains(registers)
    profiles = core.profiles
    decays = [decay for profile in profiles for decay in (profile.decay_u, profile.decay_v)]
    refractory = [profile.refractory for profile in profiles]
    joined = [profile.joined for profile in profiles]
    formats = all(_format_exists(form, registers) for form in core.axons.formats)
    return [
        Rule("thresholds", _whole(core.thresholds, *domains["threshold"])),
        Rule("voltage limits", _whole([-core.vmin, core.vmax], 0, registers.voltage_max)),
        Rule("biases", _within(core.bias_mantissa, *domains["bias_mantissa"])),
        Rule("bias exponents", _within(core.bias_exponent, *domains["bias_exponent"])),
        Rule("weights", _within(core.axons.mantissa, *loihi.MANTISSAS)),
        Rule("decays", _whole(decays, *loihi.DECAYS)),
        Rule("refractory periods", _whole(refractory, *domains["refractory"])),
        Rule("joints", _whole(joined, 0, 1)),
        Rule("formats", formats),
    ]


def _format_exists(form: SynapseFormat, registers: Registers) -> bool:
    if form.weight_bits not in registers.weight_bits or form.sign_mode not in SIGN_MODES:
        return False
    if not loihi.EXPONENTS.holds(form.exponent):
        return False
    return _whole([form.delay_bits, form.index_bits], 0, MAX_FIELD_BITS)


def _limit_rules(core: Core, chip: Chip) -> list[Rule]:
    """Return the rules about the limits of a core and the indices in its tables.

    Children come before their parents.
    """
    limits = chip.limits
    axons = core.axons
    count = core.compartments
    starts = axons.list_start
    comes_later = core.parent > np.arange(count)
    has_none = core.parent == -1
    return [
        Rule("compartments", count <= limits.compartments_per_core),
        Rule("profiles", len(core.profiles) <= limits.compartment_profiles_per_core),
        Rule("thresholds", len(core.thresholds) <= limits.threshold_profiles_per_core),
        Rule("formats", len(axons.formats) <= limits.synapse_formats_per_core),
        Rule("input axons", axons.input_axons <= limits.input_axons_per_core),
        Rule("output axons", axons.output_axons <= limits.output_axons_per_core),
        Rule("synapse words", axons.synapse_words <= limits.synapse_words_per_core),
        Rule("profile indices", _within(core.profile, 0, len(core.profiles) - 1)),
        Rule("threshold indices", _within(core.threshold, 0, len(core.thresholds) - 1)),
        Rule("parents", bool((has_none | comes_later).all())),
        Rule("parents' range", _within(core.parent, -1, count - 1)),
        Rule("list starts", bool((np.diff(starts) >= 0).all())),
        Rule("list ends", len(starts) > 0 and starts[-1] == len(axons.target)),
        Rule("list begins", len(starts) > 0 and starts[0] == 0),
        Rule("targets", _within(axons.target, 0, count - 1)),
        Rule("format indices", _within(axons.format_index, 0, len(axons.formats) - 1)),
        Rule("delays", _within(axons.delay, *loihi.domains(chip.registers)["delay"])),
        Rule("senders", _within(axons.out_compartment, 0, count - 1)),
    ]


def _check_inputs(program: ChipProgram) -> None:
    streams = program.streams
    steps_of = {phase.name: phase.steps or MAX_STEPS for phase in program.phases}
    for item, route in zip(program.inputs, program.input_routes, strict=True):
        last_step = steps_of.get(item.phase, MAX_STEPS) - 1
        rules = [
            Rule("sizes", _whole([item.size], 1, MAX_LINES)),
            Rule("phases", item.phase in steps_of),
            Rule("channels", item.channels == streams[item.stream]),
            Rule("positions", _within(item.visits[0], 0, last_step)),
            Rule("first lines", _first_lines_fit(item)),
            Rule("routes", len(route.line) == len(route.core) == len(route.axon)),
            Rule("lines", _within(route.line, 0, item.size - 1)),
        ]
        _check(f"input {item.name!r}", rules)


def _first_lines_fit(item: Input) -> bool:
    """Tell whether there is one line per channel, and channels of the same step do not share lines."""
    first_lines = item.first_lines
    positions = item.positions
    if first_lines is not None:
        if positions is None or len(first_lines) != len(positions):
            return False
        if not _within(first_lines, 0, item.size - 1):
            return False
    return not item.lines_are_shared


def _check_groups(program: ChipProgram) -> None:
    """Check that slices cover every group once, in one phase."""
    slices_of_group: dict[str, list[tuple[int, int]]] = {}
    phases_of_group: dict[str, set[str]] = {}
    for core in program.cores:
        for piece in core.slices:
            slices_of_group.setdefault(piece.group, []).append((piece.start, piece.stop))
            phases_of_group.setdefault(piece.group, set()).add(core.phase)
    for name, slices in slices_of_group.items():
        slices.sort()
        starts = [start for start, _ in slices]
        stops = [stop for _, stop in slices]
        rules = [
            Rule("slices", starts == [0, *stops[:-1]]),
            Rule("phases", len(phases_of_group[name]) == 1),
        ]
        _check(f"compartments {name!r}", rules)


def _check_readout(program: ChipProgram) -> None:
    """Check that its populations are there and of one size, a class for each neuron."""
    readout = program.readout
    if readout is None:
        return
    sizes = {program.populations.get(name) for name in readout.populations}
    populations = len(sizes) == 1 and None not in sizes
    weights = all(abs(weight) <= MAX_WEIGHT for weight in readout.weights)
    _check("readout", [Rule("populations", populations), Rule("weights", weights)])
    classes = program.populations[readout.populations[0]]
    tie_class = readout.tie_class
    exists = tie_class is None or 0 <= tie_class < classes
    _check("readout", [Rule("class for ties", exists)])


def _slot_rules(program: ChipProgram) -> list[Rule]:
    """Return the rule that every core has its own place on the board."""
    slots = [core.slot for core in program.cores]
    are_apart = len(set(slots)) == len(slots)
    are_on_board = _whole(slots, 0, program.chip.cores - 1)
    return [Rule("slots", are_apart and are_on_board)]


def _check_destinations(program: ChipProgram) -> None:
    """Check that spikes go to axons that exist, in the sender's phase, and that every axon has one sender."""
    cores = program.cores
    input_axons = np.array([core.axons.input_axons for core in cores], dtype=np.int64)
    begin = np.cumsum([0, *input_axons])
    phases = np.array([core.phase for core in cores], dtype=object)
    senders_of_axon = np.zeros(begin[-1], dtype=np.int64)
    for sender in _senders(program):
        is_right = _exists(sender, input_axons) and bool(
            (phases[sender.core] == sender.phase).all()
        )
        _check(sender.where, [Rule("destinations", is_right)])
        np.add.at(senders_of_axon, begin[sender.core] + sender.axon, 1)
    for core, senders in zip(cores, np.split(senders_of_axon, begin[1:-1]), strict=True):
        _check(f"core {core.number}", [Rule("input axons", bool((senders == 1).all()))])


def _senders(program: ChipProgram) -> Iterator[Sender]:
    for core in program.cores:
        axons = core.axons
        yield Sender(f"core {core.number}", core.phase, axons.out_core, axons.out_axon)
    for item, route in zip(program.inputs, program.input_routes, strict=True):
        yield Sender(f"input {route.input!r}", item.phase, route.core, route.axon)


def _exists(sender: Sender, input_axons: IntArray) -> bool:
    """Tell whether cores have the axons that it sends to; ``input_axons`` (cores,) is how many they have."""
    if not _within(sender.core, 0, len(input_axons) - 1):
        return False
    axon = sender.axon
    return bool(((axon >= 0) & (axon < input_axons[sender.core])).all())


def _check(where: str, rules: Iterable[Rule]) -> None:
    """Raise an ``InputError`` for the first rule that does not hold."""
    for rule in rules:
        if not rule.holds:
            what = f"its {rule.subject} do not make a program"
            raise InputError(where, what, fix="Compile it again.")


def _within(values: IntArray, low: int, high: int) -> bool:
    """Tell whether all numbers of an array lie between two ends, or at one of them."""
    return bool(((values >= low) & (values <= high)).all())


def _whole(values: Iterable[object], low: int, high: int) -> bool:
    """Tell whether all values are integers of Python between two ends, or at one of them."""
    return all(
        isinstance(value, int) and not isinstance(value, bool) and low <= value <= high
        for value in values
    )
