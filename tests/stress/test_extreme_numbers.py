"""Numbers at the ends of float64 in a network: represented, or refused in one line; never a crash, nan or infinity.

Warnings are errors in all tests, so none of these numbers may make numpy warn, of a division by 0 for instance.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

import hw_model as hw
import locsnn_compile as lc
from hw_model.mapping.graph import Readout
from locsnn_compile.errors import InputError, TargetError
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import Cuba, SrmAlpha
from locsnn_compile.network.projections import Projection, matrix
from locsnn_compile.passes.kernels import Decays, one_decay
from locsnn_compile.pipeline import lower
from locsnn_compile.report.compose import compose
from locsnn_compile.report.renderers.markdown import render_markdown
from locsnn_compile.verification.error_budget.budget import error_budget
from locsnn_compile.verification.observation import Observed
from tests.support.register_units import FORGETS_AT_ONCE, UNIT

CHIP = hw.chip("loihi-sim")
SRM = SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=1.0, scale_ref=2.0)
LIF = Cuba.of(1, decay_v=0.1, threshold=1.0)
"""Neurons of ordinary numbers, of which each test makes one extreme."""
WITHIN = "against 1e-100 to 1e+100). Give it in other units."
"""The end of a message: squares and products of numbers in this range stay within float64."""


def network_of_one(neuron, weight=1.0):
    """Return a network of a neuron behind one input."""
    return Network(
        name="one", channels=1, steps=30, step_seconds=None, sensor=None,
        views=(InputView("touch", "time", lines=1),),
        populations=(Population("n", "time", size=1, neuron=neuron),),
        projections=(Projection("touch", "n", matrix([[weight]], np.float64)),),
        readout=Readout(("n",), (1.0,)), sha256="0" * 64,
    )  # fmt: skip


# Each row: the network, the strategy, and the message.
OUT_OF_RANGE = [
    pytest.param(network_of_one(replace(SRM, theta=5e-324)), "dendrite", f"population 'n': theta is too small a number to compute with (4.94066e-324 {WITHIN}", id="least theta"),
    pytest.param(network_of_one(replace(SRM, theta=1.7e308)), "reset", f"population 'n': theta is too large a number to compute with (1.7e+308 {WITHIN}", id="largest theta"),
    pytest.param(network_of_one(replace(SRM, tau_sr=1e-320)), "dendrite", f"population 'n': tau_sr is too small a number to compute with (9.99989e-321 {WITHIN}", id="least tau"),
    pytest.param(network_of_one(replace(SRM, tau_ref=1e300)), "reset", f"population 'n': tau_ref is too large a number to compute with (1e+300 {WITHIN}", id="largest tau"),
    pytest.param(network_of_one(Cuba.of(1, decay_v=0.1, threshold=1e-300)), "dendrite", f"population 'n': threshold is too small a number to compute with (1e-300 {WITHIN}", id="least threshold"),
    pytest.param(network_of_one(LIF, 1.7e308), "dendrite", "projection 'touch' -> 'n': a weight is too large a number to compute with (1.7e+308 against 1e+100). Give it in other units.", id="largest weight"),
    pytest.param(network_of_one(Cuba.of(1, decay_v=0.1, threshold=1.0, bias=-1e300)), "dendrite", "population 'n': bias is too large a number to compute with (-1e+300 against 1e+100). Give it in other units.", id="largest bias"),
]  # fmt: skip
# Each row: the network, the strategy, and the message. The least threshold is a mantissa of 1: 64 register units, and less
# than 128. The limits are what the registers hold, in thresholds of that mantissa:
#
# - 16320: the heaviest weight, a mantissa of 255 times 2^7, against a threshold of less than 2 times 64 units
# - 4095: the largest bias, a mantissa of 4095 times 2^7 in register units, against the same
# - 32138: the heaviest weight against 64 + 1 register units, the least voltage at which rule >= spikes
NO_SCALE = [
    pytest.param(network_of_one(replace(SRM, scale_ref=1e6)), "dendrite", "population 'n': no scale holds both the threshold and the refractory kernel (its own spike weighs 1e+06 thresholds against 16320). Use a smaller scale_ref, or strategy reset.", id="own spikes"),
    pytest.param(network_of_one(replace(SRM, scale_ref=1e6)), "delay-line", "population 'n': no scale holds both the threshold and the refractory kernel (its own spike weighs 1.07e+06 thresholds against 16320). Use a smaller scale_ref, or strategy reset.", id="own taps"),
    pytest.param(network_of_one(Cuba.of(1, decay_v=0.1, threshold=1.0, bias=1e5)), "dendrite", "population 'n': no scale holds both the threshold and the largest bias (one bias reaches 100098 thresholds against 4095). Train with smaller biases, or a higher threshold.", id="bias"),
    pytest.param(network_of_one(Cuba.of(1, decay_v=1.0, threshold=1.0, rule=">="), 32200.0), "dendrite", "population 'n': no scale holds both the threshold and the largest weight (one weight reaches 3.22e+04 thresholds against 32138). Train with smaller weights, or a higher threshold.", id="weight of rule >="),
]  # fmt: skip


@pytest.mark.parametrize(("network", "strategy", "message"), OUT_OF_RANGE)
def test_numbers_that_float64_cannot_compute_with_are_refused(network, strategy, message):
    with pytest.raises(InputError) as caught:
        lower(network, CHIP, weight_bits=8, strategy=strategy)
    assert str(caught.value) == message


@pytest.mark.parametrize(("network", "strategy", "message"), NO_SCALE)
def test_what_no_scale_holds_is_named(network, strategy, message):
    with pytest.raises(TargetError) as caught:
        lower(network, CHIP, weight_bits=8, strategy=strategy)
    assert str(caught.value) == message


def test_few_bits_hold_smaller_weights():
    """The largest mantissa of 1 bit is 128 instead of 255, here times 2^7: 16384 thresholds of a mantissa of 1."""
    with pytest.raises(TargetError) as caught:
        lower(network_of_one(Cuba.of(1, decay_v=1.0, threshold=1.0), 2e4), CHIP, weight_bits=1)
    assert str(caught.value) == (
        "population 'n': no scale holds both the threshold and the largest weight (one weight reaches 2e+04 thresholds "
        "against 16384). Train with smaller weights, or a higher threshold."
    )


STRATEGIES = ["dendrite", "delay-line", "reset"]
"""Ways to lay a spike response neuron out in compartments: its own spikes act through a second dendrite, through delayed
synapses, or by a reset and blocked steps."""
GOOD_FIT = 1e-2
"""Largest difference of a response from its kernel, as a share of the kernel's peak. It is 5e-4 for the published neuron."""


