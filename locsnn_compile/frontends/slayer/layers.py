"""Turn the layers of a slayerPytorch checkpoint into matrices, and check the kernels that it contains.

Layers are dense, or convolutions and pooling if the YAML lists them.

slayerPytorch samples ``k / tau * exp(1 - k / tau)``, times a factor, and stops at the first step beyond tau whose value
is below 0.01. For the published neuron, 77 taps of the input kernel and 11 of the refractory kernel remain. The chip's
dendrites are recursive filters with the whole tail, and a chip's delays (62 steps) could not cut it.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hw_model.values import FloatArray
from locsnn_compile.errors import InputError, check_same
from locsnn_compile.frontends.linear_maps import Shape, Window, convolution, pooling
from locsnn_compile.frontends.slayer.config import LayerEntry, LoihiNeuron, SlayerConfig
from locsnn_compile.network.neurons import SrmAlpha, alpha_taps
from locsnn_compile.network.projections import Matrix

_CLOSE = 1e-3
"""Largest difference of a stored kernel from that of the YAML, as a share of its peak: files have float32."""


def dense_layer(kernel: FloatArray, where: str) -> tuple[Matrix, int]:
    """Return the matrix (out, in) and the number of output channels of a dense layer.

    Its input may be an image (channels, height, width); slayerPytorch's kernels have a fifth axis, of time.
    """
    if kernel.size and (kernel.ndim == 2 or (kernel.ndim == 5 and kernel.shape[4] == 1)):
        return kernel.reshape(len(kernel), -1), len(kernel)
    fix = "Use slayer.dense layers, or list all layers in the YAML, as layer: [{dim: 34x34x2}, {dim: 16c5z}, ...]."
    raise InputError(where, "it is not a dense layer", measured=f"weight {kernel.shape}", fix=fix)


def listed_layers(
    kernels: Mapping[str, FloatArray], entries: tuple[LayerEntry, ...], where: str
) -> dict[str, tuple[Matrix, int]]:
    """Return the matrix and the number of output channels of every layer, by name.

    ``entries`` begin with the input; the others belong to the kernels in their order.
    """
    weighted = entries[1:]
    what = "the YAML lists a different number of layers"
    fix = "List the input and every layer that has weights."
    check_same(len(weighted), len(kernels), where, what, fix=fix)
    width, height, channels = entries[0].numbers
    shape: Shape = (channels, height, width)
    layers: dict[str, tuple[Matrix, int]] = {}
    for (name, kernel), entry in zip(kernels.items(), weighted, strict=True):
        matrix, shape = _listed_layer(kernel, entry, shape, f"{where}, layer {name!r}")
        layers[name] = matrix, shape[0]
    return layers


def _listed_layer(
    kernel: FloatArray, entry: LayerEntry, input_shape: Shape, where: str
) -> tuple[Matrix, Shape]:
    """Return the matrix and the output shape (channels, height, width) of a layer that the YAML lists."""
    if entry.kind == "dense":
        (size,) = entry.numbers
        inputs = math.prod(input_shape)
        return _reshaped(kernel, (size, inputs), f"{size} x {inputs}", where), (size, 1, 1)
    side = entry.numbers[-1]
    shape = (side, side)
    stride = (entry.stride, entry.stride)
    padding = (entry.padding, entry.padding)
    dilation = (entry.dilation, entry.dilation)
    if input_shape[1] == 1 and entry.kind == "conv":
        # On an image with one row, convolutions have kernels with one row.
        shape = (1, side)
        stride = (1, entry.stride)
        padding = (0, entry.padding)
        dilation = (1, entry.dilation)
    fill: tuple[int, ...] = (0, 0)
    if entry.kind == "pool":
        # Rows and columns of 0 fill the last windows.
        fill = tuple(-n % side for n in input_shape[1:])
    window = Window.padded(stride, padding, dilation, fill)
    if entry.kind == "pool":
        weight = _reshaped(kernel, shape, f"{shape}", where)
        return pooling(weight, input_shape, window, where=where)
    weight_shape = (entry.numbers[0], input_shape[0] // max(entry.groups, 1), *shape)
    return convolution(
        _reshaped(kernel, weight_shape, f"{weight_shape}", where),
        input_shape,
        window,
        groups=entry.groups,
        where=where,
    )


def _reshaped(kernel: FloatArray, shape: Shape, shape_text: str, where: str) -> FloatArray:
    """Return weights in a shape that differs from their own by axes of length one, or joins the axes of an image.

    The latter is for dense layers (out, in) whose input is an image. Raises ``InputError`` for another number of
    weights, and for axes in another order.
    """
    axes = [n for n in kernel.shape if n != 1]
    axes_of_shape = [n for n in shape if n != 1]
    joins_image = len(shape) == 2 and (shape[0] == 1 or axes[:1] == axes_of_shape[:1])
    if kernel.size == math.prod(shape) and (axes == axes_of_shape or joins_image):
        return kernel.reshape(shape)
    raise InputError(
        where,
        "its weights are not those that the YAML lists",
        measured=f"{kernel.shape} against {shape_text}",
        fix="Give the YAML that this checkpoint was trained with.",
    )


def cut(neuron: SrmAlpha | LoihiNeuron) -> SrmAlpha:
    """Return neurons whose kernels end where slayerPytorch ends them; raise ``InputError`` for LOIHI neurons."""
    if not isinstance(neuron, SrmAlpha):
        raise InputError(
            "kernels 'cut'", "LOIHI neurons have no kernels", fix="Leave the option out."
        )
    return neuron.cut()


def check_kernels(tensors: Mapping[str, Any], config: SlayerConfig, where: str) -> None:
    """Raise ``InputError`` if the kernels that a checkpoint contains are not those of the description.

    The two files then belong to different models.
    """
    for key, values in tensors.items():
        module, _, name = key.rpartition(".")
        neuron = config.neuron_of(module)
        if name not in ("srmKernel", "refKernel") or not isinstance(neuron, SrmAlpha):
            continue
        if name == "srmKernel":
            expected = alpha_taps(neuron.tau_sr, 1.0)
        else:
            expected = alpha_taps(neuron.tau_ref, -neuron.scale_ref * neuron.theta)
        stored = values.reshape(-1)
        # The end of a kernel may differ by a tap, through rounding; compare the taps that both have.
        shared = min(len(stored), len(expected))
        peak = float(np.abs(expected).max(initial=0))
        difference = np.abs(stored[:shared] - expected[:shared]).max(initial=0.0)
        if difference > _CLOSE * max(peak, 1e-9):  # a kernel without taps has a peak of 0
            raise InputError(
                f"{where}, entry {key!r}",
                "the kernel is not that of the YAML",
                measured=f"{difference:.3g} apart",
                fix="Give the YAML that this checkpoint was trained with.",
            )
