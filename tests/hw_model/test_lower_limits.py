"""Lower limits of voltages, which have the form 1 - 2^k: what a core stores, and the lowest above a given floor."""

import numpy as np
import pytest

import hw_model as hw
from hw_model.arithmetic.loihi import held_minimum
from hw_model.arithmetic.loihi_inverse import deepest_minimum

REGISTERS = hw.chip("loihi-sim").registers
LAST = 8_388_607
"""2^23 - 1, the end of the voltage register."""


@pytest.mark.parametrize(
    ("depth", "vmin"),
    [
        pytest.param(0.0, 0, id="no floor"),
        pytest.param(0.99, 0, id="less than one unit"),
        pytest.param(1.0, -1, id="exactly a limit"),
        pytest.param(62.9, -31, id="just above a limit"),
        pytest.param(63.0, -63, id="at the next limit"),
        pytest.param(1e12, -LAST, id="beyond the register"),
    ],
)
def test_the_deepest_lower_limit_within_a_floor(depth, vmin):
    assert deepest_minimum(depth, REGISTERS) == vmin


def test_a_lower_limit_beyond_the_register_is_the_end_of_the_register():
    limits = np.array([0, -1, -63, -LAST, 1 - 2**24, 1 - 2**31])
    assert held_minimum(limits, REGISTERS).tolist() == [0, -1, -63, -LAST, -LAST, -LAST]


def test_a_lower_limit_of_another_form_is_left_to_the_check_that_refuses_it():
    limits = np.array([-2, 1 - 2**32])
    assert held_minimum(limits, REGISTERS).tolist() == limits.tolist()


def test_the_ends_of_registers_follow_from_their_bits():
    assert (REGISTERS.half_charge, REGISTERS.half_current) == (2**21, 2**23)
    assert (REGISTERS.voltage_max, REGISTERS.bias_mantissa_max) == (2**23 - 1, 2**12 - 1)