def lowered(neuron, strategy):
    """Return a neuron behind one input in the chip's integers: its rounded population, and the weight mantissas.

    The weight is one threshold. Whatever the strategy, the fits of its kernels are numbers, and that of the input is good.
    """
    levels = lower(network_of_one(neuron, neuron.theta), CHIP, weight_bits=8, strategy=strategy)
    population = levels.quantized.population("n")
    assert population.fit.input_max < GOOD_FIT
    assert np.isfinite(population.fit.refractory_max)
    return population, levels.quantized.projections[0].mantissa


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("tau", [1e-3, 1e-100], ids=["short", "least"])
def test_an_input_kernel_that_is_over_at_once_is_lowered_as_none(tau, strategy):
    population, mantissa = lowered(replace(SRM, tau_sr=tau), strategy)
    assert mantissa.tolist() == [[0]]
    assert population.fit.input_max == 0


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize(
    "faint",
    [
        pytest.param({"tau_ref": 1e-3}, id="short tau_ref"),
        pytest.param({"scale_ref": 5e-324}, id="least scale_ref"),
        pytest.param({"scale_ref": 1e-300}, id="small scale_ref"),
    ],
)
def test_a_faint_refractory_kernel_is_lowered_as_none(faint, strategy):
    population, mantissa = lowered(replace(SRM, **faint), strategy)
    assert mantissa.any()
    refractory = population.neuron.refractory
    if strategy == "reset":
        assert refractory.tolist() == [1]  # a count that blocks no step
    else:
        assert not refractory.mantissa.any()


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("theta", [1e-100, 1e100], ids=["least", "largest"])
def test_any_theta_that_floats_compute_with_fits(theta, strategy):
    _, mantissa = lowered(replace(SRM, theta=theta), strategy)
    assert mantissa.any()


@pytest.mark.parametrize("bias", [5e-324, -1e-310, 1e-50])
def test_denormal_biases_and_weights_are_0(bias):
    levels = lower(
        network_of_one(Cuba.of(1, decay_v=0.1, threshold=1.0, bias=bias), bias), CHIP, weight_bits=8
    )
    assert levels.quantized.population("n").neuron.bias_mantissa.tolist() == [0]
    assert levels.quantized.projections[0].mantissa.tolist() == [[0]]


def test_the_strongest_reset_is_finite():
    levels = lower(
        network_of_one(replace(SRM, scale_ref=1e100)), CHIP, weight_bits=8, strategy="reset"
    )
    # The most steps that the chip can block: the sum of this kernel would take far more.
    longest = CHIP.registers.refractory_max
    assert levels.quantized.population("n").neuron.refractory.tolist() == [longest]
    assert np.isfinite(levels.quantized.population("n").fit.refractory_rms)


