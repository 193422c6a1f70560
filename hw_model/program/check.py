"""Check a whole program before it is played.

The engines' compiled loops do not check indices: a wrong index in a table would read or write foreign memory. So every
program is checked once, whether the compiler has just assembled it or a file was read, which may be damaged or hostile.
Rules are rows of tables; the first rule that does not hold is an ``InputError`` with the place and the subject. Since a
program that breaks a rule was not made by the compiler, the message is short.
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
"""The largest magnitude of a readout's weight. Chosen by hand, so that no score overflows float64 (1.8e308)."""
MAX_FIELD_BITS = 64
"""The widest field of a synapse format. Chosen by hand: no field of a chip comes near."""
# The arrays of Core and AxonTables that must have equal lengths.
_OF_COMPARTMENTS = ("profile", "threshold", "bias_mantissa", "bias_exponent", "parent")
OF_SYNAPSES = ("target", "mantissa", "delay", "format_index")
_OF_OUTPUTS = ("out_compartment", "out_core", "out_axon")


class Rule(NamedTuple):
    """A condition that a program must meet: the ``subject`` that an error names, and whether the condition holds."""

    subject: str
    holds: bool


class Sender(NamedTuple):
    """A core or an input, with the input axons that it sends spikes to: ``axon[i]`` of ``core[i]``."""

    where: str
    phase: str
    core: IntArray
    axon: IntArray


def check_program(program: ChipProgram) -> None:
    """Check that tables agree in length, numbers fit their registers, indices are in range and limits hold.

    Raises ``InputError`` with the first place whose entries break a rule.
    """
    # Every check relies on those before it: cores name phases, and inputs and readouts name groups on cores.
    _check("phases", _phase_rules(program))
    for index, core in enumerate(program.cores):
        where = f"core {core.number}"
        # All rules of a table are computed before the first is reported. Rules about indices and limits compare arrays
        # element by element, so the lengths of the arrays must have been checked before.
        _check(where, _table_rules(index, core, program))
        _check(where, _limit_rules(core, program.chip))
    _check_inputs(program)
    _check_groups(program)
    _check_readout(program)
    _check("cores", _slot_rules(program))
    _check_destinations(program)


