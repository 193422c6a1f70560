"""The weights of the artificial comparison networks, by the name of their parameter; nothing here imports torch."""

import math

from locsnn_compile.errors import InputError

FRAME = (9, 7)
"""Rows and columns of the frame that CNN-3D lays a fingertip's taxels out on."""
CONVOLUTIONS = (
    (4, (7, 3, 3), (4, 1, 1)),
    (8, (5, 3, 3), (3, 1, 1)),
)
"""Output channels, kernel and stride (steps, rows, columns) of CNN-3D's convolutions."""


def convolved(steps: int) -> list[tuple[int, int, int]]:
    """Return the size (steps, rows, columns) that each convolution of CNN-3D leaves of a recording."""
    size = (steps, *FRAME)
    sizes = []
    for _, kernel, stride in CONVOLUTIONS:
        size = tuple((n - k) // s + 1 for n, k, s in zip(size, kernel, stride, strict=True))  # type: ignore[assignment]
        if min(size) < 1:
            raise InputError(
                "network 'cnn-3d'",
                "the recording is too short for its two convolutions",
                measured=f"{steps} steps against at least 23",
                fix="Take longer recordings.",
            )
        sizes.append(size)
    return sizes


def ann_shapes(
    name: str, *, fingertips: int, channels: int, steps: int, classes: int, hidden: int
) -> dict[str, tuple[int, ...]]:
    """Return parameter name -> shape of ``gru-mlp`` or ``cnn-3d``; ``channels`` are those of one fingertip."""
    if name == "gru-mlp":
        return {
            "gru.weight_ih_l0": (3 * hidden, channels * fingertips),
            "gru.weight_hh_l0": (3 * hidden, hidden),
            "gru.bias_ih_l0": (3 * hidden,),
            "gru.bias_hh_l0": (3 * hidden,),
            "readout.weight": (classes, hidden),
            "readout.bias": (classes,),
        }
    shapes: dict[str, tuple[int, ...]] = {}
    inputs = 2
    for number, (outputs, kernel, _) in enumerate(CONVOLUTIONS, start=1):
        shapes[f"conv_{number}.weight"] = (outputs, inputs, *kernel)
        shapes[f"conv_{number}.bias"] = (outputs,)
        inputs = outputs
    features = fingertips * inputs * math.prod(convolved(steps)[-1])
    return shapes | {"readout.weight": (classes, features), "readout.bias": (classes,)}