@pytest.mark.parametrize("tau", [1e-3, 1e-100])
def test_a_kernel_that_is_over_at_once_has_no_gain(tau):
    forgets_at_once = Decays(u=FORGETS_AT_ONCE, v=FORGETS_AT_ONCE, gain=0.0, error=0.0)
    assert one_decay(tau, "tau") == forgets_at_once


def test_delay_line_holds_a_refractory_kernel_that_hardly_matters():
    """A millionth of a threshold is less than any tap; none is taken, and nothing is refused."""
    levels = lower(
        network_of_one(replace(SRM, scale_ref=1e-6)), CHIP, weight_bits=8, strategy="delay-line"
    )
    assert len(levels.quantized.population("n").neuron.refractory.delay) == 0


# Each row: a network whose weights all round to 0, and the message.
UNHEARD = [
    pytest.param(network_of_one(replace(SRM, tau_sr=4000.0), 0.01), "population 'n': every weight rounds to 0, so no input reaches it (one input that spikes in every step could reach 1.88 thresholds). Use larger weights, a shorter tau_sr, or a smaller scale_ref.", id="srm"),
    pytest.param(network_of_one(Cuba.of(1, decay_v=0.0, threshold=1e-3, bias=1.0), 1e-6), "population 'n': every weight rounds to 0, so no input reaches it (one input that spikes in every step could reach 3 thresholds). Use larger weights, or smaller biases.", id="integrator"),
]  # fmt: skip


@pytest.mark.parametrize(("network", "message"), UNHEARD)
def test_a_population_that_would_hear_nothing_is_refused(network, message):
    """In the float network, its input reaches the threshold, though only within so many steps."""
    with pytest.raises(TargetError) as caught:
        lower(replace(network, steps=3000), CHIP, weight_bits=8)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("neuron", "weight"),
    [pytest.param(LIF, 1e-6, id="a millionth"), pytest.param(SRM, 0.0, id="none")],
)
def test_weights_that_are_nothing_to_the_float_network_either_may_be_lost(neuron, weight):
    levels = lower(network_of_one(neuron, weight), CHIP, weight_bits=8)
    assert not levels.quantized.projections[0].mantissa.any()


def test_a_threshold_in_three_spikes_is_met_exactly():
    """10 / 3 is a third of 10 but for float rounding; the scale is one in which the chip's integers are thirds too.

    The network spikes from its threshold on (rule >=), the chip only above 64 times its mantissa. All weights are
    multiples of 64, and nothing decays, so the least voltage that spikes is 64 times the mantissa + 1.
    """
    network = network_of_one(Cuba.of(1, decay_v=0.0, threshold=10.0, rule=">="), 10.0 / 3.0)
    levels = lower(network, CHIP, weight_bits=8)
    projection = levels.quantized.projections[0]
    weight = UNIT * projection.mantissa[0, 0] * 2**projection.exponent
    threshold_mantissa = levels.quantized.population("n").neuron.threshold[0]
    assert 3 * weight == UNIT * (threshold_mantissa + 1)


def test_one_tap_alone_is_the_kernel_in_the_error_budget():
    """With equal time constants one tap is the whole refractory kernel: the neuron model alone changes nothing."""
    network = network_of_one(replace(SRM, tau_sr=1.0), 20.0)
    levels = lower(network, CHIP, weight_bits=8, strategy="delay-line")
    assert set(levels.quantized.population("n").neuron.refractory.delay.tolist()) == {0}
    played = np.ones((1, network.steps, 1), dtype=np.uint8)
    observed = Observed(levels, played)
    # The float network in which only the kernels are the chip's, against the float network itself.
    spikes = error_budget(observed, observed.numbers).alone["kernel"].spikes
    assert spikes.reference_spikes > 0
    assert spikes.mismatches == 0


def test_a_network_without_weights_is_refused():
    with pytest.raises(InputError) as caught:
        lower(replace(network_of_one(LIF), projections=()), CHIP, weight_bits=8)
    assert str(caught.value) == "model 'one': it has no weights. Connect an input to a population."


# Each row: the value, and how the message shows it.
NOT_WHOLE = [
    pytest.param(0.5, "0.5", id="fraction"),
    pytest.param(np.nan, "nan", id="nan"),
    pytest.param(1e300, "1e+300", id="huge"),
    pytest.param(-np.inf, "-inf", id="infinite"),
    pytest.param(np.uint64(2**64 - 2), "18446744073709551614", id="unsigned"),
]  # fmt: skip


