"""The layers of torch that a description may list: one class each, whose fields are its options.

The weights of a layer are found in the state dict by its name. Arguments of a torch constructor that the shape of the
weights shows (``in_channels``, ``kernel_size`` of a convolution) are not options.

Batch normalisation in evaluation multiplies each channel by ``weight / sqrt(running_var + eps)`` and adds
``bias - running_mean`` times that factor. It is folded into the weights before it, or else becomes
weights of its own.

The maximum over a window of spikes is 1 if any of them is. So max pooling becomes neurons without memory, whose
threshold is half a spike, behind sum pooling. They spike a step later than their input, like all neurons on the chip.
"""

import math
from abc import ABC, abstractmethod
from typing import Annotated, Any, ClassVar

import numpy as np

from hw_model.io.records import AT_LEAST_ONE, NOT_NEGATIVE, POSITIVE
from hw_model.values import FloatArray, Frozen
from locsnn_compile.errors import InputError, check_same
from locsnn_compile.frontends.nir.graph import NirNode
from locsnn_compile.frontends.torch_layers.chain import Chain

OfAxes = tuple[int, ...]
"""One number per axis of an image; a single one stands for all axes."""
HALF_A_SPIKE = 0.5
"""The threshold of max pooling, which one spike or more exceeds."""


def with_lists(options: Any, *names: str) -> Any:
    """Return options in which the single numbers of some options are lists of one; torch takes both."""
    if not isinstance(options, dict):
        return options
    lists = {name: [options[name]] for name in names if isinstance(options.get(name), int)}
    return {**options, **lists}


class Layer(ABC):
    """A type of layer."""

    @abstractmethod
    def add_to(self, chain: Chain, name: str) -> None:
        """Add the layer to a chain; raise ``InputError`` if it does not fit there."""


class Linear(Layer, Frozen):
    """``torch.nn.Linear``."""

    def add_to(self, chain: Chain, name: str) -> None:
        """Add its weights (outputs, inputs)."""
        weight = chain.tensor(name, "weight")
        bias = chain.optional(name, "bias")
        if bias is None:
            chain.add_weights(name, NirNode("Linear", {"weight": weight}), axes=1)
        else:
            chain.add_weights(name, NirNode("Affine", {"weight": weight, "bias": bias}), axes=1)


class Convolution(Layer, Frozen):
    """Base of ``torch.nn.Conv1d`` and ``Conv2d``."""

    stride: OfAxes = (1,)
    padding: OfAxes = (0,)
    dilation: OfAxes = (1,)
    groups: Annotated[int, AT_LEAST_ONE] = 1
    named_padding: str = ""
    """``same`` or ``valid``, if the padding is such a word."""

    primitive: ClassVar[str]
    axes: ClassVar[int]

    @staticmethod
    def from_plain(options: Any) -> Any:
        """Return the options of a description in the form of the fields: a padding that is a word has its own field."""
        if isinstance(options, dict) and isinstance(options.get("padding"), str):
            numbers = {name: value for name, value in options.items() if name != "padding"}
            options = {**numbers, "named_padding": options["padding"]}
        return with_lists(options, "stride", "padding", "dilation")

    def add_to(self, chain: Chain, name: str) -> None:
        """Add its kernels (out, in / groups, ...)."""
        weight = chain.tensor(name, "weight")
        bias = chain.optional(name, "bias")
        parameters = {
            "weight": weight,
            "bias": np.zeros(len(weight)) if bias is None else bias,
            "stride": np.array(self.stride),
            "padding": self.named_padding or np.array(self.padding),
            "dilation": np.array(self.dilation),
            "groups": np.array(self.groups),
        }
        chain.add_weights(name, NirNode(self.primitive, parameters), axes=self.axes)


class Conv1d(Convolution, Frozen):
    """``torch.nn.Conv1d`` with zero padding."""

    primitive = "Conv1d"
    axes = 2


class Conv2d(Convolution, Frozen):
    """``torch.nn.Conv2d`` with zero padding."""

    primitive = "Conv2d"
    axes = 3


class BatchNorm(Layer, Frozen):
    """``torch.nn.BatchNorm1d`` and ``BatchNorm2d`` in evaluation, with running statistics."""

    eps: Annotated[float, POSITIVE] = 1e-5

    def add_to(self, chain: Chain, name: str) -> None:
        """Fold it into the weights before it, or add it as weights that connect each channel to itself."""
        factor, bias = self._channels(chain, name)
        if chain.weighted:
            before = chain.nodes[chain.last].array("weight")
            what = "it has another number of channels than the layer before it"
            fix = "List the layers in the order in which they run."
            check_same(len(factor), len(before), chain.place(name), what, fix=fix)
            chain.fold(factor, bias)
        elif chain.axes == 1:
            node = NirNode("Affine", {"weight": np.diag(factor), "bias": bias})
            chain.add_weights(name, node, axes=1)
        else:
            chain.add_weights(name, _of_each_channel(factor, bias, chain.axes), chain.axes)

    def _channels(self, chain: Chain, name: str) -> tuple[FloatArray, FloatArray]:
        """Return the factor and the bias of every channel, (channels,)."""
        mean = chain.tensor(name, "running_mean").reshape(-1)
        variance = chain.tensor(name, "running_var").reshape(-1)
        gain = chain.optional(name, "weight")
        shift = chain.optional(name, "bias")
        if (variance < 0).any():
            what = "a running variance is below 0"
            measured = f"{variance.min():g}"
            raise InputError(chain.place(name), what, measured=measured, fix="Train again.")
        factor = 1 / np.sqrt(variance + self.eps)
        if gain is not None:
            factor = factor * gain
        bias = -mean * factor
        if shift is not None:
            bias = bias + shift
        return factor, bias


