"""The layers of a slayerPytorch checkpoint as matrices: dense ones by themselves, others by the YAML's list."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy import sparse

from locsnn_compile.errors import InputError
from locsnn_compile.frontends.linear_maps import Shape, check_entries, convolution
from locsnn_compile.frontends.slayer.config import LayerEntry
from locsnn_compile.network.matrices import Matrix
from locsnn_compile.network.neurons import FloatArray


def dense_layer(kernel: FloatArray, where: str) -> FloatArray:
    """Return the matrix (out, in) of a layer that sees its whole input, an image (channels, height, width) or not."""
    if kernel.ndim == 2 or (kernel.ndim == 5 and kernel.shape[4] == 1):
        if math.prod(kernel.shape):
            return kernel.reshape(len(kernel), -1)
    raise InputError(
        where,
        "it is no dense layer",
        measured=f"weight {kernel.shape}",
        fix="Use slayer.dense layers, or list all layers in the YAML, as layer: [{dim: 34x34x2}, {dim: 16c5z}, ...].",
    )


def listed_layers(
    kernels: Mapping[str, FloatArray], entries: tuple[LayerEntry, ...], where: str
) -> dict[str, tuple[Matrix, int]]:
    """Return the matrix and the channels of every kernel, which are those of the list behind its input, in order."""
    weighted = entries[1:]
    if len(weighted) != len(kernels):
        raise InputError(
            where, "the YAML lists another number of layers", measured=f"{len(weighted)} against {len(kernels)}",
            fix="List the input and every layer that has weights.",
        )  # fmt: skip
    width, height, channels = entries[0].numbers
    shape: Shape = (channels, height, width)
    found: dict[str, tuple[Matrix, int]] = {}
    for (name, kernel), entry in zip(kernels.items(), weighted, strict=True):
        matrix, shape = _listed(kernel, entry, shape, f"{where}, layer {name!r}")
        found[name] = matrix, shape[0]
    return found


def _listed(kernel: FloatArray, entry: LayerEntry, given: Shape, where: str) -> tuple[Matrix, Shape]:
    if entry.kind == "dense":
        (size,) = entry.numbers
        if kernel.size != size * math.prod(given):
            raise _other(kernel, f"{size} x {math.prod(given)}", where)
        return kernel.reshape(size, -1), (size, 1, 1)
    # Of an image of one row, convolutions have kernels of one row.
    flat = given[1] == 1
    side = entry.numbers[-1]
    window = (1 if flat and entry.kind == "conv" else side, side)
    stride, dilation = (((1, n) if flat and entry.kind == "conv" else (n, n)) for n in (entry.stride, entry.dilation))
    if entry.kind == "pool":
        if kernel.size != math.prod(window):
            raise _other(kernel, f"{window}", where)
        check_entries(kernel.size * given[0], where)
        whole = np.tile(kernel.reshape(1, 1, *window), (given[0], 1, 1, 1))
        padded = (given[0], given[1] + -given[1] % side, given[2] + -given[2] % side)
        matrix, shape = convolution(
            whole, padded, stride=stride, padding=(0, 0), dilation=(1, 1), groups=given[0], where=where
        )
        inside = np.arange(math.prod(padded)).reshape(padded)[:, : given[1], : given[2]].ravel()
        return sparse.csr_array(matrix[:, inside]), shape
    inner = given[0] // max(entry.groups, 1)
    if kernel.size != entry.numbers[0] * inner * math.prod(window):
        raise _other(kernel, f"{(entry.numbers[0], inner, *window)}", where)
    return convolution(
        kernel.reshape(entry.numbers[0], inner, *window),
        given,
        stride=stride,
        padding=(0 if flat else entry.padding, entry.padding),
        dilation=dilation,
        groups=entry.groups,
        where=where,
    )


def _other(kernel: Any, wanted: str, where: str) -> InputError:
    return InputError(
        where,
        "its weights are not those that the YAML lists",
        measured=f"{kernel.shape} against {wanted}",
        fix="Give the YAML that this checkpoint was trained with.",
    )