@pytest.mark.parametrize(("value", "shown"), NOT_WHOLE)
@pytest.mark.parametrize(
    "make",
    [
        lambda v: ChipCuba.of(1, decay_u=v, decay_v=1, threshold=1),
        lambda v: Cuba.of(1, decay_v=0.5, threshold=1.0, refractory=v),
        lambda v: matrix([[v]], np.int64),
        lambda v: matrix(sparse.csr_array(np.array([[v]])), np.int64),
    ],
    ids=["chip neuron", "refractory", "dense", "sparse"],
)
def test_integers_are_whole_or_refused(make, value, shown):
    """Numpy would cut 0.5 to 0, and take 2^64 - 2 for -2."""
    with pytest.raises(InputError) as caught:
        make(value)
    assert str(caught.value) == (
        f"integers of the chip: a number is not whole, or larger than any register ({shown}). "
        "Round it onto the chip's grid."
    )


def test_whole_floats_are_integers():
    assert ChipCuba.of(2, decay_u=4096.0, decay_v=[1.0, 2.0], threshold=1).decay_v.tolist() == [
        1,
        2,
    ]
    assert matrix([[2.0, -4.0]], np.int64).dtype == np.int64


# Each row: the changed parameters of a compartment, and the message.
BUILDER = [
    pytest.param({"threshold": 1e300}, "compartments 'n': threshold has values that no register holds (1e+300). Quantise them first.", id="huge"),
    pytest.param({"bias": np.inf}, "compartments 'n': bias has values that no register holds (inf). Quantise them first.", id="infinite"),
    pytest.param({"bias": np.uint64(2**64 - 2)}, "compartments 'n': bias has values that no register holds (1.84467e+19). Quantise them first.", id="unsigned"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), BUILDER)
def test_programs_by_hand_take_no_number_beyond_int64(changes, message):
    with pytest.raises(InputError) as caught:
        hw.ProgramBuilder(CHIP).add_compartments("n", 1, **{"threshold": 1, **changes})
    assert str(caught.value) == message


def test_a_weight_exponent_by_hand_is_whole():
    builder = hw.ProgramBuilder(CHIP)
    x, n = builder.add_input("x", 1), builder.add_compartments("n", 1, threshold=1)
    with pytest.raises(InputError) as caught:
        builder.connect(x, n, [[2]], exponent=1.5)
    assert (
        str(caught.value)
        == "ProgramBuilder.connect, exponent: it must be an int (got float 1.5). Correct it."
    )


def test_lost_biases_are_counted_in_the_report():
    neuron = Cuba.of(3, decay_v=0.1, threshold=1.0, bias=np.array([0.0, 1e-9, 0.05]))
    network = replace(
        network_of_one(neuron), projections=(Projection("touch", "n", matrix(np.ones((3, 1)), np.float64)),),
        populations=(Population("n", "time", size=3, neuron=neuron),),
    )  # fmt: skip
    report = lc.compile(network, events=np.ones((1, 30, 1), dtype=np.uint8)).figures
    assert report.skipped.biases_lost == 1
    assert "- biases lost: 1, which round to 0\n" in render_markdown(compose(report))


# Each row: the neuron, and the weight of its only input.
FAINT = [
    pytest.param(SRM, 0.0, id="no weight"),
    pytest.param(replace(SRM, scale_ref=5e-324), 10.0, id="least scale_ref"),
    pytest.param(replace(SRM, scale_ref=1e-6), 10.0, id="small scale_ref"),
    pytest.param(replace(SRM, tau_sr=1e-3), 10.0, id="short kernel"),
    pytest.param(SRM, 1e-310, id="denormal weight"),
]


@pytest.mark.parametrize(("neuron", "weight"), FAINT)
def test_rounding_for_recordings_takes_what_is_nearly_nothing(neuron, weight):
    """Rounding the weights of a neuron together divides by sums that are 0 or nearly so here, and must not warn."""
    played = np.ones((1, 30, 1), dtype=np.uint8)
    compiled = lc.compile(network_of_one(neuron, weight), strategy="dendrite", events=played)
    threshold_mantissa = compiled.levels.quantized.population("n").neuron.threshold[0]
    assert 1 <= threshold_mantissa <= CHIP.registers.threshold_mantissa_max


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"theta": 5e-324}, "theta is too small a number to compute with (4.94066e-324"),
        ({"theta": 1.7e308}, "theta is too large a number to compute with (1.7e+308"),
        ({"tau_sr": 1e-320}, "tau_sr is too small a number to compute with (9.99989e-321"),
    ],
    ids=["a tiny threshold", "a huge threshold", "a tiny time"],
)
def test_networks_are_checked_before_anything_is_evaluated(changes, what):
    with pytest.raises(InputError) as caught:
        lc.compile(
            network_of_one(replace(SRM, **changes)), events=np.ones((1, 30, 1), dtype=np.uint8)
        )
    assert (
        str(caught.value)
        == f"population 'n': {what} against 1e-100 to 1e+100). Give it in other units."
    )