def _of_each_channel(factor: FloatArray, bias: FloatArray, axes: int) -> NirNode:
    """Return a convolution with kernels of one pixel that multiplies each channel by a factor and adds a bias.

    ``axes`` are those of its input, with the channels.
    """
    parameters = {
        "weight": factor.reshape(-1, *(1,) * axes),
        "bias": bias,
        "stride": np.array(1),
        "padding": np.array(0),
        "dilation": np.array(1),
        "groups": np.array(len(factor)),
    }
    return NirNode("Conv2d" if axes == 3 else "Conv1d", parameters)


class Pooling(Layer, Frozen):
    """Base of pooling layers of images; without a ``stride``, it is the size of the kernel."""

    kernel_size: OfAxes
    stride: OfAxes = ()
    padding: OfAxes = (0,)

    @staticmethod
    def from_plain(options: Any) -> Any:
        """Return the options of a description in the form of the fields."""
        return with_lists(options, "kernel_size", "stride", "padding", "dilation")

    def node(self, kind: str, **more: FloatArray) -> NirNode:
        """Return the pooling as a NIR node of a kind, with further parameters."""
        parameters = {
            "kernel_size": np.array(self.kernel_size),
            "stride": np.array(self.stride or self.kernel_size),
            "padding": np.array(self.padding),
        }
        return NirNode(kind, {**parameters, **more})


class AvgPool2d(Pooling, Frozen):
    """``torch.nn.AvgPool2d``; padding is included in the mean, which is torch's default."""

    def add_to(self, chain: Chain, name: str) -> None:
        """Add the mean of each window."""
        chain.add_linear(name, self.node("AvgPool2d"))


class SumPool2d(Pooling, Frozen):
    """``sinabs.layers.SumPool2d``."""

    def add_to(self, chain: Chain, name: str) -> None:
        """Add the sum of each window."""
        chain.add_linear(name, self.node("SumPool2d"))


class MaxPool2d(Pooling, Frozen):
    """``torch.nn.MaxPool2d`` over spikes."""

    dilation: OfAxes = (1,)

    def add_to(self, chain: Chain, name: str) -> None:
        """Add the sum of each window, and neurons whose threshold any one spike exceeds."""
        if not chain.spiking:
            what = f"max pooling is exact for spikes, and {chain.last!r} sends numbers"
            fix = "Train with the pooling behind the neurons, or with AvgPool2d."
            raise InputError(chain.place(name), what, fix=fix)
        sums = self.node("SumPool2d", dilation=np.array(self.dilation))
        chain.add_linear(f"{name} (sums)", sums)
        chain.add_neurons(name, NirNode("Threshold", {"threshold": np.array(HALF_A_SPIKE)}))
        sentence = f"Max pooling {name!r} runs as neurons that spike a step after any spike of their window."
        chain.assumed.append(sentence)


class Flatten(Layer, Frozen):
    """``torch.nn.Flatten``; axis 0 of torch is the batch.

    With ``start_dim`` 0, torch joins the batch with the other axes. A recording is a batch of one, so the
    result is the same as with 1, and 0 is read as 1.
    """

    start_dim: Annotated[int, NOT_NEGATIVE] = 1
    end_dim: int = -1

    def add_to(self, chain: Chain, name: str) -> None:
        """Join the axes."""
        # The graph has no batch axis, so torch's axis 1 is its axis 0.
        first = max(self.start_dim - 1, 0)
        # A negative number counts from the last axis, with or without a batch.
        last = self.end_dim - 1
        if self.end_dim < 0:
            last = chain.axes + self.end_dim
        if not first <= last < chain.axes:
            raise InputError(
                chain.place(name),
                f"it joins axes {self.start_dim} to {self.end_dim}, but {chain.axes} follow the "
                "batch",
                fix="Correct start_dim and end_dim.",
            )
        parameters = {"start_dim": np.array(first), "end_dim": np.array(last)}
        chain.add_order(name, NirNode("Flatten", parameters), axes=chain.axes - (last - first))


class Dropout(Layer, Frozen):
    """``torch.nn.Dropout`` and ``Dropout2d``, which do nothing in evaluation; ``p`` is accepted and not used."""

    p: Annotated[float, NOT_NEGATIVE] = math.nan

    def add_to(self, chain: Chain, name: str) -> None:
        """Add nothing."""


LAYERS: dict[str, type[Layer]] = {
    "Linear": Linear,
    "Conv1d": Conv1d,
    "Conv2d": Conv2d,
    "BatchNorm1d": BatchNorm,
    "BatchNorm2d": BatchNorm,
    "AvgPool2d": AvgPool2d,
    "SumPool2d": SumPool2d,
    "MaxPool2d": MaxPool2d,
    "Flatten": Flatten,
    "Dropout": Dropout,
    "Dropout2d": Dropout,
}
"""The classes of layers, by the type that a description states."""
