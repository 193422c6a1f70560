"""The integer primitives of the arithmetic against exact fractions, and tables worked out by hand."""

from fractions import Fraction
from math import floor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw_model.arithmetic.fixed_point import (
    WEIGHT_BITS,
    WEIGHT_EXPONENTS,
    clip,
    decay,
    effective_weight,
    high_part_fits,
    kept_by_parts,
    wrap,
)

registers = st.integers(-(2**24), 2**24)
"""Values of registers of up to 24 bits. A decay d removes d / 4096 of a register in a step."""


@given(x=registers, d=st.integers(0, 4096))
def test_decay_truncates_toward_zero(x, d):
    exact = Fraction(x) * (4096 - d) / 4096
    assert decay(np.array([x]), d)[0] == int(exact)  # int() of a Fraction truncates toward zero


@pytest.mark.parametrize(
    ("x", "d", "expected"),
    [(-1, 0, -1), (-1, 1, 0), (1, 4095, 0), (-4097, 4095, -1), (2**23 - 1, 4096, 0), (8191, 2048, 4095), (-8191, 2048, -4095)],
    ids=["kept", "one lost", "one left of none", "negative keeps sign", "nothing left", "half", "half negative"],
)  # fmt: skip
def test_decay_of_values_worked_out_by_hand(x, d, expected):
    assert decay(np.array([x]), np.array([d]))[0] == expected


def sign_bits(values, bits):
    """Return the highest ``bits`` bits of small values: all set if negative, else none."""
    return np.where(values < 0, 2**bits - 1, 0)


@given(x=registers, d=st.integers(0, 4096))
def test_parts_of_a_register_keep_what_the_whole_keeps(x, d):
    exact = Fraction(x) * (4096 - d) / 4096
    keep = np.array([4096 - d])
    by_parts = kept_by_parts(np.array([x]), keep, sign_bits, lambda high: high)
    assert by_parts[0] == int(exact)


@given(largest=registers.map(abs), bits=st.integers(2, 16))
def test_a_high_part_fits_where_those_of_both_ends_do(largest, bits):
    high_parts = (largest >> 12, -largest >> 12)
    limit = 2 ** (bits - 1)
    fits = all(-limit <= high < limit for high in high_parts)
    assert high_part_fits(largest, bits) == fits


def test_a_high_part_may_use_all_its_bits_and_no_more():
    assert high_part_fits(2**19 - 1, 8)
    assert not high_part_fits(2**19, 8)


def test_widths_and_exponents_are_those_of_the_chip():
    """They are written out from the table of formats in the chip's description."""
    assert WEIGHT_BITS == (1, 2, 3, 4, 5, 6, 8)
    assert [*WEIGHT_EXPONENTS] == [-8, -7, -6, -5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5, 6, 7]


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
