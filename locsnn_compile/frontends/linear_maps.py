"""Linear layers of other frameworks (convolution, pooling) as sparse matrices (outputs, inputs).

The chip has only synapses, so a layer with shared weights is written out. Images (channels, height, width) are
flattened in C order.
"""

import functools
import math
from typing import Any

import numpy as np
from scipy import sparse

from hw_model.values import AnyArray, Frozen
from locsnn_compile.errors import InputError, check_most, counted

Shape = tuple[int, ...]
"""The shape of an image or of a flat layer, without a batch axis."""
Ints = tuple[int, ...]
"""One whole number per spatial axis."""

MAX_ENTRIES = 10_000_000
"""Largest number of connections of one layer: more than the synapse memories of ten chips hold."""
MAX_SIZE = 1_000_000
"""Largest number of neurons or lines of one layer: as many as eight chips of 128 cores hold."""


MAX_PADDING = 10_000
"""Largest padding at an end of an axis, in pixels: more than a square image of :data:`MAX_SIZE` pixels is wide."""


def check_shape(shape: Shape, where: str) -> None:
    """Refuse a layer without neurons or lines, or with too many."""
    if math.prod(shape) > MAX_SIZE or min(shape, default=0) < 1:
        raise InputError(
            where,
            "its size is out of range",
            measured=f"{shape} against 1 to {MAX_SIZE}",
            fix="Correct.",
        )


def check_entries(entries: int, where: str) -> None:
    """Refuse a layer with too many connections to expand."""
    check_most(entries, MAX_ENTRIES, where, "too many connections", fix="Give a smaller layer.")


class Window(Frozen):
    """How a kernel slides over an image: ``stride`` and ``dilation`` per spatial axis.

    ``ends`` are the numbers of pixels of value 0 that pad each axis, before and after the image.
    """

    stride: Ints
    ends: tuple[tuple[int, int], ...]
    dilation: Ints

    @classmethod
    def padded(cls, stride: Ints, padding: Ints, dilation: Ints, fill: Ints = (0, 0)) -> "Window":
        """Return a window with the same padding before and after each axis, and ``fill`` more after it."""
        # Not strict: the default fill has two zeros, and an image may have one axis.
        ends = tuple((p, p + more) for p, more in zip(padding, fill, strict=False))
        return cls(stride, ends, dilation)


def convolution(
    weight: AnyArray, input_shape: Shape, window: Window, *, groups: int, where: str
) -> tuple[Any, Shape]:
    """Return the matrix and the output shape (out, *spatial) of a convolution as torch defines it (no kernel flip).

    ``weight`` is (out, in / groups, *kernel), ``input_shape`` (in, *spatial). The values of the matrix have the type of
    the weights.
    """
    _check_convolution(weight, input_shape, window, groups, where)
    outs, per_group, *kernel = weight.shape
    spatial = input_shape[1:]
    axes = list(zip(spatial, kernel, window.stride, window.ends, window.dilation, strict=True))
    # As torch documents it: floor((n + padding - dilation * (kernel - 1) - 1) / stride + 1).
    out_spatial = tuple((n + sum(ends) - d * (k - 1) - 1) // s + 1 for n, k, s, ends, d in axes)
    if min(out_spatial) < 1:
        measured = f"{tuple(kernel)} against {spatial}"
        raise InputError(
            where, "the kernel is larger than its input", measured=measured, fix="Pad the input."
        )
    size_out = math.prod(out_spatial)
    size_in = math.prod(spatial)
    check_entries(weight.size * size_out, where)
    # For each output pixel and tap of the kernel: the input pixel that is read, and whether it is inside the image.
    grid = np.indices((*out_spatial, *kernel), sparse=True)
    of_output = grid[: len(axes)]
    of_kernel = grid[len(axes) :]
    coordinates = [
        output * stride - before + tap * dilation
        for output, tap, (_, _, stride, (before, _), dilation) in zip(
            of_output, of_kernel, axes, strict=True
        )
    ]
    is_inside = functools.reduce(
        np.logical_and,
        [(0 <= at) & (at < size) for at, size in zip(coordinates, spatial, strict=True)],
    )
    # Pixels outside are clipped here, and dropped below.
    pixel = np.ravel_multi_index(np.broadcast_arrays(*coordinates), spatial, mode="clip")
    group = np.arange(outs) // (outs // groups)
    channel = group[:, None] * per_group + np.arange(per_group)
    # Four axes, flattened below: output channel, input channel of its group, output pixel, tap.
    is_connected, values, rows, columns = np.broadcast_arrays(
        is_inside.reshape(size_out, -1),
        weight.reshape(outs, per_group, 1, -1),
        np.arange(outs * size_out).reshape(outs, 1, size_out, 1),
        channel[:, :, None, None] * size_in + pixel.reshape(size_out, -1),
    )
    ends = (rows[is_connected], columns[is_connected])
    shape = (outs * size_out, input_shape[0] * size_in)
    return sparse.csr_array((values[is_connected], ends), shape=shape), (outs, *out_spatial)


def pooling(
    kernel: AnyArray, input_shape: Shape, window: Window, *, where: str
) -> tuple[Any, Shape]:
    """Return the matrix and the output shape of a kernel (height, width) that is applied to each channel.

    The kernel may have axes of length one in front.
    """
    channels = input_shape[0]
    check_entries(channels * kernel.size, where)
    # A convolution with one group per channel: every output channel sees only its own input channel.
    kernel_of_channel = np.tile(kernel, (channels, 1, 1, 1))
    return convolution(kernel_of_channel, input_shape, window, groups=channels, where=where)


def product(left: Any, right: Any, where: str) -> Any:
    """Return the sparse product of two matrices; raise ``InputError`` if it would become too large.

    The number of multiplications is known before the product is computed, and bounds its entries.
    """
    entries_of_column = np.diff(left.tocsc().indptr).astype(np.int64)
    entries_of_row = np.diff(right.tocsr().indptr)
    multiplications = int((entries_of_column * entries_of_row).sum())
    check_entries(min(multiplications, left.shape[0] * right.shape[1]), where)
    return sparse.csr_array(left @ right)


def _check_convolution(
    weight: AnyArray, input_shape: Shape, window: Window, groups: int, where: str
) -> None:
    """Raise ``InputError`` for a weight, groups or a window that do not fit the input."""
    axes = weight.ndim - 2
    if len(input_shape) != axes + 1 or 0 in weight.shape:
        raise InputError(
            where,
            "its input does not have the axes of its kernel",
            measured=f"input {input_shape}, weight {weight.shape}",
            fix="Give a shape (channels, ...).",
        )
    if groups < 1 or input_shape[0] != weight.shape[1] * groups or weight.shape[0] % groups:
        measured = f"{counted(input_shape[0], 'channel')}, {counted(groups, 'group')}, weight {weight.shape}"
        fix = "Correct the groups."
        raise InputError(
            where, "channels and groups do not fit the weight", measured=measured, fix=fix
        )
    if min(window.stride + window.dilation) < 1:
        measured = f"{window.stride}, {window.dilation}"
        raise InputError(
            where, "stride or dilation is below 1", measured=measured, fix="Correct it."
        )
    if not all(0 <= end <= MAX_PADDING for ends in window.ends for end in ends):
        fix = "Give numbers from 0 up."
        raise InputError(where, "its padding is not valid", measured=f"{window.ends}"[:80], fix=fix)