def _phase_rules(program: ChipProgram) -> list[Rule]:
    """Return the rules about the program's phases."""
    phases = program.phases
    steps = [phase.steps for phase in phases if phase.steps is not None]
    align_events = [phase.align_events for phase in phases if phase.align_events]
    # `can_start` compares numbers, but a file may hold anything here: check that they are integers first.
    can_start_all = _are_integers_within(align_events, 1, MAX_LINES) and all(
        can_start(phase, program.inputs) for phase in phases
    )
    return [
        Rule("names", len({phase.name for phase in phases}) == len(phases)),
        Rule("axes", all(phase.axis in AXES for phase in phases)),
        Rule("steps", _are_integers_within(steps, 1, MAX_STEPS)),
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
    """Return the rules that tables agree in length, and that slices cover the compartments without gaps."""
    count = core.compartments
    sizes = [piece.stop - piece.start for piece in core.slices]
    # Each slice begins where the one before it ends, and the last one ends with the core's last compartment.
    ends = np.cumsum([0, *sizes]).tolist()
    offsets = [piece.offset for piece in core.slices]
    have_places = all(
        piece.core == index and 0 <= piece.start < piece.stop for piece in core.slices
    )
    compartment_lengths = _distinct_lengths(core, _OF_COMPARTMENTS)
    return [
        Rule("compartment tables", compartment_lengths == {count}),
        Rule("synapse tables", len(_distinct_lengths(core.axons, OF_SYNAPSES)) == 1),
        Rule("output tables", len(_distinct_lengths(core.axons, _OF_OUTPUTS)) == 1),
        Rule("slices", [*offsets, count] == ends and count > 0),
        Rule("slices' places", have_places),
    ]


def _distinct_lengths(tables: object, names: Iterable[str]) -> set[int]:
    """Return the lengths that occur among the named arrays."""
    return {len(getattr(tables, name)) for name in names}


def _number_rules(core: Core, registers: Registers) -> list[Rule]:
    """Return the rules that every number fits the register or field that holds it."""
    domains = loihi.domains(registers)
    profiles = core.profiles
    decays = [decay for profile in profiles for decay in (profile.decay_u, profile.decay_v)]
    refractory = [profile.refractory for profile in profiles]
    joined = [profile.joined for profile in profiles]
    formats = all(_format_exists(form, registers) for form in core.axons.formats)
    # vmin is 0 or less, vmax 0 or more, each within the voltage register.
    voltage_limits = [-core.vmin, core.vmax]
    return [
        Rule("thresholds", _are_integers_within(core.thresholds, *domains["threshold"])),
        Rule("voltage limits", _are_integers_within(voltage_limits, 0, registers.voltage_max)),
        Rule("biases", _within(core.bias_mantissa, *domains["bias_mantissa"])),
        Rule("bias exponents", _within(core.bias_exponent, *domains["bias_exponent"])),
        Rule("weights", _within(core.axons.mantissa, *loihi.MANTISSAS)),
        Rule("decays", _are_integers_within(decays, *loihi.DECAYS)),
        Rule("refractory periods", _are_integers_within(refractory, *domains["refractory"])),
        Rule("joints", _are_integers_within(joined, low=0, high=1)),
        Rule("formats", formats),
    ]


def _format_exists(form: SynapseFormat, registers: Registers) -> bool:
    """Return whether the chip has such a synapse format."""
    if form.weight_bits not in registers.weight_bits or form.sign_mode not in SIGN_MODES:
        return False
    if not loihi.EXPONENTS.holds(form.exponent):
        return False
    return _are_integers_within([form.delay_bits, form.index_bits], 0, MAX_FIELD_BITS)


def _limit_rules(core: Core, chip: Chip) -> list[Rule]:
    """Return the rules about the limits of a core and the indices in its tables."""
    limits = chip.limits
    axons = core.axons
    count = core.compartments
    starts = axons.list_start
    # A step updates compartments in order: a child must have its voltage before its parent adds it.
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
        # A core with n input axons has n + 1 list starts, so at least one, even without axons.
        Rule("list ends", len(starts) > 0 and starts[-1] == len(axons.target)),
        Rule("list begins", len(starts) > 0 and starts[0] == 0),
        Rule("targets", _within(axons.target, 0, count - 1)),
        Rule("format indices", _within(axons.format_index, 0, len(axons.formats) - 1)),
        Rule("delays", _within(axons.delay, *loihi.domains(chip.registers)["delay"])),
        Rule("senders", _within(axons.out_compartment, 0, count - 1)),
    ]


def _check_inputs(program: ChipProgram) -> None:
    """Check the inputs' phases, lines, visits and routes."""
    streams = program.streams
    # A phase without a number of steps lasts as long as the recording or the last visit does.
    steps_of = {phase.name: phase.steps or MAX_STEPS for phase in program.phases}
    for item, route in zip(program.inputs, program.input_routes, strict=True):
        # An unknown phase is reported by its own rule below, so here it only must not fail.
        last_step = steps_of.get(item.phase, MAX_STEPS) - 1
        visit_steps, _ = item.visits
        rules = [
            Rule("sizes", _are_integers_within([item.size], 1, MAX_LINES)),
            Rule("phases", item.phase in steps_of),
            # Inputs that are fed from one recording agree in its channels.
            Rule("channels", item.channels == streams[item.stream]),
            Rule("positions", _within(visit_steps, 0, last_step)),
            Rule("first lines", _first_lines_fit(item)),
            Rule("routes", len(route.line) == len(route.core) == len(route.axon)),
            Rule("lines", _within(route.line, 0, item.size - 1)),
        ]
        _check(f"input {item.name!r}", rules)


def _first_lines_fit(item: Input) -> bool:
    """Return whether every channel has a first line, and channels that are played in one step share no lines."""
    first_lines = item.first_lines
    positions = item.positions
    if first_lines is not None:
        if positions is None or len(first_lines) != len(positions):
            return False
        if not _within(first_lines, 0, item.size - 1):
            return False
    return not item.lines_are_shared


