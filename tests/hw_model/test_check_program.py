"""Every rule that a program must obey: a built program obeys all, and one broken entry is refused by the rule's message."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.mapping.graph import MAX_LINES, MAX_STEPS, Phase, Readout
from hw_model.program.check import check_program
from hw_model.program.chip_program import ChipProgram
from tests.support.register_units import FORGETS_AT_ONCE, KEEPS_ALL

LOIHI = hw.chip("loihi-sim")
CHIP = replace(LOIHI, limits=replace(LOIHI.limits, compartments_per_core=4))


def built() -> ChipProgram:
    """Three neurons on core 0, and two of two compartments each on core 1; both cores get the input."""
    b = hw.ProgramBuilder(CHIP)
    x = b.add_input("x", 2)
    hidden = b.add_compartments("hidden", 3, decay_u=[1, 1, 2], threshold=[5, 6, 7], bias=64)
    y = b.add_compartments("y", 2, threshold=5)
    dendrite = b.add_compartments("dendrite", 2, threshold=5, joined_to=y)
    b.connect(x, hidden, [[20, 0], [20, 10], [0, 10]])
    b.connect(x, dendrite, [[20, 0], [0, 20]], delay=3)
    b.connect(hidden, dendrite, [[20, 20, 0], [0, 20, 10]], exponent=1)
    b.read_out(y)
    return b.build()


PROGRAM = built()


# Each of these returns the program with one thing changed.


def core(index: int, **changes) -> ChipProgram:
    """Change fields of a core, by its index."""
    cores = list(PROGRAM.cores)
    cores[index] = replace(cores[index], **changes)
    return replace(PROGRAM, cores=tuple(cores))


def axons(index: int, **changes) -> ChipProgram:
    """Change fields of the axons of a core."""
    return core(index, axons=replace(PROGRAM.cores[index].axons, **changes))


def entry(array: np.ndarray, index: int, value: int) -> np.ndarray:
    """Return a copy of an array with one entry changed."""
    changed = np.array(array)
    changed[index] = value
    return changed


def table(index: int, name: str, at: int, value: int) -> ChipProgram:
    """Change one entry of a table of a core."""
    return core(index, **{name: entry(getattr(PROGRAM.cores[index], name), at, value)})


def axon_table(index: int, name: str, at: int, value: int) -> ChipProgram:
    """Change one entry of a table of a core's axons."""
    return axons(index, **{name: entry(getattr(PROGRAM.cores[index].axons, name), at, value)})


def profile(**changes) -> ChipProgram:
    """Change the first compartment profile of core 0."""
    own = PROGRAM.cores[0].profiles
    return core(0, profiles=(replace(own[0], **changes), *own[1:]))


def form(**changes) -> ChipProgram:
    """Change the first synapse format of core 1."""
    own = PROGRAM.cores[1].axons.formats
    return axons(1, formats=(replace(own[0], **changes), *own[1:]))


def slices(index: int, **changes) -> ChipProgram:
    """Change the first slice of a core."""
    own = PROGRAM.cores[index].slices
    return core(index, slices=(replace(own[0], **changes), *own[1:]))


def item(**changes) -> ChipProgram:
    """Change the input."""
    return replace(PROGRAM, inputs=(replace(PROGRAM.inputs[0], **changes),))


def route(**changes) -> ChipProgram:
    """Change the route of the input."""
    return replace(PROGRAM, input_routes=(replace(PROGRAM.input_routes[0], **changes),))


def phases(*all_of_them: Phase) -> ChipProgram:
    """Replace the phases."""
    return replace(PROGRAM, phases=all_of_them)


def two_phases(program: ChipProgram) -> ChipProgram:
    """Core 1 runs in a phase of its own."""
    cores = program.cores[0], replace(program.cores[1], phase="later")
    return replace(program, phases=(TIME, replace(TIME, name="later")), cores=cores)


