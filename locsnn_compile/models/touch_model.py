"""What every network that learns from touch recordings, and every layer of one, has in common.

Each step of a spiking layer depends on the previous one, so the steps run as compiled scans on the processor, whatever
device the matrix products run on. Inputs and outputs of the scans are copied there and back.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Generic, TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from hw_model.values import AnyArray, ByteArray, Float32Array, IntArray
from locsnn_compile.errors import check_same
from locsnn_compile.models.chip_entry import ChipNumbers
from locsnn_compile.models.description import LifParameters, NetworkDescription, NeuronParameters
from locsnn_compile.models.xylo_entry import XyloNumbers
from locsnn_compile.network.first_touch import from_first_touch

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


def applied(function: type[torch.autograd.Function], *arguments: Any) -> Tensor:
    """Return the result of a function that has a gradient of its own."""
    result: Tensor = function.apply(*arguments)  # type: ignore[no-untyped-call]
    return result


def constants(kind: np.dtype[Any], *values: float) -> tuple[Any, ...]:
    """Return numbers in the type of the arrays of a scan: literals would make its loops compute in float64."""
    return tuple(kind.type(value) for value in values)


def to_host(values: Tensor) -> AnyArray:
    """Return the values as a C-contiguous array, without a copy if they are already that on the processor."""
    array: AnyArray = values.detach().cpu().numpy()
    return np.ascontiguousarray(array)


def to_device(array: AnyArray, like: Tensor) -> Tensor:
    """Return the array as a tensor on the device of ``like``, without a copy if that is the processor."""
    return torch.from_numpy(array).to(like.device)


class TouchModel(nn.Module):
    """A network by its description; ``chip`` holds the numbers of one that runs on a chip's integers, and ``xylo``
    those of one on a Xylo's.

    ``names``: its weights, or those of a branch of it. ``tie_class``: the class that is predicted where the scores of
    all classes are equal; None: none is.
    """

    def __init__(self, description: NetworkDescription, chip: ChipNumbers | None = None) -> None:
        super().__init__()
        self.description, self.chip = description, chip
        self.xylo: XyloNumbers | None = None
        self.names: Sequence[str] = tuple(description.weight_shapes)
        self.tie_class: int | None = None
        self._kept: dict[str, Tensor] = {}

    def weight(self, name: str) -> nn.Parameter:
        """Return the weights of a name in ``description.weight_shapes``; here they are parameters of that name."""
        return self.get_parameter(name)

    def scores(self, activity: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return class scores (batch, classes) of every branch, given the result of ``forward``: here, just that."""
        return dict(activity)

    def begin(self, spikes: ByteArray) -> None:
        """Note what must be known about the recordings (samples, steps, channels) before learning from them."""

    def rate_shares(self) -> dict[str, float]:
        """Return, by name, the share of the learning rate at which weights learn that learn at another than all."""
        return {}

    def hidden_spikes(self, activity: Mapping[str, Tensor]) -> list[Tensor]:
        """Return the spikes (batch, steps, n) of every hidden population, given the result of ``forward``."""
        return []

    def total(self, activity: Mapping[str, Tensor]) -> Tensor:
        """Return class scores (batch, classes) over all branches, of what ``forward`` returned."""
        return torch.stack(list(self.scores(activity).values())).sum(dim=0)

    def counts(self, x: Tensor) -> Tensor:
        """Return class scores (batch, classes) over all branches; the largest one is the prediction."""
        return self.total(self(x))

    def aligned(self, x: Tensor, *, moved: bool) -> Tensor:
        """Return recordings (batch, steps, channels) from the step at which they start; see ``from_first_touch``."""
        events = self.description.align_events
        return x if events is None else from_first_touch(x, events, moved=moved)

    def check_shape(self, x: Tensor) -> None:
        """Refuse recordings that are not (batch, steps, channels) of the network's input."""
        layout, fix = (
            self.description.input,
            "Give recordings of the network's sensor and duration.",
        )
        wanted, what = (
            (layout.steps, layout.channels),
            "their steps and channels are not the network's",
        )
        check_same(tuple(x.shape[1:]), wanted, "recordings", what, fix=fix)

    def prune(self, share: float) -> None:
        """Set the smallest weights of each population, a ``share`` of 0..1, to 0; :meth:`hold` keeps them at 0."""
        for name in self.names:
            weight = self.weight(name).detach()
            order = weight.abs().flatten().argsort(stable=True)
            kept = torch.ones(weight.numel(), dtype=torch.bool, device=weight.device)
            kept[order[: int(share * len(order))]] = False
            self._kept[name] = kept.reshape(weight.shape)
        self.hold()

    def hold(self) -> None:
        """Bring weights back to where they must be after a step: into the range of a chip's format, pruned ones to 0.

        Beyond the range no gradient would be of use. Biases, of one axis, may leave it.
        """
        with torch.no_grad():
            for name, largest in self.largest_weights().items():
                if (weight := self.weight(name)).dim() > 1:
                    weight.clamp_(-largest, largest)
            for name, kept in self._kept.items():
                self.weight(name).mul_(kept)

    def largest_weights(self) -> dict[str, float]:
        """Return the largest weight that the chip's format holds, by name; empty for a network in float."""
        formats = {} if self.chip is None else self.chip.populations
        return {name: numbers.largest for name, numbers in formats.items()}

    def snap(self) -> None:
        """Put a chip network's latent weights where they round to, so that no later rounding can differ."""
        if self.chip is not None:
            self.load_weights(self.chip.floats(self.mantissas()))

    def mantissas(self) -> dict[str, IntArray]:
        """Return the mantissas [out, in] by population name, of a network on the chip's integers."""
        return {}

    def weights(self) -> dict[str, Float32Array]:
        """Return copies of the weights by name."""
        return {
            name: self.weight(name).detach().to(torch.float32).cpu().numpy().copy()
            for name in self.names
        }

    def stored_weights(self) -> Mapping[str, AnyArray]:
        """Return what a checkpoint keeps: mantissas of a network on the chip's integers, else weights."""
        return self.weights() if self.chip is None and self.xylo is None else self.mantissas()

    def load_weights(self, weights: Mapping[str, AnyArray]) -> None:
        """Load weights by name; ``InputError`` if a name or shape does not fit."""
        for name in self.names:
            self.description.check_shape(
                name, weights, "Give the weights of a network of this description."
            )
            with torch.no_grad():
                self.weight(name).copy_(torch.from_numpy(np.array(weights[name])))
