"""The grids of weights that synapse formats can hold, by hand and against the nearest number of the grid."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw_model.arithmetic.fixed_point import SIGN_MODES, WEIGHT_BITS, weight_grid
from hw_model.errors import InputError


@pytest.mark.parametrize(
    ("bits", "mode", "step", "low", "high"),
    [
        (8, "mixed", 2, -256, 254),
        (8, "excitatory", 1, 0, 255),
        (8, "inhibitory", 1, -255, 0),
        (6, "mixed", 8, -256, 248),
        (6, "excitatory", 4, 0, 252),
        (2, "mixed", 128, -256, 128),
        (1, "excitatory", 128, 0, 128),
        (1, "inhibitory", 128, -128, 0),
        (1, "mixed", 256, -256, 0),
    ],
)
def test_the_grid_of_a_format_worked_out_by_hand(bits, mode, step, low, high):
    """By the table of :class:`hw_model.arithmetic.fixed_point.WeightGrid`, worked out by hand."""
    grid = weight_grid(bits, mode)
    assert (grid.step, grid.low, grid.high) == (step, low, high)


@given(
    bits=st.sampled_from(WEIGHT_BITS), mode=st.sampled_from(SIGN_MODES), value=st.floats(-400, 400)
)
def test_rounding_is_nearest_on_the_grid(bits, mode, value):
    grid = weight_grid(bits, mode)
    rounded = int(grid.round(np.array([value]))[0])
    assert not grid.off_grid(np.array([rounded]))[0]
    nearest = min(range(grid.low, grid.high + 1, grid.step), key=lambda m: abs(m - value))
    assert abs(rounded - value) == pytest.approx(abs(nearest - value))


def test_rounding_is_half_to_even():
    assert weight_grid(8, "mixed").round(np.array([1.0, 3.0, 5.0, -1.0, -3.0])).tolist() == [
        0,
        4,
        4,
        0,
        -4,
    ]


TRIED = np.array([-257, -256, -255, -8, -4, -2, -1, 0, 1, 4, 8, 248, 252, 254, 255, 256])


@pytest.mark.parametrize(
    ("bits", "mode", "on_grid"),
    [
        (8, "mixed", [-256, -8, -4, -2, 0, 4, 8, 248, 252, 254]),
        (8, "excitatory", [0, 1, 4, 8, 248, 252, 254, 255]),
        (8, "inhibitory", [-255, -8, -4, -2, -1, 0]),
        (6, "mixed", [-256, -8, 0, 8, 248]),
        (6, "excitatory", [0, 4, 8, 248, 252]),
    ],
)
def test_only_weights_on_the_grid_are_accepted(bits, mode, on_grid):
    assert TRIED[~weight_grid(bits, mode).off_grid(TRIED)].tolist() == on_grid


@pytest.mark.parametrize("bits", [0, 7, 9, -1])
def test_widths_that_no_format_has_are_refused(bits):
    with pytest.raises(InputError) as caught:
        weight_grid(bits, "mixed")
    assert (
        str(caught.value)
        == f"weight bits: no synapse format has {bits} bits. Choose one of 1, 2, 3, 4, 5, 6, 8."
    )


def test_an_unknown_sign_mode_is_refused_with_a_near_name():
    with pytest.raises(InputError) as caught:
        weight_grid(8, "exitatory")
    assert str(caught.value) == "sign mode: 'exitatory' does not exist. Did you mean 'excitatory'?"
