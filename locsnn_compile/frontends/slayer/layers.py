"""The layers of a slayerPytorch checkpoint as matrices (dense ones, or those listed in the YAML), and its kernels.

slayerPytorch samples ``k / tau * exp(1 - k / tau)``, times a factor, and stops at the first step beyond tau whose value
is below 0.01. For the published neuron, 77 taps of the input kernel and 11 of the refractory kernel remain. Recursive
dendrites have the whole tail, and a chip's delays (62 steps) could not cut it.
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


def dense_layer(kernel: FloatArray, where: str) -> tuple[Matrix, int]:
    """Return the matrix (out, in) and the channels of a layer that sees its whole input.

    The input may be an image (channels, height, width).
    """
    if kernel.size and (kernel.ndim == 2 or (kernel.ndim == 5 and kernel.shape[4] == 1)):
        return kernel.reshape(len(kernel), -1), len(kernel)
    fix = "Use slayer.dense layers, or list all layers in the YAML, as layer: [{dim: 34x34x2}, {dim: 16c5z}, ...]."
    raise InputError(where, "it is not a dense layer", measured=f"weight {kernel.shape}", fix=fix)


def listed_layers(
    kernels: Mapping[str, FloatArray], entries: tuple[LayerEntry, ...], where: str
) -> dict[str, tuple[Matrix, int]]:
    """Return the matrix and the channels of every kernel; the entries after the input belong to them in order."""
    weighted = entries[1:]
    what = "the YAML lists a different number of layers"
    fix = "List the input and every layer that has weights."
    check_same(len(weighted), len(kernels), where, what, fix=fix)
    width, height, channels = entries[0].numbers
    shape: Shape = (channels, height, width)
    listed: dict[str, tuple[Matrix, int]] = {}
    for (name, kernel), entry in zip(kernels.items(), weighted, strict=True):
        matrix, shape = _listed(kernel, entry, shape, f"{where}, layer {name!r}")
        listed[name] = matrix, shape[0]
    return listed


def _listed(
    kernel: FloatArray, entry: LayerEntry, input_shape: Shape, where: str
) -> tuple[Matrix, Shape]:
    if entry.kind == "dense":
        (size,) = entry.numbers
        inputs = math.prod(input_shape)
        return _shaped(kernel, (size, inputs), f"{size} x {inputs}", where), (size, 1, 1)
    # On an image with one row, convolutions have kernels with one row.
    side = entry.numbers[-1]
    shape = (side, side)
    stride = (entry.stride, entry.stride)
    padding = (entry.padding, entry.padding)
    dilation = (entry.dilation, entry.dilation)
    if input_shape[1] == 1 and entry.kind == "conv":
        shape = (1, side)
        stride = (1, entry.stride)
        padding = (0, entry.padding)
        dilation = (1, entry.dilation)
    fill: tuple[int, ...] = (0, 0)
    if entry.kind == "pool":
        # Silent rows and columns fill the last windows.
        fill = tuple(-n % side for n in input_shape[1:])
    window = Window.padded(stride, padding, dilation, fill)
    if entry.kind == "pool":
        return pooling(_shaped(kernel, shape, f"{shape}", where), input_shape, window, where=where)
    whole = (entry.numbers[0], input_shape[0] // max(entry.groups, 1), *shape)
    return convolution(
        _shaped(kernel, whole, f"{whole}", where),
        input_shape,
        window,
        groups=entry.groups,
        where=where,
    )


def _shaped(kernel: FloatArray, shape: Shape, wanted: str, where: str) -> FloatArray:
    """Return weights in a shape, up to axes of length one, and with the axes of an image as one where it is seen whole.

    Another number of weights is refused, and so are axes in another order.
    """
    axes, wanted_axes = ([n for n in sizes if n != 1] for sizes in (kernel.shape, shape))
    in_order = axes == wanted_axes or (
        len(shape) == 2 and (shape[0] == 1 or axes[:1] == wanted_axes[:1])
    )
    if kernel.size == math.prod(shape) and in_order:
        return kernel.reshape(shape)
    what, fix = (
        "its weights are not those that the YAML lists",
        "Give the YAML that this checkpoint was trained with.",
    )
    raise InputError(where, what, measured=f"{kernel.shape} against {wanted}", fix=fix)


def cut(neuron: SrmAlpha | LoihiNeuron) -> SrmAlpha:
    """Return neurons whose kernels end where slayerPytorch ends them; ``InputError`` for neurons without kernels."""
    if not isinstance(neuron, SrmAlpha):
        raise InputError(
            "kernels 'cut'", "LOIHI neurons have no kernels", fix="Leave the option out."
        )
    return neuron.cut()


def check_kernels(tensors: Mapping[str, Any], config: SlayerConfig, where: str) -> None:
    """Refuse kernels in a checkpoint that are not those of the description: both must be of one model."""
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
        shared = min(len(stored), len(expected))
        scale = max(float(np.abs(expected).max(initial=0)), 1e-9)
        apart = np.abs(stored[:shared] - expected[:shared]).max(initial=0.0)
        if apart > _CLOSE * scale:
            raise InputError(
                f"{where}, entry {key!r}",
                "the kernel is not that of the YAML",
                measured=f"{apart:.3g} apart",
                fix="Give the YAML that this checkpoint was trained with.",
            )
