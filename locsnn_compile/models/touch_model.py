"""What all networks that learn from touch recordings, and all of their layers, have in common.

:class:`TouchModel` is the interface through which training, measuring and saving use a network. :class:`DenseLayer` is
the base of fully connected layers.

Each step of a spiking layer depends on the previous one, so the steps run as compiled loops, called scans, on the CPU,
whatever device the matrix products run on. :func:`to_host` and :func:`to_device` copy the inputs and outputs of scans
there and back.
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
    """A fully connected layer of neurons of one kind, which step through the middle axis of their input.

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
    """Return the result of a torch function that defines its own gradient; ``apply`` has no types."""
    result: Tensor = function.apply(*arguments)  # type: ignore[no-untyped-call]
    return result


def constants(kind: np.dtype[Any], *values: float) -> tuple[Any, ...]:
    """Return numbers in the float type of the arrays of a scan, as literals would make its loops compute in float64."""
    return tuple(kind.type(value) for value in values)


def to_host(values: Tensor) -> AnyArray:
    """Return the values as a C-contiguous array, without a copy if they are already that on the processor."""
    array: AnyArray = values.detach().cpu().numpy()
    return np.ascontiguousarray(array)


def to_device(array: AnyArray, like: Tensor) -> Tensor:
    """Return the array as a tensor on the device of ``like``, without a copy if that is the processor."""
    return torch.from_numpy(array).to(like.device)


class TouchModel(nn.Module):
    """A network that can be trained, by its description.

    - ``chip``: the integers of a chip, if the network is trained on its arithmetic; ``xylo``: the same for a Xylo
    - ``names``: the names of its weights
    - ``tie_class``: the class that is predicted if the scores of all classes are equal; None: no class is
    """

    def __init__(self, description: NetworkDescription, chip: ChipNumbers | None = None) -> None:
        super().__init__()
        self.description, self.chip = description, chip
        self.xylo: XyloNumbers | None = None
        self.names: Sequence[str] = tuple(description.weight_shapes)
        self.tie_class: int | None = None
        # By name of weights, 1 for weights that pruning has kept and 0 for others.
        self._kept: dict[str, Tensor] = {}

    def weight(self, name: str) -> nn.Parameter:
        """Return the weights of a name in ``description.weight_shapes``; by default the parameter of that name."""
        return self.get_parameter(name)

    def scores(self, activity: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return the class scores (batch, classes) of every branch, given the result of ``forward``.

        By default, that result is the class scores.
        """
        return dict(activity)

    def begin(self, spikes: ByteArray) -> None:
        """Prepare for training on recordings (samples, steps, channels); by default, there is nothing to do."""

    def rate_shares(self) -> dict[str, float]:
        """Return factors of the learning rate by name of weights; weights that are not in it have factor 1."""
        return {}

    def hidden_spikes(self, activity: Mapping[str, Tensor]) -> list[Tensor]:
        """Return the spikes (batch, steps, n) of every hidden population, given the result of ``forward``."""
        return []

    def total(self, activity: Mapping[str, Tensor]) -> Tensor:
        """Return class scores (batch, classes), added over all branches, given the result of ``forward``."""
        return torch.stack(list(self.scores(activity).values())).sum(dim=0)

    def counts(self, x: Tensor) -> Tensor:
        """Return class scores (batch, classes) of recordings ``x``, added over all branches.

        The class with the largest score is the prediction.
        """
        return self.total(self(x))

    def aligned(self, x: Tensor, *, moved: bool) -> Tensor:
        """Return recordings (batch, steps, channels) without the events before their first touch.

        Unchanged if the description does not ask for this (``align_events``). ``moved``: whether the first touch
        becomes step 0; see :func:`locsnn_compile.network.first_touch.from_first_touch`.
        """
        events = self.description.align_events
        return x if events is None else from_first_touch(x, events, moved=moved)

    def check_shape(self, x: Tensor) -> None:
        """Refuse recordings that are not (batch, steps, channels) of the network's input."""
        layout = self.description.input
        expected = (layout.steps, layout.channels)
        what = "their steps and channels are not the network's"
        fix = "Give recordings of the network's sensor and duration."
        check_same(tuple(x.shape[1:]), expected, "recordings", what, fix=fix)

    def prune(self, share: float) -> None:
        """Set the smallest weights of each population, a ``share`` of 0..1, to 0; :meth:`hold` keeps them at 0."""
        for name in self.names:
            weight = self.weight(name).detach()
            # Stable, so that equal networks are pruned equally: many weights may have one magnitude.
            order = weight.abs().flatten().argsort(stable=True)
            kept = torch.ones(weight.numel(), dtype=torch.bool, device=weight.device)
            kept[order[: int(share * len(order))]] = False
            self._kept[name] = kept.reshape(weight.shape)
        self.hold()

    def hold(self) -> None:
        """Bring weights back into their limits after a step of the optimizer.

        Weights of a network on a chip's integers stay within the range of its format, because beyond it rounding would
        clip them, and small steps would change nothing. Biases, which have one axis, may leave it. Pruned weights
        become 0 again.
        """
        with torch.no_grad():
            for name, largest in self.largest_weights().items():
                if (weight := self.weight(name)).dim() > 1:
                    weight.clamp_(-largest, largest)
            for name, kept in self._kept.items():
                self.weight(name).mul_(kept)

    def largest_weights(self) -> dict[str, float]:
        """Return the largest weight that the chip's format holds, by name; empty for a network in floats."""
        formats = {} if self.chip is None else self.chip.populations
        return {name: numbers.largest for name, numbers in formats.items()}

    def snap(self) -> None:
        """Set the latent float weights of a network on a chip's integers to the values that they round to.

        Another version of torch, or another device, then cannot round them differently.
        """
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
        """Return what a checkpoint stores: mantissas of a network on a chip's integers, else float weights."""
        return self.weights() if self.chip is None and self.xylo is None else self.mantissas()

    def load_weights(self, weights: Mapping[str, AnyArray]) -> None:
        """Load weights by name; ``InputError`` if a name or shape does not fit."""
        for name in self.names:
            self.description.check_shape(
                name, weights, "Give the weights of a network of this description."
            )
            with torch.no_grad():
                self.weight(name).copy_(torch.from_numpy(np.array(weights[name])))
