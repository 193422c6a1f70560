"""The scale of a population, as weight exponent and threshold mantissa, worked out by hand.

The compiler makes the threshold as large as registers allow, so that weights, which are fractions of it, are fine. A
mantissa of 1 at exponent 0 is 64 units of the registers. The comment above a row says which limit decides.
"""

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.arithmetic.fixed_point import weight_grid
from locsnn_compile.errors import TargetError
from locsnn_compile.network.neurons import Cuba, SoftCuba
from locsnn_compile.passes.kernels import nearest_decays, one_decay, own_charges
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.passes.rounding.grades import shares
from locsnn_compile.passes.rounding.task import Rounding, exponent_and_threshold
from locsnn_compile.passes.srm.quantize import dendrite_charge, whole_mantissas
from locsnn_compile.pipeline import lower
from tests.support.networks import NEURON, hybrid, single

CHIP = hw.chip("loihi-sim")
GRID = weight_grid(8, "excitatory")
NARROW = replace(CHIP, registers=replace(CHIP.registers, voltage_bits=9))
CHOICES = {
    # The voltage ends at 2^23 - 1 units: 2^23 / 16 / 64 is 8192, and 2^23 / 64 is 131072.
    "no weight: 16 thresholds fit the voltage": (0.0, CHIP, 1 << 17, 16, (0, 8191)),
    "no weight, one threshold in the voltage": (0.0, CHIP, 1 << 17, 1, (0, 131071)),
    "a voltage of less than 16 thresholds of 1": (0.0, NARROW, 1 << 17, 16, (0, 1)),
    # The threshold is 255 * 2^exponent / heaviest, with the largest exponent that keeps it at the cap or below.
    "a threshold exactly at the limit": (8.0, CHIP, 255, 16, (3, 255)),
    "the coarsest exponent": (8.0, CHIP, 8191, 16, (7, 4080)),
    "a quotient just below 13": (255 / 13, CHIP, 25, 16, (0, 13)),
    "no exponent fits below the limit": (1.0, CHIP, 100, 16, (0, 100)),
    # 255 * 2^2 / 1520 is below a threshold of 1, and 255 * 2^3 / 1520 is above it.
    "a weight of more thresholds than a mantissa": (1520.0, CHIP, 1, 16, (3, 1)),
    "a weight of exactly the largest mantissa": (510.0, CHIP, 1, 16, (1, 1)),
}
"""The heaviest weight in thresholds, the chip, the largest mantissa of the threshold, the headroom (thresholds that the
voltage must hold), and the expected exponent and mantissa."""


@pytest.mark.parametrize(
    ("heaviest", "chip", "cap", "headroom", "expected"), CHOICES.values(), ids=CHOICES
)
def test_exponent_and_threshold_by_hand(heaviest, chip, cap, headroom, expected):
    choice = exponent_and_threshold(heaviest, GRID, chip, cap=cap, over=0, headroom=headroom)
    assert choice == expected


ONE = {"decay_v": 1.0, "threshold": 1.0}
"""A neuron that keeps nothing of its potential, with a threshold of 1."""
READ = {"decay_u": 0.25, "decay_v": 0.125}
"""Decays of neurons that are read out by their potentials."""
SCALES = {
    # A bias of 4095 * 2^7 units is 8190 mantissas; one less leaves the unit of the rule.
    "the largest bias fits, rule included": (ONE | {"bias": 1.0}, [0.0], 0, 8189),
    # 200 weights fit the charge of 32,767 mantissas at thresholds of 163, at which the weight would have fewer bits.
    "many weights may wrap, none loses bits": (ONE, [1.0] * 200, 0, 255),
    # 255 * 2^2 is the first that holds 800.
    "heavy weights may wrap together": (ONE, [800.0] * 50, 2, 1),
    # All else is 255 * 2^exponent / the heaviest weight: below 32,767, the charge, for weights that stay below a threshold,
    # below 8,191, a 16th of the voltage, for those that pass it, and below 131,071 for a current that holds it there.
    "bounded by the threshold: one fits": (ONE, [0.25] * 4, 5, 32640),
    "a bias passes the bound": (ONE | {"bias": 0.5}, [1.0], 5, 8160),
    "inputs pass the bound": (ONE, [0.75, 0.75], 4, 5440),
    "a current adds up to the bound": (ONE | {"decay_u": 0.25}, [0.25], 7, 130560),
    "a current passes the bound": (ONE | {"decay_u": 0.1875}, [0.25], 3, 8160),
    # 0.02 / (0.25 * 0.125) is 0.64.
    "a readout adds up to 0.64 and fills the voltage": (ONE | READ, [0.01, 0.01], 2, 102000),
    "a readout that inhibition takes to -1.28": (ONE | READ, [0.02, -0.02, -0.02], 0, 8191),
    # The current holds 8 * 8 weights: 2^23 / 64 / 64 is 2,048.
    "a current adds up for eight steps": (ONE | {"decay_u": 0.125}, [1.0] * 8, 3, 2040),
}
"""Parameters of the neuron, the weights onto it, and the exponent and threshold mantissa."""