def _check_groups(program: ChipProgram) -> None:
    """Check that the slices of every group, over all cores, cover it exactly once, in one phase."""
    slices_of_group: dict[str, list[tuple[int, int]]] = {}
    phases_of_group: dict[str, set[str]] = {}
    for core in program.cores:
        for piece in core.slices:
            slices_of_group.setdefault(piece.group, []).append((piece.start, piece.stop))
            phases_of_group.setdefault(piece.group, set()).add(core.phase)
    for name, slices in slices_of_group.items():
        # In order, each slice begins where the one before it ends.
        slices.sort()
        starts = [start for start, _ in slices]
        stops = [stop for _, stop in slices]
        rules = [
            Rule("slices", starts == [0, *stops[:-1]]),
            Rule("phases", len(phases_of_group[name]) == 1),
        ]
        _check(f"compartments {name!r}", rules)


def _check_readout(program: ChipProgram) -> None:
    """Check that the readout's populations exist and have one size, with neuron i for class i."""
    readout = program.readout
    if readout is None:
        return
    # A population that does not exist has the size None.
    sizes = {program.populations.get(name) for name in readout.populations}
    fit_together = len(sizes) == 1 and None not in sizes
    are_finite = all(abs(weight) <= MAX_WEIGHT for weight in readout.weights)
    _check("readout", [Rule("populations", fit_together), Rule("weights", are_finite)])
    classes = program.populations[readout.populations[0]]
    tie_class = readout.tie_class
    tie_class_exists = tie_class is None or 0 <= tie_class < classes
    _check("readout", [Rule("class for ties", tie_class_exists)])


def _slot_rules(program: ChipProgram) -> list[Rule]:
    """Return the rule that every core has a slot of its own on the board."""
    slots = [core.slot for core in program.cores]
    are_distinct = len(set(slots)) == len(slots)
    are_on_board = _are_integers_within(slots, 0, program.chip.cores - 1)
    return [Rule("slots", are_distinct and are_on_board)]


def _check_destinations(program: ChipProgram) -> None:
    """Check that spikes go to existing axons, in the sender's phase, and that every axon has exactly one sender."""
    cores = program.cores
    input_axons = np.array([core.axons.input_axons for core in cores], dtype=np.int64)
    # The axons of all cores are numbered one core after the other; core c's axons begin at first_axon[c].
    first_axon = np.cumsum([0, *input_axons])
    phase_of_core = np.array([core.phase for core in cores], dtype=object)
    senders_of_axon = np.zeros(first_axon[-1], dtype=np.int64)
    for sender in _senders(program):
        are_valid = _destinations_exist(sender, input_axons) and bool(
            (phase_of_core[sender.core] == sender.phase).all()
        )
        _check(sender.where, [Rule("destinations", are_valid)])
        # Unlike `+= 1`, add.at counts an axon as often as it occurs.
        np.add.at(senders_of_axon, first_axon[sender.core] + sender.axon, 1)
    for core, senders in zip(cores, np.split(senders_of_axon, first_axon[1:-1]), strict=True):
        _check(f"core {core.number}", [Rule("input axons", bool((senders == 1).all()))])


def _senders(program: ChipProgram) -> Iterator[Sender]:
    """Yield everything that sends spikes: cores, then inputs."""
    for core in program.cores:
        axons = core.axons
        yield Sender(f"core {core.number}", core.phase, axons.out_core, axons.out_axon)
    for item, route in zip(program.inputs, program.input_routes, strict=True):
        yield Sender(f"input {route.input!r}", item.phase, route.core, route.axon)


def _destinations_exist(sender: Sender, input_axons: IntArray) -> bool:
    """Return whether the sender's cores and axons exist; ``input_axons`` (cores,) is how many axons each core has."""
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
    """Return whether all numbers of an array are within ``low..high``, both included."""
    return bool(((values >= low) & (values <= high)).all())


def _are_integers_within(values: Iterable[object], low: int, high: int) -> bool:
    """Return whether all values are Python integers, not booleans, within ``low..high``, both included."""
    return all(
        isinstance(value, int) and not isinstance(value, bool) and low <= value <= high
        for value in values
    )