NOTHING = {"slices": ()} | {
    name: getattr(PROGRAM.cores[0], name)[:0]
    for name in ("profile", "threshold", "bias_mantissa", "bias_exponent", "parent")
}
"""The fields of a core without compartments."""
TIME = PROGRAM.phases[0]
WAYS = PROGRAM.input_routes[0]
# A program, and the place and the table that the message names. `table(0, "profile", 1, 2)` puts the value 2 at entry 1 of
# the table `profile` of core 0, and `axon_table` does the same in the tables of a core's axons.
BROKEN = {
    "two phases of one name": (phases(TIME, TIME), "phases", "names"),
    "an axis that is none": (phases(replace(TIME, axis="space")), "phases", "axes"),
    "no step": (phases(replace(TIME, steps=0)), "phases", "steps"),
    "a step too many": (phases(replace(TIME, steps=MAX_STEPS + 1)), "phases", "steps"),
    "a core of another phase": (core(0, phase="location"), "core 0", "phases"),
    "a bias too few": (core(0, bias_mantissa=PROGRAM.cores[0].bias_mantissa[:2]), "core 0", "compartment tables"),
    "a weight too few": (axons(1, mantissa=PROGRAM.cores[1].axons.mantissa[:-1]), "core 1", "synapse tables"),
    "an output axon too few": (axons(0, out_core=PROGRAM.cores[0].axons.out_core[:-1]), "core 0", "output tables"),
    "a slice that begins later": (slices(0, offset=1), "core 0", "slices"),
    "a core without compartments": (core(0, **NOTHING), "core 0", "slices"),
    "a slice of another core": (slices(1, core=0), "core 1", "slices' places"),
    "a threshold below 0": (core(0, thresholds=(-1, 6, 7)), "core 0", "thresholds"),
    "a threshold above the register": (core(0, thresholds=(5, 6, 1 << 17)), "core 0", "thresholds"),
    "a lower limit beyond the register": (core(0, vmin=-(1 << 23)), "core 0", "voltage limits"),
    "an upper limit beyond the register": (core(0, vmax=1 << 23), "core 0", "voltage limits"),
    "an upper limit below 0": (core(0, vmax=-1), "core 0", "voltage limits"),
    "a bias above the register": (table(0, "bias_mantissa", 0, 1 << 12), "core 0", "biases"),
    "a bias below the register": (table(0, "bias_mantissa", 0, -(1 << 12) - 1), "core 0", "biases"),
    "a bias exponent too large": (table(0, "bias_exponent", 0, 8), "core 0", "bias exponents"),
    "a weight above 255": (axon_table(1, "mantissa", 0, 256), "core 1", "weights"),
    "a weight below -256": (axon_table(1, "mantissa", 0, -257), "core 1", "weights"),
    "a decay of the current above 4096": (profile(decay_u=4097), "core 0", "decays"),
    "a decay of the voltage below 0": (profile(decay_v=-1), "core 0", "decays"),
    "a refractory period too long": (profile(refractory=64), "core 0", "refractory periods"),
    "a refractory period without its spike's own step": (profile(refractory=0), "core 0", "refractory periods"),
    "a joint that is none": (profile(joined=2), "core 0", "joints"),
    "a width that no format has": (form(weight_bits=7), "core 1", "formats"),
    "a sign mode that is none": (form(sign_mode="both"), "core 1", "formats"),
    "an exponent that is none": (form(exponent=8), "core 1", "formats"),
    "more delay bits than a number has": (form(delay_bits=65), "core 1", "formats"),
    "a profile that is not there": (table(0, "profile", 0, 2), "core 0", "profile indices"),
    "a threshold that is not there": (table(0, "threshold", 0, 3), "core 0", "threshold indices"),
    "a parent before its child": (table(1, "parent", 1, 0), "core 1", "parents"),
    "a compartment as its own parent": (table(1, "parent", 1, 1), "core 1", "parents"),
    "a parent that is not there": (table(1, "parent", 1, 4), "core 1", "parents' range"),
    "a list that ends before it begins": (axon_table(1, "list_start", 1, 9), "core 1", "list starts"),
    "a list beyond the synapses": (axon_table(1, "list_start", -1, 8), "core 1", "list ends"),
    "no list starts": (axons(1, list_start=PROGRAM.cores[1].axons.list_start[:0]), "core 1", "list ends"),
    "synapses before the first list": (axon_table(1, "list_start", 0, 1), "core 1", "list begins"),
    "a target that is not there": (axon_table(1, "target", 0, 4), "core 1", "targets"),
    "a target before the first": (axon_table(1, "target", 0, -1), "core 1", "targets"),
    "a format that is not there": (axon_table(1, "format_index", 0, 2), "core 1", "format indices"),
    "a delay too long": (axon_table(1, "delay", 0, 63), "core 1", "delays"),
    "a sender that is not there": (axon_table(0, "out_compartment", 0, 3), "core 0", "senders"),
    "two cores in one place": (core(1, slot=PROGRAM.cores[0].slot), "cores", "slots"),
    "a core beside the board": (core(1, slot=128), "cores", "slots"),
    "a core that is not there": (axon_table(0, "out_core", 0, 2), "core 0", "destinations"),
    "an axon that is not there": (axon_table(0, "out_axon", 0, 5), "core 0", "destinations"),
    "a spike into another phase": (two_phases(PROGRAM), "core 0", "destinations"),
    "a group in two phases": (two_phases(slices(1, group="hidden", start=3, stop=5)), "compartments 'hidden'", "phases"),
    "a route to an axon that is not there": (route(axon=entry(WAYS.axon, 0, 5)), "input 'x'", "destinations"),
    "two senders of one axon": (axon_table(0, "out_axon", 0, 3), "core 1", "input axons"),
    "an axon without a sender": (route(**{key: getattr(WAYS, key)[1:] for key in ("line", "core", "axon")}), "core 0", "input axons"),
    "no line": (item(size=0), "input 'x'", "sizes"),
    "a line too many": (item(size=MAX_LINES + 1), "input 'x'", "sizes"),
    "an input of another phase": (item(phase="location"), "input 'x'", "phases"),
    "a route of another length": (route(axon=WAYS.axon[1:]), "input 'x'", "routes"),
    "a line that is not there": (route(line=entry(WAYS.line, 0, 2)), "input 'x'", "lines"),
    "a group that begins at its second neuron": (slices(0, start=1, stop=4), "compartments 'hidden'", "slices"),
    "a readout of what is not there": (replace(PROGRAM, readout=Readout(("z",), (1.0,))), "readout", "populations"),
    "a readout of two sizes": (replace(PROGRAM, readout=Readout(("hidden", "y"), (1.0, 1.0))), "readout", "populations"),
    "a weight beyond 1e100": (replace(PROGRAM, readout=Readout(("y",), (-1.0001e100,))), "readout", "weights"),
    "a weight that is no number": (replace(PROGRAM, readout=Readout(("y",), (np.nan,))), "readout", "weights"),
}  # fmt: skip


