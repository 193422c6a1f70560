"""Shapes of the weights of the conventional networks that spiking ones are compared with.

``gru-mlp`` is a recurrent network and ``cnn-3d`` a convolutional one over steps, rows and columns of a
sensor. Parameters have the names that torch gives them, but nothing here imports torch.
"""

import math

from locsnn_compile.data.sensor import SensorLayout, frame_size
from locsnn_compile.errors import InputError, counted

CONVOLUTIONS = ((4, (7, 3, 3), (4, 1, 1)), (8, (5, 3, 3), (3, 1, 1)))
"""Output channels, kernel and stride (steps, rows, columns) of CNN-3D's convolutions: Kang et al., IJCNN 2022."""
LEAST_STEPS = 23
"""The shortest recording for both convolutions.

The second one needs 5 steps, and (23 - 7) // 4 + 1 is 5.
"""


def convolved(steps: int, sensor: SensorLayout) -> list[tuple[int, int, int]]:
    """Return the output size (steps, rows, columns) of each convolution of CNN-3D."""
    size = (steps, *frame_size(sensor))
    sizes = []
    for _, kernel, stride in CONVOLUTIONS:
        # Without padding: (n - k) // s + 1 places of a kernel of k in n, s apart.
        size = tuple((n - k) // s + 1 for n, k, s in zip(size, kernel, stride, strict=True))  # type: ignore[assignment]
        if min(size) < 1:
            what = "the recording is too short for its two convolutions"
            measured = f"{counted(steps, 'step')} against at least {LEAST_STEPS}"
            fix = "Use longer recordings."
            raise InputError("network 'cnn-3d'", what, measured=measured, fix=fix)
        sizes.append(size)
    return sizes


def ann_shapes(
    name: str, *, sensor: SensorLayout, steps: int, classes: int, hidden: int
) -> dict[str, tuple[int, ...]]:
    """Return the shape of each parameter, by its name, of ``gru-mlp`` or ``cnn-3d``.

    ``hidden`` is the number of units of the GRU, which has three gates.
    """
    if name == "gru-mlp":
        return {
            "gru.weight_ih_l0": (3 * hidden, sensor.channels),
            "gru.weight_hh_l0": (3 * hidden, hidden),
            "gru.bias_ih_l0": (3 * hidden,),
            "gru.bias_hh_l0": (3 * hidden,),
            "readout.weight": (classes, hidden),
            "readout.bias": (classes,),
        }
    shapes: dict[str, tuple[int, ...]] = {}
    inputs = sensor.polarities
    for number, (outputs, kernel, _) in enumerate(CONVOLUTIONS, start=1):
        shapes[f"conv_{number}.weight"] = (outputs, inputs, *kernel)
        shapes[f"conv_{number}.bias"] = (outputs,)
        inputs = outputs
    # All surfaces (fingertips) share the convolutions; their outputs lie side by side for the readout.
    features = sensor.surfaces * inputs * math.prod(convolved(steps, sensor)[-1])
    return shapes | {"readout.weight": (classes, features), "readout.bias": (classes,)}
