"""Conversions between shares, units and counts of registers and the settings of a Loihi core, worked out by hand."""

import numpy as np
import pytest

import hw_model as hw
from hw_model.arithmetic import loihi, loihi_inverse

REGISTERS = hw.chip("loihi-sim").registers


def test_a_decay_is_what_a_step_does_not_keep_of_4096():
    assert [loihi_inverse.decay_of(keep) for keep in (0, 1000, 4096)] == [4096, 3096, 0]
    assert [loihi.keep_of(decay) for decay in (0, 1000, 4096)] == [4096, 3096, 0]


def test_shares_of_a_decay_are_4096ths():
    assert (loihi_inverse.share_lost(1024), loihi_inverse.share_kept(1024)) == (0.25, 0.75)
    assert loihi_inverse.nearest_decay(np.array([0.0, 0.25, 1.0])).tolist() == [0, 1024, 4096]


def test_a_register_that_loses_a_quarter_settles_at_four_times_its_input():
    assert loihi_inverse.settled_gain(1024) == 4.0


def test_a_unit_is_64_counts_of_a_register():
    assert (loihi.in_units(96), loihi.in_registers(1.5)) == (1.5, 96)
    assert loihi.whole_units(96) == 1


@pytest.mark.parametrize(
    ("exponent", "bits"), [(0, 6), (7, 13), (-6, 0)], ids=["a unit", "the largest", "a count"]
)
def test_a_power_of_two_of_units_is_one_of_counts(exponent, bits):
    assert loihi_inverse.bits_of_unit(exponent) == bits
    assert loihi_inverse.exponent_of_bits(bits) == exponent


def test_the_largest_bias_and_the_lowest_voltage_that_spikes():
    assert loihi_inverse.largest_bias(REGISTERS) == 4095 << 7
    assert loihi_inverse.least_to_spike(5) == 5 * 64 + 1
