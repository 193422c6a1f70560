"""The spiking networks of Kang et al. 2022 and TactileSGNet: time branches, location branches, and hybrids of both.

A branch is two fully connected layers, or a graph convolution and three; all networks take x (batch, steps, channels),
floats 0 or 1, and return their spikes by population name: ``time_*`` (batch, steps, n), ``location_*``
(batch, locations, n) with locations in walk order. Where a branch counts in windows, its output are potentials.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from hw_model.values import AnyArray, ByteArray, Float32Array, IntArray
from locsnn_compile.errors import InputError
from locsnn_compile.models.ann import Cnn3d, GruMlp
from locsnn_compile.models.chip_entry import ChipNumbers
from locsnn_compile.models.chip_layers import ChipLayer, potential_of_sum, rounded
from locsnn_compile.models.description import LifParameters, NetworkDescription
from locsnn_compile.models.lif import GraphLayer, LifLayer
from locsnn_compile.models.srm import SRMLayer, transpose_recording
from locsnn_compile.models.touch_model import (
    INITIAL_SCALE,
    TouchModel,
    draw_weights,
    to_device,
    to_host,
)
from locsnn_compile.models.xylo_entry import XyloNumbers
from locsnn_compile.models.xylo_network import XyloSnn


class WindowNetwork(TouchModel):
    """``window-snn``, or that branch of a network that has others: fixed hidden neurons, and an output that learns.

    The hidden neurons are those of :class:`~locsnn_compile.models.graph_and_windows.WindowParameters`. They are known
    before the first epoch, so training is a linear problem: the potential of output k is

        v_k = sum over hidden neurons h that spike:  w_kh   +   bias_k

    It is learned as ``w (o - usual) + b``, with ``usual`` the mean of every hidden spike over the recordings that are
    learned from: hidden spikes share a large mean, which would slow the descent along everything else. The network that
    is kept has ``bias = b - w usual``. Weights start at 0, so that no seed is in them.

    With ``chip`` weights and kept biases are rounded to mantissas, and the potentials are the chip's, in float units;
    the gradient is that of the sums which they stand for.
    """

    walk: Tensor
    starts: Tensor
    usual: Tensor

    def __init__(self, description: NetworkDescription, chip: ChipNumbers | None = None) -> None:
        super().__init__(description, chip)
        layout, self.windows = description.input, description.windows
        self.register_buffer("walk", torch.from_numpy(description.walk.copy()), persistent=False)
        self.register_buffer(
            "starts", torch.from_numpy(self.windows.starts(layout.steps)), persistent=False
        )
        self.names = description.window_names
        classes, hidden = description.weight_shapes[self.names[0]]
        self.output = nn.Parameter(torch.zeros(classes, hidden))
        self.bias = nn.Parameter(torch.zeros(classes))
        self.register_buffer("usual", torch.zeros(hidden))

    def weight(self, name: str) -> nn.Parameter:
        """Return a parameter as it is learned."""
        return self.output if name == self.names[0] else self.bias

    def begin(self, spikes: ByteArray) -> None:
        """Take the mean of every hidden spike over recordings (samples, steps, channels); scores stay as they are."""
        total = torch.zeros(self.usual.shape, dtype=torch.float64, device=self.usual.device)
        for start in range(0, len(spikes), 32):
            part = torch.from_numpy(np.array(spikes[start : start + 32])).to(self.usual)
            total += self.hidden(part).sum(dim=0, dtype=torch.float64)
        usual = (total / max(len(spikes), 1)).to(self.usual.dtype)
        with torch.no_grad():
            self.bias.add_(self.output @ (usual - self.usual))
        self.usual.copy_(usual)

    def hidden(self, x: Tensor) -> Tensor:
        """Return the spikes (batch, hidden) of the hidden neurons for ``x`` (batch, steps, channels)."""
        events = torch.nn.functional.pad(self.aligned(x, moved=True).cumsum(dim=1), (0, 0, 1, 0))
        counted = events.index_select(1, self.starts + self.windows.steps) - events.index_select(
            1, self.starts
        )
        levels = torch.tensor(self.windows.levels, dtype=x.dtype, device=x.device)
        spikes = counted.index_select(2, self.walk).transpose(1, 2).unsqueeze(-1) >= levels
        return spikes.to(x.dtype).reshape(len(x), -1)

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the potentials (batch, classes) of the output for ``x`` (batch, steps, channels)."""
        self.check_shape(x)
        hidden = self.hidden(x)
        if self.chip is not None:
            return {self.names[0]: self._on_chip(hidden, self.chip)}
        return {
            self.names[0]: torch.nn.functional.linear(hidden - self.usual, self.output, self.bias)
        }

    def _on_chip(self, hidden: Tensor, chip: ChipNumbers) -> Tensor:
        """Return the chip's potentials (batch, classes) for hidden spikes, added over the output populations."""
        weights = chip.populations[self.names[0]]
        mantissas, neuron = (
            rounded(self.output, weights),
            chip.window_output(self.names, self.mantissas()),
        )
        drives = [
            to_host(hidden[:, part] @ mantissas[:, part].T)
            for part in self.description.output_parts
        ]
        each = [
            potential_of_sum(drive, neuron, weights.exponent, chip.registers) for drive in drives
        ]
        total = np.sum(each, axis=0)
        ideal = torch.nn.functional.linear(hidden - self.usual, weights.unit * mantissas, self.bias)
        return to_device(total, hidden).to(hidden.dtype) / weights.scale + (ideal - ideal.detach())

    def scores(self, activity: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return the potentials of the output."""
        return {self.description.structure.window_branch: activity[self.names[0]]}

    def weights(self) -> dict[str, Float32Array]:
        """Return copies of the weights by name, the bias as the kept network has it."""
        with torch.no_grad():
            bias = self.bias.double() - self.output.double() @ self.usual.double()
        return super().weights() | {self.names[1]: bias.to(torch.float32).cpu().numpy()}

    def load_weights(self, weights: Mapping[str, AnyArray]) -> None:
        """Take weights by name; ``InputError`` where a name or shape does not fit."""
        super().load_weights(weights)
        with torch.no_grad():
            self.bias.add_(self.output @ self.usual)

    @torch.no_grad()
    def mantissas(self) -> dict[str, IntArray]:
        """Return the mantissas of weights and kept biases, of a network on the chip's integers."""
        if self.chip is None:
            return {}
        weights, offsets = (self.chip.populations[name] for name in self.names)
        weight_mantissas = rounded(self.output, weights)
        kept_biases = self.bias.double() - weights.unit * (
            weight_mantissas.double() @ self.usual.double()
        )
        both = zip(self.names, (weight_mantissas, rounded(kept_biases, offsets)), strict=True)
        return {name: to_host(values).astype(np.int64) for name, values in both}


Layer = SRMLayer | LifLayer | GraphLayer | ChipLayer


class TouchNetwork(TouchModel):
    """A spiking network by its description; layers are named as the populations and start from ``seed``.

    With ``chip`` every population runs on the chip's integers, and its weights live on their grid. Next to branches
    that spike, ``windows`` may count events, and their potentials are scores as well.
    """

    def __init__(
        self,
        description: NetworkDescription,
        seed: int,
        initial_scale: float,
        chip: ChipNumbers | None,
    ) -> None:
        super().__init__(description, chip)
        generator = torch.Generator().manual_seed(seed)
        walk = (
            description.walk if "location" in description.branches else np.zeros(0, dtype=np.int64)
        )
        self.register_buffer("walk", torch.from_numpy(walk.copy()), persistent=False)
        self._walks_in_order = np.array_equal(walk, np.arange(description.input.channels))
        self._branches = [
            branch
            for branch in description.branches
            if branch != description.structure.window_branch
        ]
        for branch in self._branches:
            for name in description.populations(branch):
                layer = self._make(name, branch)
                draw_weights(layer.weight, initial_scale, generator)
                self.add_module(name, layer)
        self.windows = WindowNetwork(description, chip) if description.window is not None else None

    def _make(self, name: str, branch: str) -> Layer:
        """Return the layer of a population."""
        description = self.description
        outputs, inputs = description.weight_shapes[name]
        neuron = description.neuron_of(branch)
        if isinstance(neuron, LifParameters):
            if name.endswith("_graph"):
                return GraphLayer(description.graph_of(branch), outputs, neuron)
            return LifLayer(inputs, outputs, neuron)
        if self.chip is not None:
            return ChipLayer(
                inputs, outputs, description.srm(branch), self.chip.populations[name], self.chip
            )
        return SRMLayer(inputs, outputs, description.srm(branch))

    def layer(self, name: str) -> Layer:
        """Return the layer of a population."""
        layer = self.get_submodule(name)
        assert isinstance(layer, Layer)
        return layer

    def weight(self, name: str) -> nn.Parameter:
        """Return the weights of a population, or a parameter of windows as it is learned."""
        if self.windows is not None and name in self.windows.names:
            return self.windows.weight(name)
        return self.layer(name).weight

    def begin(self, spikes: ByteArray) -> None:
        """Take what windows must know of the recordings (samples, steps, channels)."""
        if self.windows is not None:
            self.windows.begin(spikes)

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the spikes of every population for ``x`` (batch, steps, channels), and the potentials of windows."""
        self.check_shape(x)
        spikes: dict[str, Tensor] = {}
        for branch in self._branches:
            stream = self.aligned(x, moved=branch != "time")
            stream = stream if branch == "time" else self._transposed(stream)
            for name in self.description.populations(branch):
                stream = self.layer(name)(delayed(stream, self.description.delays_onto(name)))
                spikes[name] = stream
        return spikes if self.windows is None else spikes | self.windows(x)

    def _transposed(self, x: Tensor) -> Tensor:
        """Return what the location branch walks over; in channel order nothing is moved in memory."""
        return (
            x.transpose(1, 2)
            if self._walks_in_order
            else transpose_recording(x, self.get_buffer("walk"))
        )

    def scores(self, activity: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return spikes a class, (batch, classes), of the output of every branch, or potentials of windows."""
        scores = {branch: activity[f"{branch}_output"].sum(dim=1) for branch in self._branches}
        return scores if self.windows is None else scores | self.windows.scores(activity)

    def total(self, activity: Mapping[str, Tensor]) -> Tensor:
        """Return class scores (batch, classes) over all branches; on a chip whole multiples of the windows' unit."""
        total = super().total(activity)
        if self.chip is None or self.windows is None:
            return total
        scale = self.chip.populations[self.windows.names[0]].scale
        return (total * scale).round() / scale

    def weights(self) -> dict[str, Float32Array]:
        """Return copies of the weights by name, the bias of windows as the kept network has it."""
        return super().weights() | ({} if self.windows is None else self.windows.weights())

    def load_weights(self, weights: Mapping[str, AnyArray]) -> None:
        """Take weights by name; ``InputError`` where a name or shape does not fit."""
        super().load_weights(weights)
        if self.windows is not None:
            self.windows.load_weights(weights)

    def hidden_spikes(self, activity: Mapping[str, Tensor]) -> list[Tensor]:
        """Return the spikes of every population but the outputs."""
        return [spikes for name, spikes in activity.items() if not name.endswith("_output")]

    def mantissas(self) -> dict[str, IntArray]:
        """Return the mantissas [out, in] by population name, of a network on the chip's integers."""
        mantissas = {
            name: layer.mantissas()
            for name, layer in self.named_children()
            if isinstance(layer, ChipLayer)
        }
        return mantissas if self.windows is None else mantissas | self.windows.mantissas()


def delayed(x: Tensor, delays: Sequence[int]) -> Tensor:
    """Return x (batch, steps, channels) as it is after each delay, side by side: (batch, steps, delays * channels)."""
    if tuple(delays) == (0,):
        return x
    steps = x.shape[1]
    return torch.cat([nn.functional.pad(x, (0, 0, delay, 0))[:, :steps] for delay in delays], dim=2)


ARTIFICIAL: dict[str, type[GruMlp | Cnn3d]] = {"gru-mlp": GruMlp, "cnn-3d": Cnn3d}


def build_network(
    description: NetworkDescription,
    *,
    seed: int = 0,
    initial_scale: float = INITIAL_SCALE,
    chip: ChipNumbers | XyloNumbers | None = None,
) -> TouchModel:
    """Return the network of ``description.architecture`` with initial weights of ``seed``.

    Those of spiking layers are uniform within +-``initial_scale`` / sqrt(inputs of the layer). With ``chip`` it runs on
    its integers.
    """
    if description.architecture in ARTIFICIAL:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return ARTIFICIAL[description.architecture](description)
    if isinstance(chip, XyloNumbers):
        return XyloSnn(description, chip, seed, initial_scale)
    if description.structure.neurons == "xylo":
        what = "it exists in the integers of a Xylo only, and none are given"
        where = f"architecture {description.architecture!r}"
        raise InputError(where, what, fix="Give the numbers of its checkpoint.")
    if description.structure.neurons == "windows":
        return WindowNetwork(description, chip)
    return TouchNetwork(description, seed, initial_scale, chip)
