"""Scales of neurons at the limits of registers and formats, worked out by hand: the last number that fits, and the next.

Registers hold 64 counts per unit; the charge has 2^21 of each sign, the current 2^23 and the bias 4095 * 2^7.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import hw_model as hw
from hw_model.arithmetic.fixed_point import weight_grid
from locsnn_compile.errors import TargetError
from locsnn_compile.network.neurons import Cuba, SoftCuba
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.passes.rounding.grades import Grades
from locsnn_compile.passes.rounding.task import exponent_and_threshold
from locsnn_compile.passes.srm.quantize import dendrite_charge, whole_mantissas
from tests.support.networks import NEURON, single

CHIP = hw.chip("loihi-sim")
EIGHT_BITS = weight_grid(8, "excitatory")
"""Mantissas from 0 to 255."""


def with_registers(**registers: int) -> hw.Chip:
    """Return loihi-sim with other registers."""
    return replace(CHIP, registers=replace(CHIP.registers, **registers))


def thresholds(neuron: Cuba, weights: object, chip: hw.Chip = CHIP) -> list[int]:
    """Return the threshold mantissas of neurons behind inputs with these weights."""
    return quantize(single(neuron, weights), chip).populations[0].neuron.threshold.tolist()


def test_the_threshold_of_a_readout_is_the_largest_that_a_charge_can_hold():
    """An input that keeps a potential at its threshold brings 1229 / 4096 of it per step, divided by the gain.

    The decay of 0.3 becomes 1229 / 4096. The gain is that of two geometric series: (1 - b b) / (1 - a b) with the shares
    a and b that neuron and chip keep.
    """
    decay = Fraction(1229, 4096)
    kept_by_neuron, kept_by_chip = 1 - Fraction(0.3), 1 - decay
    gain = (1 - kept_by_chip**2) / (1 - kept_by_neuron * kept_by_chip)
    neuron = Cuba.of(1, decay_u=1.0, decay_v=0.3, threshold=1e4)
    assert thresholds(neuron, [[1e-3]]) == [int(2**15 * gain / decay)]


def test_a_bias_of_4095_thresholds_is_the_largest_with_the_least_threshold():
    def biased(bias: float) -> list[int]:
        return thresholds(Cuba.of(1, decay_v=1.0, threshold=1.0, bias=bias), [[0.0]])

    assert biased(4095.0) == [1]
    with pytest.raises(TargetError) as error:
        biased(4095.01)
    assert str(error.value) == (
        "population 'n': no scale holds both the threshold and the largest bias (one bias reaches 4095.01 thresholds "
        "against 4095). Train with smaller biases, or a higher threshold."
    )


def test_the_largest_charge_of_any_neuron_limits_the_threshold():
    """A hundred weights of one threshold are 2^15 units with a mantissa of 327; the second neuron has one such weight.

    Below that, the largest threshold at which a weight of one threshold has all eight bits is 255.
    """
    neuron = Cuba.of(2, decay_u=0.5, decay_v=0.25, threshold=1.0)
    weights = np.zeros((2, 100))
    weights[0] = 1.0
    weights[1, 0] = 1.0
    assert thresholds(neuron, weights) == [255, 255]


@pytest.mark.parametrize(("decay", "threshold"), [(1, 255 * 8), (2, 255 * 16)])
def test_a_current_that_is_the_voltage_adds_up_over_all_the_steps_that_it_lasts(decay, threshold):
    """A weight of each sign adds up to 2 * 4096 / decay thresholds, of which 2^24 units hold 2048 for a decay of 1.

    The current has 30 bits here, so that it limits the threshold, rather than the bits of weights.
    """
    neuron = Cuba.of(1, decay_u=decay / 4096, decay_v=1.0, threshold=1.0)
    assert thresholds(neuron, [[1.0, -1.0]], with_registers(current_bits=30)) == [threshold]


def test_a_current_without_memory_has_room_for_all_inputs_of_a_step():
    """Four weights of 10 thresholds come in one step. A current of 17 bits holds 2048 units, so 40 thresholds of 51.

    On loihi-sim the charge is the limit: 2^15 units hold 40 thresholds of 819, and 816 is the largest below that for
    which 10 thresholds are a weight, 255 * 2^5.
    """
    neuron = Cuba.of(1, decay_u=1.0, decay_v=1.0, threshold=1.0)
    heavy = [[10.0] * 4]
    assert thresholds(neuron, heavy, with_registers(current_bits=17)) == [51]
    assert thresholds(neuron, heavy) == [816]


def test_two_own_synapses_hold_a_drop_of_all_their_bits():
    """255 * 2^7 and 127 units; a register that holds more does not help."""
    chip = with_registers(charge_bits=23, current_bits=25, voltage_bits=25)

    def own_synapses(drop: float) -> list[tuple[int, int]]:
        neuron = SoftCuba.of(1, decay_u=1.0, decay_v=0.1, threshold=1.0, drop=drop)
        own = quantize(single(neuron, [[0.5]]), chip).populations[0].neuron.refractory
        return list(zip(own.mantissa.ravel().tolist(), own.exponent.tolist(), strict=True))

    assert own_synapses(32767.0) == [(-255, 7), (-127, 0)]
    with pytest.raises(TargetError) as error:
        own_synapses(32768.0)
    assert str(error.value) == (
        "population 'n': no scale holds both the threshold and the drop of a spike (a spike takes 3.28e+04 thresholds "
        "against 32767). Train with a smaller drop, or a higher threshold."
    )


@pytest.mark.parametrize(
    ("headroom", "heaviest", "expected"),
    [(1, 0.0, (0, 512)), (1, 1.0, (1, 510)), (4, 0.0, (0, 128)), (4, 1.0, (0, 128))],
    ids=["one threshold", "one threshold, and a weight", "four", "four, and a weight"],
)
def test_a_narrow_current_holds_so_many_thresholds(headroom, heaviest, expected):
    """2^15 counts are 512 units. A weight of one threshold has the mantissa 255 with the exponent 1 at a threshold of 510."""
    narrow = with_registers(current_bits=15)
    scale = exponent_and_threshold(heaviest, EIGHT_BITS, narrow, 10**6, 0, headroom)
    assert scale == expected


# --- own spikes of neurons with a refractory kernel ---


@pytest.mark.parametrize(
    ("charge", "exact_thresholds", "expected"),
    [
        # A charge of at most 0.1 units rounds to 0.
        (0.001, [100.5, 7.9], ([100, 7], [0, 0], 0)),
        # 201 / 2 - 1 / 64 is 100 units; a threshold of 0.6 has a weight of 1 unit, and is raised to 1.
        (2.0, [100.5, 0.6], ([100, 1], [-201, -1], 0)),
        # 30 / 0.3 is 100 units; 0.36 of a unit is less than a step, and rounds to 0.
        (0.3, [100.5, 1.2], ([100, 1], [-30, 0], 0)),
        # 100 / 9.50495 is 10.5208, of which a count of 1 / 64 is taken before it is rounded to 11.
        (100 * 48 / 505, [10.6], ([11], [-100], 0)),
    ],
    ids=["no charge", "at least 1", "less than a step", "a count less"],
)
def test_thresholds_for_which_own_weights_are_whole(charge, exact_thresholds, expected):
    mantissas, own, exponent = whole_mantissas(charge, np.array(exact_thresholds), EIGHT_BITS)
    assert (mantissas.tolist(), own.tolist(), exponent) == expected


@pytest.mark.parametrize(
    ("offset", "threshold"), [(0.2, 8150), (0.8, 8149)], ids=["just above", "just below"]
)
def test_a_refractory_weight_of_one_unit_chooses_the_threshold_at_which_it_rounds_best(
    offset, threshold
):
    """At a mantissa of 8150 - ``offset``, the weight would be 1 unit; mantissas from 8110 to 8191 are tried."""
    charge_of_1 = dendrite_charge(replace(NEURON, scale_ref=1.0), "n")
    scale_ref = 1 / (8150 - offset + 1 / 64) / charge_of_1
    network = single(replace(NEURON, scale_ref=scale_ref), [[0.5]])
    chip_neuron = quantize(network, CHIP, strategy="dendrite").populations[0].neuron
    assert chip_neuron.threshold.tolist() == [threshold]
    assert chip_neuron.refractory.mantissa.tolist() == [[-1]]


def delay_line(tau_ref: float, scale_ref: float, chip: hw.Chip = CHIP):
    """Return the self-synapses of a neuron with such a refractory kernel."""
    network = single(replace(NEURON, tau_ref=tau_ref, scale_ref=scale_ref), [[0.5]])
    return quantize(network, chip, strategy="delay-line").populations[0].neuron.refractory


@pytest.mark.parametrize(
    ("scale_ref", "exponents"),
    [(1.0, {0, 2, 5}), (2.0, {0, 3, 6}), (5.0, {0, 3, 7})],
    ids=["uneven", "even", "the largest"],
)
def test_three_exponents_are_spread_down_to_the_finest(scale_ref, exponents):
    """From the exponent of the largest charge, in steps that reach 0 with the third one."""
    assert set(delay_line(2.0, scale_ref).exponent.tolist()) == exponents


@pytest.mark.parametrize(
    ("tau_ref", "scale_ref", "chip", "measured"),
    [
        (30.0, 2.0, CHIP, ("63", "30", "0.3", "62")),
        # A kernel whose largest value is a hundredth of the threshold has the same relative error.
        (30.0, 0.01, CHIP, ("63", "30", "0.28", "62")),
        # No more than 256 are tried.
        (200.0, 2.0, with_registers(delay_max=300), ("256", "200", "0.85", "300")),
    ],
    ids=["large", "small", "many delays"],
)
def test_a_kernel_that_outlasts_all_delays_is_refused(tau_ref, scale_ref, chip, measured):
    with pytest.raises(TargetError) as error:
        delay_line(tau_ref, scale_ref, chip)
    taps, tau, deviation, longest = measured
    assert str(error.value) == (
        f"population 'n': {taps} delayed synapses cannot hold a kernel of tau_ref {tau} (an error of {deviation} against "
        f"0.1; loihi-sim has delay_max {longest}). Use strategy dendrite."
    )


@pytest.mark.parametrize(
    ("weight_bits", "magnitudes", "expected"),
    [(1, [1.0, 1.5, 2.0, 2.5, 9.0], [0, 1, 1, 2, 2]), (4, [14.0, 14.1, 28.0, 57.0], [0, 1, 1, 2])],
    ids=["one bit", "four bits"],
)
def test_a_weight_gets_the_finest_grade_that_holds_it_with_one_more_step(
    weight_bits, magnitudes, expected
):
    """Of 15 steps, four bits hold 14 and one more. One bit holds its only step, up to 1, 2 and 4 quanta."""
    grades = Grades(weight_bits, (0, 1, 2))
    assert grades.grade(np.array(magnitudes)).tolist() == expected