def message(where: str, what: str) -> str:
    """Return the whole message for a broken table."""
    return f"{where}: its {what} do not make a program. Compile it again."


def test_a_program_that_was_built_obeys_every_rule():
    check_program(PROGRAM)
    assert [core.compartments for core in PROGRAM.cores] == [3, 4]


@pytest.mark.parametrize("case", BROKEN)
def test_an_entry_that_breaks_a_rule_is_refused_by_its_message(case):
    program, where, what = BROKEN[case]
    with pytest.raises(hw.InputError) as error:
        check_program(program)
    assert str(error.value) == message(where, what)


@pytest.mark.parametrize(
    "sound",
    [
        table(0, "bias_mantissa", 0, -(1 << 12)),
        table(0, "bias_mantissa", 0, (1 << 12) - 1),
        table(0, "bias_exponent", 0, 7),
        axon_table(1, "mantissa", 0, -256),
        axon_table(1, "mantissa", 0, 255),
        axon_table(1, "delay", 0, 62),
        profile(decay_u=FORGETS_AT_ONCE, decay_v=KEEPS_ALL, refractory=63),
        core(0, thresholds=(0, 6, (1 << 17) - 1)),
        core(0, vmin=1 - (1 << 23), vmax=(1 << 23) - 1),
        core(1, slot=127),
        phases(replace(TIME, steps=MAX_STEPS)),
        replace(PROGRAM, readout=Readout(("y",), (-1e100,))),
    ],
    ids=["least bias", "most bias", "bias exponent", "least weight", "most weight", "delay", "profile", "thresholds",
         "voltage limits", "last slot", "steps", "weight"],
)  # fmt: skip
def test_the_last_value_of_a_range_is_accepted(sound):
    check_program(sound)


def test_cores_may_hold_the_slices_of_a_group_in_any_order():
    """The eight neurons of a group fill two cores; the core that comes first holds the last four."""
    b = hw.ProgramBuilder(CHIP)
    b.connect(b.add_input("x", 1), b.add_compartments("n", 8, threshold=5), np.full((8, 1), 20))
    program = b.build()
    first, second = program.cores
    check_program(program)
    reordered = [
        replace(core, slices=(replace(core.slices[0], start=start, stop=start + 4),))
        for core, start in ((first, 4), (second, 0))
    ]
    check_program(replace(program, cores=tuple(reordered)))


@pytest.mark.parametrize(
    ("limit", "most", "where", "what"),
    [
        ("compartments_per_core", 4, "core 1", "compartments"),
        ("compartment_profiles_per_core", 2, "core 0", "profiles"),
        ("threshold_profiles_per_core", 3, "core 0", "thresholds"),
        ("synapse_formats_per_core", 2, "core 1", "formats"),
        ("input_axons_per_core", 5, "core 1", "input axons"),
        ("output_axons_per_core", 3, "core 0", "output axons"),
        ("synapse_words_per_core", 5, "core 1", "synapse words"),
    ],
)
def test_each_limit_of_a_core_is_checked_by_itself(limit, most, where, what):
    """With one limit as small as the program allows, it is accepted; with one less, the message names this limit."""

    def limited(value: int) -> ChipProgram:
        return replace(PROGRAM, chip=replace(CHIP, limits=replace(LOIHI.limits, **{limit: value})))

    check_program(limited(most))
    with pytest.raises(hw.InputError) as error:
        check_program(limited(most - 1))
    assert str(error.value) == message(where, what)
