"""Programs built by hand: every limit of a chip and every mistake of a caller is refused with its whole message."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse

import hw_model as hw
from tests.support.register_units import FORGETS_AT_ONCE

CHIP = hw.chip("loihi-sim")


def build(chip=CHIP, *, inputs=2, size=1, weights=None, parameters=None, dendrites=0, **synapses):
    """Build a program of one group driven by one input, with some joined dendrites; weights are 2 by default."""
    builder = hw.ProgramBuilder(chip)
    x = builder.add_input("x", inputs)
    n = builder.add_compartments("n", size, **{"threshold": 10, **(parameters or {})})
    builder.connect(x, n, np.full((size, inputs), 2) if weights is None else weights, **synapses)
    for i in range(1, dendrites + 1):
        dendrite = builder.add_compartments(f"d{i}", size, threshold=10 + i, decay_u=i, joined_to=n)
        builder.connect(x, dendrite, np.full((size, inputs), 2), delay=i, exponent=i)
    return builder.build()


def limited(**limits):
    """Return loihi-sim with other limits."""
    return replace(CHIP, limits=replace(CHIP.limits, **limits))


# Each row: the arguments that are wrong, and the message.
LIMIT_ERRORS = [
    pytest.param({"parameters": {"decay_u": 4097}}, "compartments 'n': decay_u of compartment 0 is out of range (4097 against 0..4096). Give an effective decay, what is subtracted from 4096.", id="decay_u"),
    pytest.param({"parameters": {"decay_v": -1}}, "compartments 'n': decay_v of compartment 0 is out of range (-1 against 0..4096). Give an effective decay, what is subtracted from 4096.", id="decay_v"),
    pytest.param({"parameters": {"threshold": 2**17}}, "compartments 'n': threshold of compartment 0 is out of range (131072 against 0..131071). Give a 64th of the threshold, or scale the weights down.", id="threshold"),
    pytest.param({"parameters": {"refractory": 64}}, "compartments 'n': refractory of compartment 0 is out of range (64 against 1..63). Shorten the refractory period; 1 blocks no step.", id="refractory"),
    pytest.param({"parameters": {"bias": 4097}}, "compartments 'n': bias 4097 of compartment 0 is not a mantissa times a power of two (mantissa -4096..4095, exponent 0..7). The nearest is 4096.", id="bias"),
    pytest.param({"parameters": {"vmin": -100}}, "compartments 'n': vmin -100 is not of the form 1 - 2^k. The nearest is -127.", id="vmin"),
    pytest.param({"parameters": {"vmax": 1000}}, "compartments 'n': vmax 1000 is not of the form 2^(9 + 2k) - 1. The nearest is 511.", id="vmax"),
    pytest.param({"delay": 63}, "synapses 'x' -> 'n': a delay is out of range (63 against 0..62 steps; 2 of 2 delays outside). Relay the spike through 1 compartment, or shorten the delay.", id="delay"),
    pytest.param({"exponent": 8}, "synapses 'x' -> 'n': the weight exponent is out of range (8 against -8..7). Rescale the weights.", id="exponent"),
    pytest.param({"weights": [[3, 2]]}, "synapses 'x' -> 'n': weight 3 is not on the grid of 8-bit mixed weights (multiples of 2 in -256..254; 1 of 2 weights off). Round the weights onto the grid first.", id="weight grid"),
    pytest.param({"weights": [[-2, 2]], "sign_mode": "excitatory"}, "synapses 'x' -> 'n': weight -2 is not on the grid of 8-bit excitatory weights (multiples of 1 in 0..255; 1 of 2 weights off). Round the weights onto the grid first.", id="weight range"),
    pytest.param({"chip": limited(input_axons_per_core=1)}, "population 'n': 2 input axons of neuron 0 do not fit one core (loihi-sim holds 1). Prune 1 of its sources, or gather them in a population in between; a location branch has one per step.", id="input axons"),
    pytest.param({"chip": limited(synapse_words_per_core=1)}, "population 'n': 2 synapse memory words of neuron 0 do not fit one core (loihi-sim holds 1). Prune 1 of its 2 synapses.", id="synapse memory"),
    pytest.param({"chip": limited(compartments_per_core=2), "dendrites": 2}, "population 'n': 3 compartments of neuron 0 do not fit one core (loihi-sim holds 2). Join at most 2 compartments to a neuron.", id="joined compartments"),
    pytest.param({"chip": limited(compartment_profiles_per_core=2), "dendrites": 2}, "population 'n': 3 compartment profiles of neuron 0 do not fit one core (loihi-sim holds 2). Give its joined compartments the same decays.", id="compartment profiles"),
    pytest.param({"chip": limited(threshold_profiles_per_core=2), "dendrites": 2}, "population 'n': 3 threshold profiles of neuron 0 do not fit one core (loihi-sim holds 2). Give its joined compartments the same threshold.", id="threshold profiles"),
    pytest.param({"parameters": {"vmin": 0}, "dendrites": 1}, "population 'n': 2 pairs of voltage limits of neuron 0 do not fit one core (loihi-sim holds 1). Give its joined compartments the same vmin and vmax.", id="voltage limits"),
    pytest.param({"chip": limited(synapse_formats_per_core=1), "dendrites": 1}, "population 'n': 2 synapse formats of neuron 0 do not fit one core (loihi-sim holds 1). Use fewer weight exponents for this population: formats of one exponent and sign share one already.", id="synapse formats"),
    pytest.param({"chip": limited(cores_per_chip=2, compartments_per_core=1), "size": 3}, "network 'program': 3 cores are needed (loihi-sim has 2 on 1 chip). Give a chip file with chips: 2, if the board has as many.", id="cores"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "message"), LIMIT_ERRORS)
def test_a_limit_of_the_chip_is_refused_with_its_way_out(arguments, message):
    with pytest.raises(hw.TargetError) as caught:
        build(**arguments)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    "vmin", [1 - 2**32, -(2**23)], ids=["beyond all", "beyond the register, of another form"]
)
def test_lower_limits_beyond_the_register_keep_their_form(vmin):
    with pytest.raises(hw.TargetError) as caught:
        build(parameters={"vmin": vmin})
    assert (
        str(caught.value)
        == f"compartments 'n': vmin {vmin} is not of the form 1 - 2^k. The nearest is -8388607."
    )
    assert build(parameters={"vmin": 1 - 2**31}).cores[0].vmin == -8388607


def fan_out(chip, *, senders, targets):
    """Build a program in which every one of ``senders`` compartments reaches every one of ``targets``."""
    builder = hw.ProgramBuilder(chip)
    x = builder.add_input("x", 1)
    few = builder.add_compartments("few", senders, threshold=1)
    many = builder.add_compartments("many", targets, threshold=1)
    builder.connect(x, few, np.full((senders, 1), 2))
    builder.connect(few, many, np.full((targets, senders), 2))
    return builder.build()


def test_a_neuron_with_too_many_target_cores_is_refused():
    with pytest.raises(hw.TargetError) as caught:
        fan_out(limited(compartments_per_core=1, output_axons_per_core=2), senders=1, targets=3)
    assert str(caught.value) == (
        "population 'few': a neuron reaches more cores than a core has output axons (4 cores in all) "
        "(loihi-sim holds 2 output axons). Connect it to fewer populations, or relay its spikes through compartments."
    )


def test_a_population_with_too_many_output_axons_is_spread_over_cores():
    program = fan_out(
        limited(compartments_per_core=4, output_axons_per_core=5), senders=4, targets=8
    )
    assert max(core.axons.output_axons for core in program.cores) <= 5
    assert [core.compartments for core in program.cores if core.axons.output_axons] == [2, 2]


# Each row: the arguments that are wrong, and the message.
MISTAKES = [
    pytest.param({"weights": [[0.5, 2]]}, "synapses 'x' -> 'n': weights has values that are not whole numbers. Quantise them first.", id="fractions"),
    pytest.param({"weights": [[float("nan"), 2]]}, "synapses 'x' -> 'n': weights has values that are not whole numbers. Quantise them first.", id="nan"),
    pytest.param({"weights": [[2], [2]]}, "synapses 'x' -> 'n': weights has the wrong shape ((2, 1) against (1, 2)). Give n_target rows and n_source columns.", id="shape"),
    pytest.param({"weights": sparse.csr_array(np.eye(2, dtype=int))}, "synapses 'x' -> 'n': weights has the wrong shape ((2, 2) against (1, 2)). Give n_target rows and n_source columns.", id="sparse shape"),
    pytest.param({"parameters": {"decay_u": [1, 2]}}, "compartments 'n': decay_u has the wrong shape ((2,) against (1,)). Give one value per compartment.", id="parameter shape"),
    pytest.param({"weight_bits": 7}, "weight bits: no synapse format has 7 bits. Choose one of 1, 2, 3, 4, 5, 6, 8.", id="bits"),
    pytest.param({"weight_bits": 0}, "weight bits: no synapse format has 0 bits. Choose one of 1, 2, 3, 4, 5, 6, 8.", id="no bits"),
    pytest.param({"weights": [[2, 2], [2]]}, "ProgramBuilder.connect, weights: it is not an array: its rows differ in length. Make them equal.", id="rows"),
    pytest.param({"parameters": {"bias": [[2, 2], [2]]}}, "ProgramBuilder.add_compartments, bias: it is not an array: its rows differ in length. Make them equal.", id="rows of a parameter"),
    pytest.param({"size": 1.5}, "ProgramBuilder.add_compartments, size: it must be an int (got float 1.5). Correct it.", id="half a neuron"),
    pytest.param({"size": -1, "weights": np.zeros((0, 2))}, "'n': it is empty (size -1). Give it a size.", id="less than no size"),
    pytest.param({"size": 0, "weights": np.zeros((0, 2))}, "'n': it is empty (size 0). Give it a size.", id="no size"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "message"), MISTAKES)
def test_a_mistake_in_a_call_is_refused_with_its_way_out(arguments, message):
    with pytest.raises(hw.InputError) as caught:
        build(**arguments)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("spikes", "options", "message"),
    [
        (np.zeros((3, 3)), {}, "spikes of 'x': the shape does not fit ((3, 3) against (steps, 2) or (batch, steps, 2)). Give one column per channel."),
        (np.full((3, 2), 2), {}, "spikes of 'x': values other than 0 and 1. Binarise the events; graded spikes do not exist here."),
        (np.full((3, 2), np.nan), {}, "spikes of 'x': values other than 0 and 1. Binarise the events; graded spikes do not exist here."),
        ({"y": np.zeros((3, 2))}, {}, "spikes: its streams are not the program's inputs (x). Give a mapping with one array for each."),
        (np.zeros((0, 3, 2)), {}, "spikes: nothing to simulate (recordings: 0, steps: 3). Give some recordings and steps."),
        (np.zeros((0, 2)), {}, "spikes: nothing to simulate (recordings: 1, steps: 0). Give some recordings and steps."),
        (np.zeros((3, 2)), {"steps": 0}, "steps: nothing to simulate (0 against at least 1). Raise steps."),
        (np.zeros((3, 2)), {"steps": 10**12}, "steps: a simulation does not hold so many (1000000000000 against 10000000). Lower steps."),
        ([[0, 1], [1]], {}, "simulate, spikes: it is not an array: its rows differ in length. Make them equal."),
        (np.zeros((3, 2)), {"engine": "fats"}, "engine 'fats': does not exist. Did you mean 'fast'?"),
        (np.zeros((3, 2)), {"probe": ("spike",)}, "probe 'spike': does not exist. Did you mean 'spikes'?"),
    ],
    ids=["channels", "graded", "nan", "stream", "no recordings", "no rows", "steps", "many steps", "rows", "engine", "probe"],
)  # fmt: skip
def test_recordings_and_options_that_cannot_be_simulated_are_refused(spikes, options, message):
    with pytest.raises(hw.InputError) as caught:
        hw.simulate(build(), spikes, **options)
    assert str(caught.value) == message


@pytest.mark.parametrize("operation", ["PASS", "BLOCK", "OR", "AND", "MAX", "SKIP"])
def test_join_operations_without_a_public_meaning_are_refused(operation):
    builder = hw.ProgramBuilder(CHIP)
    soma = builder.add_compartments("soma", 1, threshold=1)
    with pytest.raises(hw.TargetError) as caught:
        builder.add_compartments("dendrite", 1, threshold=1, joined_to=soma, join=operation)
    assert str(caught.value) == (
        f"compartments 'dendrite': the join operation '{operation}' is not modelled: no public source gives its integer "
        "timing. Join with ADD."
    )


@pytest.mark.parametrize(
    ("named", "message"),
    [
        (("n", "n"), "readout: it names 'n' twice. Name it once: it has one weight."),
        (
            ("x",),
            "readout: 'x' is not a group of compartments. Read out groups of compartments of this graph.",
        ),
        (("n", "m"), "readout: its populations differ in size: [2, 3]. Make them equal."),
        ((), "readout: it names no population. Name one, or leave out the readout."),
    ],
    ids=["a population twice", "an input", "two sizes", "nothing"],
)
def test_populations_that_cannot_be_read_out_are_refused(named, message):
    with pytest.raises(hw.InputError) as caught:
        read_out(named)
    assert str(caught.value) == message


def read_out(named):
    """Build a program that reads out some of its nodes: input x, groups n and m."""
    builder = hw.ProgramBuilder(CHIP)
    nodes = {"x": builder.add_input("x", 2)}
    nodes["n"] = builder.add_compartments("n", 2, threshold=1)
    nodes["m"] = builder.add_compartments("m", 3, threshold=1)
    builder.read_out(*(nodes[name] for name in named))
    return builder.build()


def test_an_input_takes_no_synapses():
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    builder.connect(builder.add_compartments("n", 1, threshold=5), x, [[20], [20]])
    with pytest.raises(hw.InputError) as caught:
        builder.build()
    assert (
        str(caught.value)
        == "synapses 'n' -> 'x': an input takes no synapses. Connect it the other way round."
    )


def test_names_are_unique():
    builder = hw.ProgramBuilder(CHIP)
    builder.add_input("x", 1)
    builder.add_compartments("x", 1, threshold=1)
    with pytest.raises(hw.InputError) as caught:
        builder.build()
    assert str(caught.value) == "'x': two inputs or groups have this name. Rename one of them."


def test_the_weight_bits_that_would_fit_the_board_are_named():
    """A list of 60 synapses: 10 + 60 * 8 bits are 8 words, 10 + 60 * 5 are 5; two lists, and room for 11 words."""
    chip = limited(synapse_words_per_core=11, cores_per_chip=1)
    assert (
        build(chip, size=60, weights=np.full((60, 2), 16), weight_bits=5)
        .cores[0]
        .axons.synapse_words
        == 10
    )
    with pytest.raises(hw.TargetError) as caught:
        build(chip, size=60, weights=np.full((60, 2), 16), weight_bits=8)
    assert str(caught.value) == (
        "network 'program': 2 cores are needed (loihi-sim has 1 on 1 chip). "
        "Give a chip file with chips: 2, if the board has as many, or use 5 weight bits."
    )


def test_the_page_of_limits_names_every_test():
    page = (Path(__file__).parents[2] / "docs/reference/limits.md").read_text()
    named = {
        line.split("|")[3].strip().strip("`")
        for line in page.splitlines()
        if line.count("|") == 5 and "`" in line
    }
    tested = {row.id for row in (*LIMIT_ERRORS, *MISTAKES)} | {"output axons", "joins"}
    assert named <= tested
    assert {row.id for row in LIMIT_ERRORS} <= named


def test_sparse_and_dense_weights_make_the_same_program():
    weights = np.array([[2, 0, -4], [0, 0, 6]])
    spikes = np.ones((4, 3), dtype=int)
    results = [
        hw.simulate(build(inputs=3, size=2, weights=w), spikes, probe=("u",))
        for w in (weights, sparse.csr_array(weights))
    ]
    assert np.array_equal(results[0].u["n"], results[1].u["n"])
    assert results[0].counts == results[1].counts


def test_scores_are_sums_of_spikes_over_the_groups_read_out():
    """Class 0 has three spikes of the first group; class 1 has one of the first and two of the second."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    x = builder.add_input("x", 2)
    parameters = {"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE, "threshold": 1}
    first = builder.add_compartments("first", 2, **parameters)
    second = builder.add_compartments("second", 2, **parameters)
    builder.connect(x, first, [[20, 20], [0, 20]])
    builder.connect(x, second, [[0, 0], [20, 0]])
    builder.read_out(first, second)
    result = hw.simulate(builder.build(), [[1, 0], [1, 0], [0, 1], [0, 0]])
    assert result.scores.tolist() == [3.0, 3.0]


def test_zeros_make_no_synapse_and_are_counted():
    program = build(inputs=3, size=2, weights=np.array([[2, 0, -4], [0, 0, 6]]))
    assert program.synapses_pruned == 3
    assert sum(len(core.axons.target) for core in program.cores) == 3


def test_delays_that_memory_cannot_hold_are_refused():
    chip = hw.chip("loihi-sim")
    builder = hw.ProgramBuilder(replace(chip, registers=replace(chip.registers, delay_max=65_534)))
    x = builder.add_input("x", 1)
    for name, size in (("a", 1000), ("b", 1049)):
        builder.connect(
            x,
            builder.add_compartments(name, size, threshold=1),
            np.full((size, 1), 2),
            delay=65_534,
        )
    with pytest.raises(hw.TargetError) as caught:
        builder.build()
    assert str(caught.value) == (
        "phase 'time': its longest delay keeps more charges in flight than the simulator allows "
        "(65536 steps of 2049 compartments against 134217728). Shorten the delay, or relay the spike through compartments."
    )


def test_a_compartment_keeps_all_and_rests_one_step_unless_told_otherwise():
    (core,) = build().cores
    (profile,) = core.profiles
    assert (profile.decay_u, profile.decay_v, profile.refractory, profile.joined) == (0, 0, 1, 0)
    assert (core.bias.tolist(), core.vmin, core.vmax) == ([0], 1 - 2**23, 2**23 - 1)


@pytest.mark.parametrize("kind", [np.array, sparse.csr_array], ids=["dense", "sparse"])
def test_delays_may_differ_by_synapse(kind):
    """The weights are a diagonal, so that the delays besides it belong to no synapse."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    n = builder.add_compartments("n", 2, threshold=10)
    builder.connect(x, n, [[2, 0], [0, 2]], delay=kind([[3, 9], [0, 5]]))
    assert builder.graph().synapses[0].delay.tolist() == [3, 5]


def test_sparse_delays_of_another_shape_are_refused():
    with pytest.raises(hw.InputError) as caught:
        build(delay=sparse.csr_array(np.ones((2, 2), dtype=int)))
    assert str(caught.value) == (
        "synapses 'x' -> 'n': delay has the wrong shape ((2, 2) against (1, 2)). Give n_target rows and n_source columns."
    )


@pytest.mark.parametrize("sign", [1, -1], ids=["largest", "lowest"])
def test_numbers_beyond_those_of_any_register_are_refused_first(sign):
    """Up to 2^53, floats hold every whole number; such a bias is refused because it has no mantissa."""
    with pytest.raises(hw.TargetError) as caught:
        build(parameters={"bias": sign * 2**53})
    assert str(caught.value).startswith(f"compartments 'n': bias {sign * 2**53} of compartment 0")
    with pytest.raises(hw.InputError) as caught:
        build(parameters={"bias": sign * (2.0**53 + 2)})
    assert str(caught.value) == (
        f"compartments 'n': bias has values that no register holds ({sign * 2.0**53:g}). Quantise them first."
    )


def test_a_slice_that_is_crowded_by_output_axons_shrinks_to_one_neuron():
    """Four neurons that reach two cores have eight output axons, and two that reach one core have two, with room for four.

    Without its excess of six, the larger slice keeps two axons, those of one neuron.
    """
    chip = limited(compartments_per_core=6, output_axons_per_core=4)
    builder = hw.ProgramBuilder(chip)
    x = builder.add_input("x", 1)
    four = builder.add_compartments("four", 4, threshold=1)
    two = builder.add_compartments("two", 2, threshold=1)
    targets = builder.add_compartments("targets", 12, threshold=1)
    for group in (four, two):
        builder.connect(x, group, np.full((group.size, 1), 2))
    builder.connect(four, targets, np.full((12, 4), 2))
    to_first_core = np.zeros((12, 2), dtype=int)
    to_first_core[:6] = 2
    builder.connect(two, targets, to_first_core)
    program = builder.build()
    slices = [[(s.group, s.start, s.stop) for s in core.slices] for core in program.cores]
    assert slices == [
        [("four", 0, 1)],
        [("four", 1, 2)],
        [("four", 2, 3)],
        [("four", 3, 4)],
        [("two", 0, 2), ("targets", 0, 4)],
        [("targets", 4, 10)],
        [("targets", 10, 12)],
    ]
