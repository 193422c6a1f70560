"""The spiking networks of Kang et al. 2022 and TactileSGNet: time branches, location branches, and hybrids of both.

A branch is two fully connected layers, or a graph convolution and three; all networks take x (batch, steps, channels),
floats 0 or 1, and return their spikes by population name: ``time_*`` (batch, steps, n), ``location_*``
(batch, locations, n) with locations in walk order.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from hw_model.values import AnyArray, ByteArray, IntArray
from locsnn_compile.models.ann import ArtificialNetwork, Cnn3d, GruMlp
from locsnn_compile.models.branch_graph import branch_graph
from locsnn_compile.models.chip_entry import ChipNumbers
from locsnn_compile.models.chip_layers import ChipLayer
from locsnn_compile.models.dense_layer import INITIAL_SCALE
from locsnn_compile.models.description import LifParameters, NetworkDescription
from locsnn_compile.models.lif import GraphLayer, LifLayer
from locsnn_compile.models.srm import SRMLayer, transpose_recording
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.models.window_network import WindowNetwork

Layer = SRMLayer | LifLayer | GraphLayer | ChipLayer


class TouchNetwork(TouchModel):
    """A spiking network by its description; layers are named as the populations and start from ``seed``.

    With ``chip`` every population runs on the chip's integers, and its weights live on their grid.
    """

    def __init__(
        self,
        description: NetworkDescription,
        *,
        seed: int = 0,
        initial_scale: float = INITIAL_SCALE,
        chip: ChipNumbers | None = None,
    ) -> None:
        super().__init__(description, chip)
        generator = torch.Generator().manual_seed(seed)
        walk = description.walk if "location" in description.branches else np.zeros(0, dtype=np.int64)
        self.register_buffer("walk", torch.from_numpy(walk.copy()), persistent=False)
        self._walks_in_order = np.array_equal(walk, np.arange(description.input.channels))
        self._branches = [branch for branch in description.branches if branch != description.structure.window_branch]
        self.names = [name for branch in self._branches for name in description.populations(branch)]
        for branch in self._branches:
            for name in description.populations(branch):
                self.add_module(name, self._make(name, branch, generator, initial_scale))

    def _make(self, name: str, branch: str, generator: torch.Generator, initial_scale: float) -> Layer:
        """Return the layer of a population with its initial weights."""
        description = self.description
        outputs, inputs = description.weight_shapes[name]
        start: dict[str, Any] = {"generator": generator, "initial_scale": initial_scale}
        neuron = description.neuron_of(branch)
        if isinstance(neuron, LifParameters):
            if name.endswith("_graph"):
                return GraphLayer(branch_graph(description, branch), outputs, neuron, **start)
            return LifLayer(inputs, outputs, neuron, **start)
        if self.chip is not None:
            numbers, registers = self.chip.populations[name], self.chip.registers
            return ChipLayer(inputs, outputs, description.srm(branch), numbers, registers=registers, **start)
        return SRMLayer(inputs, outputs, description.srm(branch), **start)

    def layer(self, name: str) -> Layer:
        """Return the layer of a population."""
        layer = self.get_submodule(name)
        assert isinstance(layer, Layer)
        return layer

    def weight(self, name: str) -> nn.Parameter:
        """Return the weights of a population."""
        return self.layer(name).weight

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the output spikes of every population for ``x`` (batch, steps, channels)."""
        self.check_shape(x)
        spikes: dict[str, Tensor] = {}
        for branch in self._branches:
            stream = self.aligned(x, moved=branch != "time")
            stream = stream if branch == "time" else self._transposed(stream)
            for name in self.description.populations(branch):
                stream = self.layer(name)(delayed(stream, self.description.delays_onto(name)))
                spikes[name] = stream
        return spikes

    def _transposed(self, x: Tensor) -> Tensor:
        """Return what the location branch walks over; in channel order nothing is moved in memory."""
        return x.transpose(1, 2) if self._walks_in_order else transpose_recording(x, self.get_buffer("walk"))

    def scores(self, activity: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return spikes a class, (batch, classes), of the output of every branch."""
        return {branch: activity[f"{branch}_output"].sum(dim=1) for branch in self._branches}

    def hidden_spikes(self, activity: Mapping[str, Tensor]) -> list[Tensor]:
        """Return the spikes of every population but the outputs."""
        return [spikes for name, spikes in activity.items() if not name.endswith("_output")]

    def hold(self) -> None:
        """Bring weights back where they must be after a step: pruned ones to 0, a chip's into their format's range."""
        for layer in self.children():
            if isinstance(layer, ChipLayer):
                layer.hold()
        super().hold()

    def snap(self) -> None:
        """Put a chip network's latent weights where they round to, so that no later rounding can differ."""
        if self.chip is not None:
            units = {name: numbers.unit for name, numbers in self.chip.populations.items()}
            self.load_weights({name: mantissa * units[name] for name, mantissa in self.mantissas().items()})

    def mantissas(self) -> dict[str, IntArray]:
        """Return the mantissas [out, in] by population name, of a network on the chip's integers."""
        layers = {name: self.layer(name) for name in self.names}
        return {name: layer.mantissas() for name, layer in layers.items() if isinstance(layer, ChipLayer)}


class HybridWindow(TouchModel):
    """``hybrid-window``: two branches that spike, and the potentials of a third that counts events in windows."""

    def __init__(self, description: NetworkDescription, *, seed: int, initial_scale: float) -> None:
        super().__init__(description)
        self.spiking = TouchNetwork(description, seed=seed, initial_scale=initial_scale)
        self.windows = WindowNetwork(description)

    def weight(self, name: str) -> nn.Parameter:
        """Return the weights of a name, as they are learned."""
        return (self.windows if name in self.windows.names else self.spiking).weight(name)

    def begin(self, spikes: ByteArray) -> None:
        """Take what the windows must know of the recordings (samples, steps, channels)."""
        self.windows.begin(spikes)

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the output spikes of every population that spikes, and the potentials of the windows."""
        return {**self.spiking(x), **self.windows(x)}

    def scores(self, activity: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return spikes a class of two branches, and potentials of the third, (batch, classes)."""
        return self.spiking.scores(activity) | self.windows.scores(activity)

    def hidden_spikes(self, activity: Mapping[str, Tensor]) -> list[Tensor]:
        """Return the spikes of the hidden populations that learn."""
        return self.spiking.hidden_spikes(activity)

    def weights(self) -> dict[str, NDArray[np.float32]]:
        """Return copies of the weights by name, the bias as the kept network has it."""
        return self.spiking.weights() | self.windows.weights()

    def load_weights(self, weights: Mapping[str, AnyArray]) -> None:
        """Take weights by name; ``InputError`` where a name or shape does not fit."""
        self.spiking.load_weights(weights)
        self.windows.load_weights(weights)


def delayed(x: Tensor, delays: Sequence[int]) -> Tensor:
    """Return x (batch, steps, channels) as it is after each delay, side by side: (batch, steps, delays * channels)."""
    if tuple(delays) == (0,):
        return x
    steps = x.shape[1]
    return torch.cat([nn.functional.pad(x, (0, 0, delay, 0))[:, :steps] for delay in delays], dim=2)


ARTIFICIAL: dict[str, type[ArtificialNetwork]] = {"gru-mlp": GruMlp, "cnn-3d": Cnn3d}


def build_network(
    description: NetworkDescription,
    *,
    seed: int = 0,
    initial_scale: float = INITIAL_SCALE,
    chip: ChipNumbers | None = None,
) -> TouchModel:
    """Return the network of ``description.architecture`` with initial weights of ``seed``.

    Those of spiking layers are uniform within +-``initial_scale`` / sqrt(inputs of the layer). With ``chip`` it runs on
    its integers.
    """
    if description.architecture in ARTIFICIAL:
        return ARTIFICIAL[description.architecture](description, seed=seed)
    if description.structure.neurons == "windows":
        return WindowNetwork(description)
    if description.structure.window_branch:
        return HybridWindow(description, seed=seed, initial_scale=initial_scale)
    return TouchNetwork(description, seed=seed, initial_scale=initial_scale, chip=chip)
