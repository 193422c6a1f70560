"""Arithmetic primitives against exact rational arithmetic."""

from fractions import Fraction
from math import floor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw_model.arithmetic.fixed_point import clip, decay, effective_weight, wrap

registers = st.integers(-(2**24), 2**24)


@given(x=registers, d=st.integers(0, 4096))
def test_decay_truncates_toward_zero(x, d):
    exact = Fraction(x) * (4096 - d) / 4096
    assert decay(np.array([x]), d)[0] == int(exact)  # int() of a Fraction truncates toward zero


@pytest.mark.parametrize(
    ("x", "d", "left"),
    [(-1, 0, -1), (-1, 1, 0), (1, 4095, 0), (-4097, 4095, -1), (2**23 - 1, 4096, 0), (8191, 2048, 4095), (-8191, 2048, -4095)],
    ids=["kept", "one lost", "one left of none", "negative keeps sign", "nothing left", "half", "half negative"],
)  # fmt: skip
def test_decay_table(x, d, left):
    assert decay(np.array([x]), np.array([d]))[0] == left


@given(x=st.integers(-(2**40), 2**40), bits=st.sampled_from([21, 23]))
def test_wrap_is_congruent_and_in_range(x, bits):
    wrapped = int(wrap(np.array([x]), bits)[0])
    assert (wrapped - x) % 2 ** (bits + 1) == 0
    assert -(2**bits) <= wrapped < 2**bits


@given(m=st.integers(-256, 255), e=st.integers(-8, 7))
def test_effective_weight_floors_what_a_negative_exponent_loses(m, e):
    assert effective_weight(np.array([m]), e)[0] == 64 * floor(Fraction(m) * Fraction(2) ** e)


@given(x=registers, low=registers, span=st.integers(0, 2**24))
def test_clip_is_nearest_in_range(x, low, span):
    clipped = int(clip(np.array([x]), low, low + span)[0])
    assert low <= clipped <= low + span
    assert (clipped == x) == (low <= x <= low + span)
