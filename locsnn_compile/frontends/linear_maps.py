"""Linear layers of other frameworks as sparse matrices (outputs, inputs); images are flattened in C order."""

import itertools
import math
from typing import Any

import numpy as np
from scipy import sparse

from hw_model.values import AnyArray, Frozen
from locsnn_compile.errors import InputError, check_most, counted

Shape = tuple[int, ...]
Ints = tuple[int, ...]

MAX_ENTRIES = 10_000_000
"""Largest number of connections of one layer: more than the synapse memories of ten chips hold."""
MAX_SIZE = 1_000_000
"""Largest number of neurons or lines of one layer: as many as eight chips of 128 cores hold."""


def check_shape(shape: Shape, where: str) -> None:
    """Refuse a layer without neurons or lines, or with too many."""
    if math.prod(shape) > MAX_SIZE or min(shape, default=0) < 1:
        raise InputError(where, "its size is out of range", measured=f"{shape} against 1 to {MAX_SIZE}", fix="Correct.")


def check_entries(entries: int, where: str) -> None:
    """Refuse a layer with too many connections to expand."""
    check_most(entries, MAX_ENTRIES, where, "too many connections", fix="Give a smaller layer.")


class Window(Frozen):
    """How a kernel slides over an image: one number per spatial axis; ``padding`` may also be ``same`` or ``valid``."""

    stride: Ints
    padding: Ints | str
    dilation: Ints

    def slid(self, spatial: Shape, kernel: Shape) -> Shape:
        """Return how many places the kernel has on each axis; below 1 if it does not fit."""
        return tuple(
            (n + sum(ends) - d * (k - 1) - 1) // max(s, 1) + 1
            for n, ends, d, k, s in zip(spatial, self.ends(kernel), self.dilation, kernel, self.stride, strict=True)
        )

    def ends(self, kernel: Shape) -> tuple[tuple[int, int], ...]:
        """Return the padding before and after each axis; of the words, only ``same`` pads."""
        if self.padding == "same":
            total = [d * (k - 1) for d, k in zip(self.dilation, kernel, strict=True)]
            return tuple((t // 2, t - t // 2) for t in total)
        return ((0, 0),) * len(kernel) if isinstance(self.padding, str) else tuple((p, p) for p in self.padding)


def convolution(weight: AnyArray, input_shape: Shape, window: Window, *, groups: int, where: str) -> tuple[Any, Shape]:
    """Return the matrix and the output shape (out, *spatial) of a convolution as torch defines it (no kernel flip).

    ``weight`` (out, in / groups, *kernel), ``input_shape`` (in, *spatial). The values have the type of the weights.
    """
    outs, per_group, kernel = weight.shape[0], weight.shape[1], weight.shape[2:]
    spatial = input_shape[1:]
    _check_convolution(weight, input_shape, window, groups, where)
    out_spatial = window.slid(spatial, kernel)
    if min(out_spatial) < 1:
        raise InputError(where, "the kernel is larger than its input", measured=f"{kernel} against {spatial}",
                         fix="Pad the input.")  # fmt: skip
    size_out, size_in = math.prod(out_spatial), math.prod(spatial)
    check_entries(outs * per_group * math.prod(kernel) * size_out, where)
    grid = np.indices(out_spatial).reshape(len(spatial), -1)
    channel = (np.arange(outs) // (outs // groups))[:, None] * per_group + np.arange(per_group)
    taps = weight.reshape(outs, per_group, -1)
    axes = list(zip(grid, window.stride, window.ends(kernel), window.dilation, strict=True))
    rows, columns, values = [], [], []
    for offset in itertools.product(*(range(k) for k in kernel)):
        at = np.stack([g * s - lead + o * d for (g, s, (lead, _), d), o in zip(axes, offset, strict=True)])
        held = np.flatnonzero(((at >= 0) & (at < np.array(spatial)[:, None])).all(axis=0))
        source = np.ravel_multi_index(tuple(at[:, held]), spatial)
        shape = (outs, per_group, len(held))
        rows.append(np.broadcast_to(np.arange(outs)[:, None, None] * size_out + held, shape).ravel())
        columns.append(np.broadcast_to(channel[:, :, None] * size_in + source, shape).ravel())
        values.append(np.broadcast_to(taps[:, :, int(np.ravel_multi_index(offset, kernel)), None], shape).ravel())
    placed = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sparse.csr_array(placed, shape=(outs * size_out, input_shape[0] * size_in)), (outs, *out_spatial)


def pooling(
    kernel: AnyArray, input_shape: Shape, window: Window, *, fill: Ints = (0, 0), where: str
) -> tuple[Any, Shape]:
    """Return the matrix and the output shape of a kernel (height, width) that is applied to each channel.

    The kernel may have axes of length one in front. ``fill`` is the number of silent rows and columns that are added
    behind an image (channels, height, width).
    """
    channels, *spatial = input_shape
    check_entries(channels * kernel.size, where)
    filled = (channels, *(n + more for n, more in zip(spatial, fill, strict=True)))
    weight = np.tile(kernel, (channels, 1, 1, 1))
    found, shape = convolution(weight, filled, window, groups=channels, where=where)
    if any(fill):
        inside = np.arange(math.prod(filled)).reshape(filled)[:, : spatial[0], : spatial[1]].ravel()
        found = sparse.csr_array(found[:, inside])
    return found, shape


def product(left: Any, right: Any, where: str) -> Any:
    """Return the sparse product of two maps; refuse one that would become too large."""
    work = int((np.diff(left.tocsc().indptr).astype(np.int64) * np.diff(right.tocsr().indptr)).sum())
    check_entries(min(work, left.shape[0] * right.shape[1]), where)
    return sparse.csr_array(left @ right)


def _check_convolution(weight: AnyArray, input_shape: Shape, window: Window, groups: int, where: str) -> None:
    axes = weight.ndim - 2
    if len(input_shape) != axes + 1 or 0 in weight.shape:
        measured = f"input {input_shape}, weight {weight.shape}"
        fix = "Give a shape (channels, ...)."
        raise InputError(where, "its input does not have the axes of its kernel", measured=measured, fix=fix)
    if groups < 1 or input_shape[0] != weight.shape[1] * groups or weight.shape[0] % groups:
        measured = f"{counted(input_shape[0], 'channel')}, {counted(groups, 'group')}, weight {weight.shape}"
        fix = "Correct the groups."
        raise InputError(where, "channels and groups do not fit the weight", measured=measured, fix=fix)
    stride, padding, dilation = window.stride, window.padding, window.dilation
    if min(stride) < 1 or min(dilation) < 1:
        raise InputError(where, "stride or dilation is below 1", measured=f"{stride}, {dilation}", fix="Correct it.")
    if padding == "same" and set(stride) != {1}:
        raise InputError(where, "padding 'same' needs stride 1", measured=f"{stride}", fix="Give numbers.")
    if padding not in ("same", "valid") if isinstance(padding, str) else min(padding) < 0 or max(padding) > 10_000:
        raise InputError(where, "its padding is not valid", measured=f"{padding!r}"[:80], fix="Give numbers from 0 up.")
