"""The spiking networks of Kang et al. 2022 and TactileSGNet: time branches, location branches, and hybrids of both.

A branch is a chain of layers over the whole recording: two fully connected layers, or a graph convolution and three
fully connected ones. A time branch steps through time, with the channels as inputs; a location branch steps through the
channels in a fixed order, the *walk*, with the time steps as inputs. A branch of windows counts the events of a channel
during some consecutive steps. The class scores of all branches are added.

All networks take x (batch, steps, channels), floats 0 or 1, and return their spikes by population name: ``time_*``
(batch, steps, n), ``location_*`` (batch, locations, n) with locations in the order of the walk. A branch of windows
returns the potentials of its outputs instead.

*On the chip* means here that a network is trained with the chip's integer arithmetic in its forward pass. The argument
``chip`` then has the chip's registers and, for each population, its integers and the format of its weights
(:class:`ChipNumbers`). Weights that learn stay floats; the forward pass rounds them to integers called mantissas.
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

_RECORDINGS_AT_ONCE = 32
"""How many recordings are averaged at a time, which bounds the memory; chosen by hand."""


class WindowNetwork(TouchModel):
    """``window-snn``, or the window branch of another network: fixed hidden neurons, and an output layer that learns.

    Every hidden neuron counts the events of one channel in one window of consecutive steps, and spikes if they reach
    its level; see :class:`~locsnn_compile.models.graph_and_windows.WindowParameters`. Nothing about them is learned, so
    training is a linear problem: the potential of output k is

        v_k = sum over hidden neurons h that spike:  w_kh   +   bias_k

    It is learned as ``w (o - usual) + b``, with ``o`` the hidden spikes and ``usual`` their mean over the training
    recordings: hidden spikes share a large mean, which would slow the descent in all other directions. The network that
    is saved has ``bias = b - w usual``. Weights start at 0, so the result does not depend on a seed.

    With ``chip``, weights and saved biases are rounded to mantissas, and the potentials are the chip's, in float units;
    the gradient is that of the sums which they stand for. Of the chip's numbers for these weights, ``unit`` is the
    float weight of a mantissa of 1, and ``scale`` the register units of a potential of 1.
    """

    walk: Tensor
    """Position -> channel, (channels,)."""
    starts: Tensor
    """The first step of every window, (windows,)."""
    usual: Tensor
    """The mean of every hidden spike over the training recordings, (hidden,)."""

    def __init__(self, description: NetworkDescription, chip: ChipNumbers | None = None) -> None:
        super().__init__(description, chip)
        self.windows = description.windows
        # Buffers move to a GPU with the network. Those that follow from the description are not stored.
        starts = self.windows.starts(description.input.steps)
        self.register_buffer("walk", torch.from_numpy(description.walk.copy()), persistent=False)
        self.register_buffer("starts", torch.from_numpy(starts), persistent=False)
        self.names = description.window_names
        # Of the weights (classes, hidden), which also names the output, and of the biases (classes,).
        self.weight_name, self.bias_name = description.window_names
        classes, hidden = description.weight_shapes[self.weight_name]
        self.output = nn.Parameter(torch.zeros(classes, hidden))
        self.bias = nn.Parameter(torch.zeros(classes))
        self.register_buffer("usual", torch.zeros(hidden))

    def weight(self, name: str) -> nn.Parameter:
        """Return a parameter as it is learned."""
        return self.output if name == self.weight_name else self.bias

    def begin(self, spikes: ByteArray) -> None:
        """Set ``usual`` to the mean over recordings (samples, steps, channels), without changing the scores."""
        total = torch.zeros(self.usual.shape, dtype=torch.float64, device=self.usual.device)
        for start in range(0, len(spikes), _RECORDINGS_AT_ONCE):
            part = spikes[start : start + _RECORDINGS_AT_ONCE]
            x = torch.from_numpy(np.array(part)).to(self.usual)
            total += self.hidden(x).sum(dim=0, dtype=torch.float64)
        usual = (total / max(len(spikes), 1)).to(self.usual.dtype)
        with torch.no_grad():
            # Moves b, so that w (o - usual) + b stays the same.
            self.bias.add_(self.output @ (usual - self.usual))
        self.usual.copy_(usual)

    def hidden(self, x: Tensor) -> Tensor:
        """Return the spikes (batch, hidden) of the hidden neurons for ``x`` (batch, steps, channels)."""
        # If the description asks for it, recordings begin at their first touch, which becomes step 0.
        events_so_far = self.aligned(x, moved=True).cumsum(dim=1)
        # A row of zeros in front, so that row t counts the events before step t. The events in a window
        # are then the difference of two rows.
        events_before = torch.nn.functional.pad(events_so_far, (0, 0, 1, 0))
        before_ends = events_before.index_select(1, self.starts + self.windows.steps)
        events = before_ends - events_before.index_select(1, self.starts)
        levels = torch.tensor(self.windows.levels, dtype=x.dtype, device=x.device)
        # (batch, channels in order of the walk, windows, levels), the order of the hidden neurons.
        spikes = events.index_select(2, self.walk).transpose(1, 2).unsqueeze(-1) >= levels
        return spikes.to(x.dtype).reshape(len(x), -1)

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the potentials (batch, classes) of the output for ``x`` (batch, steps, channels)."""
        self.check_shape(x)
        hidden = self.hidden(x)
        if self.chip is not None:
            return {self.weight_name: self._on_chip(hidden, self.chip)}
        potentials = torch.nn.functional.linear(hidden - self.usual, self.output, self.bias)
        return {self.weight_name: potentials}

    def _on_chip(self, hidden: Tensor, chip: ChipNumbers) -> Tensor:
        """Return the chip's potentials (batch, classes) for hidden spikes, added over the output populations.

        On the chip, a class may have several output neurons, each of which receives from a part of the hidden neurons.
        """
        weight_format = chip.populations[self.weight_name]
        # Integers in a float tensor, which passes the gradient on as if the weights were only divided by the unit.
        mantissas = rounded(self.output, weight_format)
        neuron = chip.window_output(self.names, self.mantissas())
        potentials = []
        for part in self.description.output_parts:
            drive = to_host(hidden[:, part] @ mantissas[:, part].T)
            potential = potential_of_sum(drive, neuron, weight_format.exponent, chip.registers)
            potentials.append(potential)
        total = np.sum(potentials, axis=0)
        scores = to_device(total, hidden).to(hidden.dtype) / weight_format.scale
        # A difference of 0, which has the gradient of the float sums that the potentials stand for.
        rounded_weights = weight_format.unit * mantissas
        ideal = torch.nn.functional.linear(hidden - self.usual, rounded_weights, self.bias)
        return scores + (ideal - ideal.detach())

    def scores(self, activity: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return the potentials of the output."""
        return {self.description.structure.window_branch: activity[self.weight_name]}

    def weights(self) -> dict[str, Float32Array]:
        """Return copies of the weights by name, the bias as the saved network has it."""
        with torch.no_grad():
            bias = self.bias.double() - self.output.double() @ self.usual.double()
        return super().weights() | {self.bias_name: bias.to(torch.float32).cpu().numpy()}

    def load_weights(self, weights: Mapping[str, AnyArray]) -> None:
        """Take weights by name; ``InputError`` if a name is missing or a shape does not fit."""
        super().load_weights(weights)
        with torch.no_grad():
            # From the bias of a saved network to the one that is learned.
            self.bias.add_(self.output @ self.usual)

    @torch.no_grad()
    def mantissas(self) -> dict[str, IntArray]:
        """Return the mantissas of weights and saved biases, of a network on the chip's integers."""
        if self.chip is None:
            return {}
        weight_format = self.chip.populations[self.weight_name]
        bias_format = self.chip.populations[self.bias_name]
        weight_mantissas = rounded(self.output, weight_format)
        # By the rounded weights, because these are what the chip has.
        saved_biases = self.bias.double() - weight_format.unit * (
            weight_mantissas.double() @ self.usual.double()
        )
        bias_mantissas = rounded(saved_biases, bias_format)
        return {
            self.weight_name: to_host(weight_mantissas).astype(np.int64),
            self.bias_name: to_host(bias_mantissas).astype(np.int64),
        }


Layer = SRMLayer | LifLayer | GraphLayer | ChipLayer


class TouchNetwork(TouchModel):
    """A spiking network by its description; layers have the names of their populations and start from ``seed``.

    With ``chip``, every population runs on the chip's integers, and its weights are rounded to their grid. Only spike
    response neurons and windows are trained in this way; checkpoints of LIF neurons with ``chip`` are refused when they
    are read. Next to branches that spike there may be ``windows``, a branch of windows, whose potentials are added to
    the class scores.
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
        walk = np.zeros(0, dtype=np.int64)
        if "location" in description.branches:
            walk = description.walk
        self.register_buffer("walk", torch.from_numpy(walk.copy()), persistent=False)
        self._walks_in_order = np.array_equal(walk, np.arange(description.input.channels))
        self._branches = [
            branch
            for branch in description.branches
            if branch != description.structure.window_branch
        ]
        for branch in self._branches:
            for name in description.populations(branch):
                layer = self._make_layer(name, branch)
                draw_weights(layer.weight, initial_scale, generator)
                self.add_module(name, layer)
        self.windows = WindowNetwork(description, chip) if description.window is not None else None

    def _make_layer(self, name: str, branch: str) -> Layer:
        """Return a new layer for a population of a branch."""
        description = self.description
        outputs, inputs = description.weight_shapes[name]
        neuron = description.neuron_of(branch)
        if isinstance(neuron, LifParameters):
            # Never with ``chip``: LIF neurons do not learn on a chip's integers.
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
        """Prepare a branch of windows for the training recordings (samples, steps, channels)."""
        if self.windows is not None:
            self.windows.begin(spikes)

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the spikes of every population for ``x`` (batch, steps, channels), and the potentials of windows."""
        self.check_shape(x)
        spikes: dict[str, Tensor] = {}
        for branch in self._branches:
            # If recordings begin at their first touch: a time branch keeps every event in its step, and only the
            # events before the touch are left out. The other branches read time steps as inputs, so there the touch
            # becomes step 0.
            stream = self.aligned(x, moved=branch != "time")
            stream = stream if branch == "time" else self._transposed(stream)
            for name in self.description.populations(branch):
                stream = self.layer(name)(delayed(stream, self.description.delays_onto(name)))
                spikes[name] = stream
        return spikes if self.windows is None else spikes | self.windows(x)

    def _transposed(self, x: Tensor) -> Tensor:
        """Return recordings (batch, steps, channels) as (batch, locations, steps), the input of a location branch."""
        if self._walks_in_order:
            return x.transpose(1, 2)  # a view, which moves nothing in memory
        return transpose_recording(x, self.get_buffer("walk"))

    def scores(self, activity: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return the scores (batch, classes) of every branch: output spikes per class, or potentials of windows."""
        scores = {branch: activity[f"{branch}_output"].sum(dim=1) for branch in self._branches}
        return scores if self.windows is None else scores | self.windows.scores(activity)

    def total(self, activity: Mapping[str, Tensor]) -> Tensor:
        """Return class scores (batch, classes), added over all branches."""
        total = super().total(activity)
        if self.chip is None or self.windows is None:
            return total
        # On the chip, potentials are integers in units of 1 / scale. Rounded to these, scores that are
        # equal on the chip are equal here, in spite of float32.
        scale = self.chip.populations[self.windows.weight_name].scale
        return (total * scale).round() / scale

    def weights(self) -> dict[str, Float32Array]:
        """Return copies of the weights by name, the bias of windows as the saved network has it."""
        return super().weights() | ({} if self.windows is None else self.windows.weights())

    def load_weights(self, weights: Mapping[str, AnyArray]) -> None:
        """Take weights by name; ``InputError`` if a name is missing or a shape does not fit."""
        super().load_weights(weights)
        if self.windows is not None:
            self.windows.load_weights(weights)

    def hidden_spikes(self, activity: Mapping[str, Tensor]) -> list[Tensor]:
        """Return the spikes of every population except the outputs."""
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
    """Return copies of x (batch, steps, channels), each delayed by some steps, side by side.

    The result is (batch, steps, delays * channels): all channels with the first delay come first.
    """
    if tuple(delays) == (0,):
        return x  # without a copy
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

    Weights of spiking layers start uniform within +-``initial_scale`` / sqrt(inputs of the layer). With ``chip``, the
    network runs on the integers of that chip. Raises ``InputError`` for a network of a Xylo without such integers.
    """
    if description.architecture in ARTIFICIAL:
        # Layers of torch draw their own initial weights from its global generator, which is restored afterwards.
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
