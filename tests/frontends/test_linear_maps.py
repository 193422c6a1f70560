"""Convolutions, pooling and products as sparse matrices: small ones written out, and sizes at the ends of their range."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from locsnn_compile.errors import InputError
from locsnn_compile.frontends import linear_maps
from locsnn_compile.frontends.linear_maps import (
    MAX_PADDING,
    MAX_SIZE,
    Window,
    check_shape,
    convolution,
    pooling,
    product,
)

PLAIN = Window.padded(stride=(1, 1), padding=(0, 0), dilation=(1, 1))
LINE = Window.padded(stride=(1,), padding=(0,), dilation=(1,))


@pytest.mark.parametrize(
    ("window", "expected"),
    [
        (LINE, [[1, 2, 0, 0], [0, 1, 2, 0], [0, 0, 1, 2]]),
        (Window.padded((2,), (0,), (1,)), [[1, 2, 0, 0], [0, 0, 1, 2]]),
        (Window.padded((2,), (1,), (1,)), [[2, 0, 0, 0], [0, 1, 2, 0], [0, 0, 0, 1]]),
        (Window.padded((1,), (0,), (2,)), [[1, 0, 2, 0], [0, 1, 0, 2]]),
        (Window.padded((2,), (0,), (1,), (2,)), [[1, 2, 0, 0], [0, 0, 1, 2], [0, 0, 0, 0]]),
    ],
    ids=["plain", "stride", "padding", "dilation", "fill"],
)
def test_a_kernel_of_two_taps_slides_over_four_pixels(window, expected):
    matrix, shape = convolution(np.array([[[1, 2]]]), (1, 4), window, groups=1, where="layer 0")
    assert (matrix.toarray().tolist(), shape) == (expected, (1, len(expected)))


def test_each_group_reads_its_own_channels():
    """Two groups of two input channels and one output channel each, with a kernel of one pixel."""
    weight = np.array([[[1], [2]], [[3], [4]]])
    matrix, shape = convolution(weight, (4, 1), LINE, groups=2, where="layer 0")
    assert (matrix.toarray().tolist(), shape) == ([[1, 2, 0, 0], [0, 0, 3, 4]], (2, 1))


def test_pooling_applies_its_kernel_to_each_channel():
    matrix, shape = pooling(np.full((1, 2), 5), (2, 1, 2), PLAIN, where="layer 0")
    assert (matrix.toarray().tolist(), shape) == ([[5, 5, 0, 0], [0, 0, 5, 5]], (2, 1, 1))


@pytest.mark.parametrize(
    ("weight", "input_shape", "window", "groups", "message"),
    [
        ((1, 1, 1, 1), (2, 2), PLAIN, 1, "its input does not have the axes of its kernel (input (2, 2), weight (1, 1, 1, 1)). Give a shape (channels, ...)."),
        ((1, 1, 1, 1), (2, 2, 2), PLAIN, 1, "channels and groups do not fit the weight (2 channels, 1 group, weight (1, 1, 1, 1)). Correct the groups."),
        ((3, 1, 1, 1), (2, 2, 2), PLAIN, 2, "channels and groups do not fit the weight (2 channels, 2 groups, weight (3, 1, 1, 1)). Correct the groups."),
        ((1, 1, 1, 1), (0, 2, 2), PLAIN, 0, "channels and groups do not fit the weight (0 channels, 0 groups, weight (1, 1, 1, 1)). Correct the groups."),
        ((1, 1, 1, 1), (1, 2, 2), Window.padded((0, 1), (0, 0), (1, 1)), 1, "stride or dilation is below 1 ((0, 1), (1, 1)). Correct it."),
        ((1, 1, 1, 1), (1, 2, 2), Window.padded((1, 1), (0, MAX_PADDING + 1), (1, 1)), 1, "its padding is not valid (((0, 0), (10001, 10001))). Give numbers from 0 up."),
        ((1, 1, 3, 1), (1, 2, 2), PLAIN, 1, "the kernel is larger than its input ((3, 1) against (2, 2)). Pad the input."),
    ],
    ids=["axes", "channels", "groups", "no group", "stride", "padding", "kernel"],
)  # fmt: skip
def test_a_convolution_that_does_not_fit_is_refused(weight, input_shape, window, groups, message):
    with pytest.raises(InputError) as error:
        convolution(np.ones(weight), input_shape, window, groups=groups, where="layer 0")
    assert str(error.value) == f"layer 0: {message}"


@pytest.mark.parametrize("shape", [(1,), (MAX_SIZE,), (10, MAX_SIZE // 10)])
def test_layers_of_up_to_a_million_neurons_are_accepted(shape):
    check_shape(shape, "layer 0")


@pytest.mark.parametrize("shape", [(), (0, 5), (MAX_SIZE + 1,), (2, MAX_SIZE)])
def test_layers_without_neurons_or_with_too_many_are_refused(shape):
    with pytest.raises(InputError) as error:
        check_shape(shape, "layer 0")
    assert str(error.value) == (
        f"layer 0: its size is out of range ({shape} against 1 to {MAX_SIZE}). Correct."
    )


def refused(entries: int, most: int) -> str:
    """Return the message for a layer of too many connections."""
    return f"layer 0: too many connections ({entries} against {most}). Give a smaller layer."


def test_a_convolution_of_too_many_connections_is_refused_before_it_is_written_out(monkeypatch):
    """Two taps at each of three outputs are six connections."""
    weight = np.array([[[1, 2]]])
    monkeypatch.setattr(linear_maps, "MAX_ENTRIES", 6)
    convolution(weight, (1, 4), LINE, groups=1, where="layer 0")
    monkeypatch.setattr(linear_maps, "MAX_ENTRIES", 5)
    with pytest.raises(InputError) as error:
        convolution(weight, (1, 4), LINE, groups=1, where="layer 0")
    assert str(error.value) == refused(6, 5)


def test_a_product_has_no_more_entries_than_multiplications_or_places(monkeypatch):
    """Dense factors of 3 x 2 and 2 x 3 take 18 multiplications for 9 entries; with one entry each, they take one."""
    left = sparse.csr_array(np.ones((3, 2)))
    right = sparse.csr_array(np.ones((2, 3)))
    monkeypatch.setattr(linear_maps, "MAX_ENTRIES", 9)
    assert product(left, right, "layer 0").toarray().tolist() == [[2.0] * 3] * 3
    monkeypatch.setattr(linear_maps, "MAX_ENTRIES", 8)
    with pytest.raises(InputError) as error:
        product(left, right, "layer 0")
    assert str(error.value) == refused(9, 8)
    monkeypatch.setattr(linear_maps, "MAX_ENTRIES", 1)
    single = sparse.csr_array(([1.0], ([0], [0])), shape=(3, 2))
    assert product(single, single.T, "layer 0").nnz == 1