@pytest.mark.parametrize(
    ("settings", "weights", "exponent", "threshold"), SCALES.values(), ids=SCALES
)
def test_scale_of_leaky_neurons_by_hand(settings, weights, exponent, threshold):
    quantized = quantize(single(Cuba.of(1, **settings), [weights]), CHIP, weight_bits=8)
    assert [p.exponent for p in quantized.projections] == [exponent]
    assert quantized.populations[0].neuron.threshold.tolist() == [threshold]


def test_a_bias_of_more_thresholds_than_the_chip_holds_is_refused():
    with pytest.raises(TargetError) as caught:
        quantize(single(Cuba.of(1, **ONE, bias=5000.0), [[0.5]]), CHIP, weight_bits=8)
    assert str(caught.value) == (
        "population 'n': no scale holds both the threshold and the largest bias "
        "(one bias reaches 5000 thresholds against 4095). Train with smaller biases, or a higher threshold."
    )


def test_paired_dendrites_share_weights_that_take_one_format():
    quantized = quantize(hybrid(), CHIP, weight_bits=8, strategy="paired-dendrite")
    assert [p.dendrite for p in quantized.projections if p.target == "time_hidden"] == [0, 1]
    first, second = (projection.mantissa for projection in quantized.projections[:2])
    assert np.abs(first).max() > 100
    assert np.abs(first - second).max() == 1


def test_the_drop_of_a_spike_has_a_coarse_and_a_fine_part():
    """The threshold is 8160, so that drops are 7344.816, 300 and 81.6 mantissas, in parts of 128 (exponent 7) and 1.

    The current keeps half of a charge, which synapses with a delay of 1 give back.
    """
    drop = np.array([0.9001, 300 / 8160, 0.01])
    neuron = SoftCuba.of(3, decay_u=0.5, decay_v=0.25, threshold=1.0, drop=drop)
    (population,) = quantize(single(neuron, np.ones((3, 1))), CHIP, weight_bits=8).populations
    taps = population.neuron.refractory
    assert population.neuron.threshold.tolist() == [8160] * 3
    assert taps.delay.tolist() == [0, 0, 1, 1]
    assert taps.exponent.tolist() == [7, 0, 7, 0]
    assert taps.mantissa.tolist() == [[-57, -2, 0], [-49, -44, -82], [28, 0, 0], [88, 150, 41]]


def test_a_drop_of_ten_thresholds_fits_the_charge():
    """The charge holds 32767 units: 3276 for the threshold, of which the weight of 1 takes 255 * 2^3."""
    neuron = SoftCuba.of(1, decay_u=1.0, decay_v=1.0, threshold=1.0, drop=10.0)
    (population,) = quantize(single(neuron), CHIP, weight_bits=8).populations
    assert population.neuron.threshold.tolist() == [2040]
    assert population.neuron.refractory.mantissa.tolist() == [[-159], [-48]]


def with_own_charge(thresholds):
    """Return the published neuron with a refractory kernel for which an own spike weighs so many thresholds."""
    return replace(NEURON, scale_ref=thresholds / one_decay(NEURON.tau_ref, "tau_ref").gain)


