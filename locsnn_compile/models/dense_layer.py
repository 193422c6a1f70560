"""What spiking layers have in common: a neuron, random initial weights, and scans on the processor.

Each step of a spiking layer depends on the previous one, so the steps run as compiled scans on the processor, whatever
device the matrix products run on. Inputs and outputs of the scans are copied there and back.
"""

import math
from typing import Generic, TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from hw_model.values import AnyArray
from locsnn_compile.models.description import LifParameters, NeuronParameters

#: Weights start uniform in +-INITIAL_SCALE / sqrt(inputs). SLAYER's dense layers start at 10; on validation
#: recordings of Ev-Objects 3 did better (accuracy 0.88 against 0.85, two seeds), and still makes threshold 10 fire.
INITIAL_SCALE = 3.0

Neuron = TypeVar("Neuron", NeuronParameters, LifParameters)


class DenseLayer(nn.Module, Generic[Neuron]):
    """A fully connected layer of neurons of one kind, recurring over the middle axis of its input.

    Input (batch, steps, inputs), output (batch, steps, outputs); ``weight`` [out, in], no bias, starts at 0: see
    :func:`draw_weights`.
    """

    def __init__(self, inputs: int, outputs: int, neuron: Neuron) -> None:
        super().__init__()
        self.neuron: Neuron = neuron
        self.weight = nn.Parameter(torch.zeros(outputs, inputs))


def draw_weights(weight: nn.Parameter, initial_scale: float, generator: torch.Generator) -> None:
    """Draw weights [out, in] uniformly within +-``initial_scale`` / sqrt(inputs)."""
    bound = initial_scale / math.sqrt(weight.shape[1])
    nn.init.uniform_(weight, -bound, bound, generator=generator)


def to_host(values: Tensor) -> AnyArray:
    """Return the values as a C-contiguous array, without a copy if they are already that on the processor."""
    array: AnyArray = values.detach().cpu().numpy()
    return np.ascontiguousarray(array)


def to_device(array: AnyArray, like: Tensor) -> Tensor:
    """Return the array as a tensor on the device of ``like``, without a copy if that is the processor."""
    return torch.from_numpy(array).to(like.device)
