"""The linear nodes of a NIR graph as layers: weights, the constant beside them, and the shape of what they give."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from locsnn_compile.errors import InputError
from locsnn_compile.frontends.linear_maps import Shape, Window, check_entries, convolution, pooling
from locsnn_compile.frontends.nir.graph import NirNode
from locsnn_compile.network.neurons import FloatArray

WITH_WEIGHTS = ("Linear", "Affine", "Conv1d", "Conv2d", "SumPool2d", "AvgPool2d")


@dataclass(frozen=True, eq=False)
class Layer:
    """``weights`` (outputs, inputs), CSR, the ``constant`` (outputs,) beside them, and the outputs' shape."""

    weights: Any
    constant: FloatArray | float
    shape: Shape


def layer_of(node: NirNode, given: Shape | None, where: str) -> Layer | None:
    """Return the layer of a node of :data:`WITH_WEIGHTS`; None where it depends on what it is given, not yet known."""
    if node.kind in ("Linear", "Affine"):
        return _dense(node, where)
    if node.kind in ("Conv1d", "Conv2d"):
        image = _image(node, given, where)
        return None if image is None else _convolved(node, image, where)
    return None if given is None else _pooled(node, given, where)


def _dense(node: NirNode, where: str) -> Layer:
    weight = node.array("weight")
    if weight.ndim != 2:
        raise InputError(where, "its weight is no matrix", measured=f"{weight.shape}", fix="Give (outputs, inputs).")
    check_entries(weight.size, where)
    bias = node.each("bias", len(weight), "output", where) if node.kind == "Affine" else 0.0
    return Layer(sparse.csr_array(weight.astype(np.float64)), bias, (len(weight),))


def _image(node: NirNode, given: Shape | None, where: str) -> Shape | None:
    """Return the input shape (channels, *spatial) of a convolution, from itself or from what it is given."""
    weight, axes = node.array("weight"), _axes(node)
    if weight.ndim != axes + 2:
        raise InputError(where, "its weight has the wrong axes", measured=f"{weight.shape}", fix="Give (out, in, ...).")
    if "input_shape" in node.parameters:
        return (weight.shape[1] * _ints(node, "groups", 1, where)[0], *_ints(node, "input_shape", axes, where))
    if given is not None and len(_unbatched(given, axes)) != axes + 1:
        raise InputError(where, "it is given no image", measured=f"{given}", fix="Set its input_shape.")
    return None if given is None else _unbatched(given, axes)


def _convolved(node: NirNode, image: Shape, where: str) -> Layer:
    weight, groups = node.array("weight").astype(np.float64), _ints(node, "groups", 1, where)[0]
    weights, shape = convolution(weight, image, _window(node, where), groups=groups, where=where)
    bias = node.each("bias", shape[0], "channel", where)
    return Layer(weights, np.repeat(bias, math.prod(shape[1:])), shape)


def _pooled(node: NirNode, given: Shape, where: str) -> Layer:
    image, kernel = _unbatched(given, 2), _ints(node, "kernel_size", 2, where)
    if len(image) != 3:
        raise InputError(where, "it is given no image", measured=f"{given}", fix="Pool before flattening.")
    if min(kernel) < 1:
        raise InputError(where, "its kernel is smaller than 1", measured=f"{kernel}", fix="Correct it.")
    # An average divides by the whole kernel, padding included, as torch does unless told otherwise.
    each = 1.0 / math.prod(kernel) if node.kind == "AvgPool2d" else 1.0
    weights, shape = pooling(np.broadcast_to(each, kernel), image, _window(node, where), where=where)
    return Layer(weights, 0.0, shape)


def _axes(node: NirNode) -> int:
    return 1 if node.kind == "Conv1d" else 2


def _unbatched(given: Shape, axes: int) -> Shape:
    """Return the shape of an image: a leading axis of one is a batch that some exporters leave in."""
    return given[1:] if len(given) == axes + 2 and given[0] == 1 else given


def _window(node: NirNode, where: str) -> Window:
    """Return how the kernel slides."""
    axes, padding = _axes(node), node.parameters["padding"]
    dilation = _ints(node, "dilation", axes, where) if "dilation" in node.parameters else (1,) * axes
    slides = padding if isinstance(padding, str) else _ints(node, "padding", axes, where)
    return Window(_ints(node, "stride", axes, where), slides, dilation)


def _ints(node: NirNode, name: str, axes: int, where: str) -> tuple[int, ...]:
    """Return a parameter of whole numbers, one an axis; a single one stands for all."""
    values = node.array(name)
    if values.size not in (1, axes) or (values != np.rint(values)).any() or np.abs(values).max(initial=0) > 1e9:
        raise InputError(where, f"{name} must be {axes} whole numbers", measured=f"{values.shape}", fix="Correct it.")
    return tuple(int(v) for v in np.broadcast_to(values.reshape(-1), (axes,)))