def test_the_threshold_leaves_room_for_own_spikes():
    """An own spike weighs 633.47 thresholds, and a weight is at most 255 * 2^7 = 32640 mantissas.

    The threshold is at most 32640 / 633.47 - 1, hence 50. The charge, 633.47 * (50 + 1 / 64), is 247.53 * 2^7.
    """
    (population,) = quantize(
        single(with_own_charge(633.47), [[0.0]]), CHIP, weight_bits=8
    ).populations
    taps = population.neuron.refractory
    assert population.neuron.threshold.tolist() == [50]
    assert population.scale.tolist() == [(50 * 64 + 1) / NEURON.theta]
    assert taps.mantissa.tolist() == [[-248]]
    assert taps.exponent.tolist() == [7]


def test_own_spikes_that_leave_no_room_are_refused():
    with pytest.raises(TargetError) as caught:
        quantize(single(with_own_charge(20_000)), CHIP, weight_bits=8)
    assert str(caught.value) == (
        "population 'n': no scale holds both the threshold and the refractory kernel "
        "(its own spike weighs 2e+04 thresholds against 16320). Use a smaller scale_ref, or strategy reset."
    )


def test_two_dendrites_carry_half_of_a_weight_each():
    """A threshold may therefore be twice as large, and one mantissa more for rounding."""

    def threshold_with(strategy):
        network = single(NEURON, [[1000.0]])
        quantized = quantize(network, CHIP, weight_bits=8, strategy=strategy)
        return quantized.populations[0].neuron.threshold.tolist()

    assert threshold_with("dendrite") == [1312]
    assert threshold_with("paired-dendrite") == [2640]


@pytest.mark.parametrize(
    ("strategy", "decays"),
    [("dendrite", (379, 401)), ("reset", (379, 401)), ("delay-line", (390, 390))],
)
def test_two_decays_are_fitted_unless_taps_need_a_single_one(strategy, decays):
    """390 is the nearest decay to a time constant of 10; 379 and 401 together have a response nearer to the kernel."""
    (population,) = quantize(
        single(NEURON),
        CHIP,
        weight_bits=8,
        strategy=strategy,
        rounding=Rounding(fitted_decays=True),
    ).populations
    assert (population.neuron.decay_u[0], population.neuron.decay_v[0]) == decays


def test_refractory_mantissas_are_rounded_for_each_threshold():
    """An own spike of 0.1 thresholds weighs 5.0 mantissas at a threshold of 50, and 0.7 at one of 7."""
    charge = dendrite_charge(with_own_charge(0.1), "n")
    thresholds, mantissas, exponent = whole_mantissas(charge, np.array([50.0, 7.0]), GRID)
    assert thresholds.tolist() == [50, 7]
    assert mantissas.tolist() == [-5, -1]
    assert exponent == 0


def test_decays_are_the_nearest():
    shares_lost = np.array([0.0, 1.4 / 4096, 0.25, 1.0])
    assert nearest_decays(shares_lost, "n").tolist() == [0, 1, 1024, 4096]


def test_charges_with_which_a_dendrite_gives_a_response():
    """Current and voltage keep half: charge(k) = r(k) - r(k - 1) + r(k - 2) / 4."""
    response = np.array([[1.0], [2.0], [3.0], [4.0]])
    assert own_charges(response, 0.5).tolist() == [[1.0], [1.0], [1.25], [1.5]]


def test_shares_of_two_dendrites_add_up():
    first, second = shares(np.array([5, -7, 8]), dendrites=2, step=1)
    assert first.tolist() == [2, -3, 4]
    assert second.tolist() == [3, -4, 4]


def test_weights_of_one_sign_make_one_synapse_list():
    network = single(Cuba.of(2, **ONE), [[0.5, 0.0], [0.25, 0.5]])
    (synapses,) = lower(network, CHIP, weight_bits=8).compartments.synapses
    assert synapses.sign_mode == "excitatory"
    assert len(synapses.mantissa) == 3
