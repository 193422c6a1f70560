"""Linear layers of other frameworks as sparse matrices (outputs, inputs), images flattened in C order."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from locsnn_compile.errors import InputError

Shape = tuple[int, ...]
Ints = tuple[int, ...]

MAX_ENTRIES = 10_000_000
"""Most connections of one layer: more than ten chips' synapse memories hold."""


def check_entries(entries: int, where: str) -> None:
    """Refuse a layer of more connections than are ever expanded."""
    if entries > MAX_ENTRIES:
        raise InputError(
            where, "too many connections", measured=f"{entries} against {MAX_ENTRIES}", fix="Give a smaller layer."
        )


def convolution(
    weight: npt.NDArray[Any],
    input_shape: Shape,
    *,
    stride: Ints,
    padding: Ints | str,
    dilation: Ints,
    groups: int,
    where: str,
) -> tuple[Any, Shape]:
    """Return the matrix and the output shape (out, *spatial) of a convolution as torch defines it (no kernel flip).

    ``weight`` (out, in / groups, *kernel), ``input_shape`` (in, *spatial); ``stride``, ``padding`` and ``dilation`` one
    number a spatial axis, ``padding`` also ``same`` or ``valid``. The values keep the weights' type.
    """
    outs, per_group, kernel = weight.shape[0], weight.shape[1], weight.shape[2:]
    spatial = input_shape[1:]
    _check_convolution(weight, input_shape, stride, dilation, groups, where)
    before, after = _padding(padding, kernel, stride, dilation, where)
    out_spatial = tuple(
        (n + lead + trail - d * (k - 1) - 1) // s + 1
        for n, lead, trail, d, k, s in zip(spatial, before, after, dilation, kernel, stride, strict=True)
    )
    if min(out_spatial) < 1:
        raise InputError(where, "the kernel is larger than its input", measured=f"{kernel} against {spatial}",
                         fix="Pad the input.")  # fmt: skip
    size_out, size_in = math.prod(out_spatial), math.prod(spatial)
    check_entries(outs * per_group * math.prod(kernel) * size_out, where)
    grid = np.indices(out_spatial).reshape(len(spatial), -1)
    channel = (np.arange(outs) // (outs // groups))[:, None] * per_group + np.arange(per_group)
    taps = weight.reshape(outs, per_group, -1)
    rows, columns, values = [], [], []
    for offset in itertools.product(*(range(k) for k in kernel)):
        at = np.stack([g * s - p + o * d for g, s, p, o, d in zip(grid, stride, before, offset, dilation, strict=True)])
        held = np.flatnonzero(((at >= 0) & (at < np.array(spatial)[:, None])).all(axis=0))
        source = np.ravel_multi_index(tuple(at[:, held]), spatial)
        shape = (outs, per_group, len(held))
        rows.append(np.broadcast_to(np.arange(outs)[:, None, None] * size_out + held, shape).ravel())
        columns.append(np.broadcast_to(channel[:, :, None] * size_in + source, shape).ravel())
        values.append(np.broadcast_to(taps[:, :, int(np.ravel_multi_index(offset, kernel)), None], shape).ravel())
    placed = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sparse.csr_array(placed, shape=(outs * size_out, input_shape[0] * size_in)), (outs, *out_spatial)


def pooling(
    kernel: Ints, input_shape: Shape, *, stride: Ints, padding: Ints, average: bool, where: str
) -> tuple[Any, Shape]:
    """Return the matrix and the output shape of sum or average pooling of images (channels, height, width).

    An average divides by the whole kernel, padding included, as torch does unless told otherwise.
    """
    if min(kernel) < 1:
        raise InputError(where, "its kernel is smaller than 1", measured=f"{kernel}", fix="Correct it.")
    each = 1.0 / math.prod(kernel) if average else 1.0
    check_entries(input_shape[0] * math.prod(kernel), where)
    weight = np.full((input_shape[0], 1, *kernel), each)
    ones = (1,) * len(kernel)
    return convolution(
        weight, input_shape, stride=stride, padding=padding, dilation=ones, groups=input_shape[0], where=where
    )


def product(left: Any, right: Any, where: str) -> Any:
    """Return the sparse product of two maps, one after the other; refuse one that would grow beyond all bounds."""
    work = int((np.diff(left.tocsc().indptr).astype(np.int64) * np.diff(right.tocsr().indptr)).sum())
    check_entries(min(work, left.shape[0] * right.shape[1]), where)
    return sparse.csr_array(left @ right)


def _check_convolution(
    weight: npt.NDArray[Any], input_shape: Shape, stride: Ints, dilation: Ints, groups: int, where: str
) -> None:
    axes = weight.ndim - 2
    if len(input_shape) != axes + 1 or 0 in weight.shape:
        raise InputError(
            where,
            "its input is no image of the kernel's axes",
            measured=f"input {input_shape}, weight {weight.shape}",
            fix="Give a shape (channels, ...).",
        )
    if groups < 1 or input_shape[0] != weight.shape[1] * groups or weight.shape[0] % groups:
        raise InputError(
            where,
            "channels and groups do not fit the weight",
            measured=f"{input_shape[0]} channels, {groups} groups, weight {weight.shape}",
            fix="Correct the groups.",
        )
    if min(stride) < 1 or min(dilation) < 1:
        raise InputError(where, "stride and dilation are at least 1", measured=f"{stride}, {dilation}", fix="Correct.")


def _padding(padding: Ints | str, kernel: Ints, stride: Ints, dilation: Ints, where: str) -> tuple[Ints, Ints]:
    """Return the padding before and after, one number an axis."""
    if isinstance(padding, str) and padding == "valid":
        return (0,) * len(kernel), (0,) * len(kernel)
    if padding == "same":
        if set(stride) != {1}:
            raise InputError(where, "padding 'same' needs stride 1", measured=f"{stride}", fix="Give numbers.")
        total = [d * (k - 1) for d, k in zip(dilation, kernel, strict=True)]
        return tuple(t // 2 for t in total), tuple(t - t // 2 for t in total)
    if isinstance(padding, str) or min(padding) < 0 or max(padding) > 10_000:
        raise InputError(where, "no such padding", measured=f"{padding!r}"[:80], fix="Give numbers from 0 on.")
    return padding, padding
