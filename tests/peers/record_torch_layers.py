"""Write ``tests/frontends/torch-layers/<framework>.npz``, in an environment with snnTorch, spikingjelly, norse and sinabs.

Each file holds a state dict, ``state`` (bytes), the input step by step, ``inputs`` (steps, ...), and the output of each layer
of neurons and each pooling, by the layer's name, (steps, neurons). The YAML that lists the layers lies next to it.
"""

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import norse.torch as norse
import numpy as np
import sinabs.layers
import snntorch
import torch
from sinabs.activation import SingleSpike
from spikingjelly.activation_based import neuron

FOLDER = Path(__file__).resolve().parents[1] / "frontends" / "torch-layers"
STEPS = 40
Module = torch.nn.Module
WEIGHTED = (torch.nn.Linear, torch.nn.Conv2d)
UNRECORDED = (*WEIGHTED, torch.nn.Flatten, torch.nn.BatchNorm1d, torch.nn.BatchNorm2d)
"""Layers whose output is not recorded: it does not consist of spikes, or only reshapes those of the layer before."""


class WithState(Module):
    """A cell of norse, which takes and returns its state, wrapped as a layer that keeps it."""

    def __init__(self, cell: Module) -> None:
        super().__init__()
        self.cell = cell
        self.state = None

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        sent, self.state = self.cell(x, self.state)
        return sent


class OfOneStep(Module):
    """A layer of sinabs, which takes all steps of a recording at once, wrapped as a layer that takes one step."""

    def __init__(self, layer: Module) -> None:
        super().__init__()
        self.layer = layer

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.layer(x.unsqueeze(1)).squeeze(1)


def normalised(layer: Module, channels: int) -> Module:
    """Give a batch normalisation random statistics and parameters, as training would; return it."""
    layer.running_mean = 0.3 * torch.randn(channels)
    layer.running_var = 0.2 + torch.rand(channels)
    layer.weight.data = 0.8 + 0.4 * torch.rand(channels)
    layer.bias.data = 0.3 * torch.randn(channels)
    return layer


def snntorch_layers() -> Mapping[str, Module]:
    how = {"init_hidden": True, "reset_mechanism": "zero", "reset_delay": False}
    return {
        "conv1": torch.nn.Conv2d(2, 4, 3, padding=1),
        "bn1": normalised(torch.nn.BatchNorm2d(4), 4),
        "lif1": snntorch.Leaky(beta=0.9, **how),
        "flatten": torch.nn.Flatten(),
        "fc": torch.nn.Linear(4 * 6 * 6, 10, bias=False),
        "bn2": normalised(torch.nn.BatchNorm1d(10), 10),
        "lif2": snntorch.Leaky(beta=0.8, threshold=1.5, **how),
    }


def sinabs_layers() -> Mapping[str, Module]:
    return {
        "0": torch.nn.Conv2d(2, 4, 3, padding=1, bias=False),
        "1": OfOneStep(sinabs.layers.IAF(spike_fn=SingleSpike)),
        "2": torch.nn.MaxPool2d(2),
        "3": torch.nn.Flatten(),
        "4": torch.nn.Linear(4 * 3 * 3, 8),
        "5": OfOneStep(
            sinabs.layers.LIF(
                tau_mem=5.0, spike_fn=SingleSpike, reset_fn=sinabs.activation.MembraneReset()
            )
        ),
    }


def spikingjelly_layers() -> Mapping[str, Module]:
    return {
        "conv": torch.nn.Conv2d(1, 4, 3, padding=1, bias=False),
        "bn": normalised(torch.nn.BatchNorm2d(4), 4),
        "if1": neuron.IFNode(),
        "pool": torch.nn.MaxPool2d(2, 2),
        "flatten": torch.nn.Flatten(),
        "fc": torch.nn.Linear(4 * 4 * 4, 10, bias=False),
        "lif": neuron.LIFNode(tau=2.0),
    }


def norse_layers() -> Mapping[str, Module]:
    parameters = norse.LIFBoxParameters(tau_mem_inv=torch.tensor(200.0))
    return {
        "fc1": torch.nn.Linear(12, 24),
        "lif1": WithState(norse.LIFBoxCell(parameters)),
        "fc2": torch.nn.Linear(24, 6),
        "lif2": WithState(norse.LIFBoxCell(parameters)),
    }


def spikes(*shape: int) -> torch.Tensor:
    """Return random spikes (steps, *shape)."""
    return (torch.rand(STEPS, *shape) < 0.15).float()


def image(*shape: int) -> torch.Tensor:
    """Return a random image that is shown unchanged in every step."""
    return torch.rand(*shape).repeat(STEPS, *(1,) * len(shape))


def signals(channels: int) -> torch.Tensor:
    """Return sines with noise (steps, channels)."""
    time = torch.arange(STEPS)[:, None] / 8 + torch.arange(channels)[None, :]
    return torch.sin(time) + 0.1 * torch.randn(STEPS, channels)


class Recorded(NamedTuple):
    """A network: its layers, a recording, and factors of its first and its last weights, so that neurons spike."""

    layers: Callable[[], Mapping[str, Module]]
    recording: Callable[[], torch.Tensor]
    first_gain: float
    last_gain: float


NETWORKS: Mapping[str, Recorded] = {
    "snntorch": Recorded(snntorch_layers, lambda: spikes(2, 6, 6), first_gain=1.5, last_gain=4.0),
    "sinabs": Recorded(sinabs_layers, lambda: spikes(2, 6, 6), first_gain=2.5, last_gain=20.0),
    "spikingjelly": Recorded(
        spikingjelly_layers, lambda: image(1, 8, 8), first_gain=2.0, last_gain=6.0
    ),
    "norse": Recorded(norse_layers, lambda: signals(12), first_gain=4.0, last_gain=30.0),
}


def record(framework: str) -> dict[str, np.ndarray]:
    """Return the arrays of a framework's file by their names."""
    torch.manual_seed(2)
    recorded = NETWORKS[framework]
    layers = recorded.layers()
    first, *_, last = [layer for layer in layers.values() if isinstance(layer, WEIGHTED)]
    first.weight.data *= recorded.first_gain
    last.weight.data *= recorded.last_gain
    network = torch.nn.Module()
    for name, layer in layers.items():
        network.add_module(name, getattr(layer, "layer", getattr(layer, "cell", layer)))
    network.eval()
    state = io.BytesIO()
    torch.save(network.state_dict(), state)
    inputs = recorded.recording()
    sent: dict[str, list[np.ndarray]] = {}
    with torch.no_grad():
        for step in inputs:
            x = step[None]
            for name, layer in layers.items():
                x = layer(x)
                if not isinstance(layer, UNRECORDED):
                    sent.setdefault(name, []).append(x.flatten().numpy().astype(np.uint8))
    values = inputs.numpy()
    if set(np.unique(values)) <= {0, 1}:
        values = values.astype(np.uint8)
    rows = {name: np.array(found) for name, found in sent.items()}
    return {"state": np.frombuffer(state.getvalue(), np.uint8), "inputs": values, **rows}


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for framework in NETWORKS:
        held = record(framework)
        np.savez_compressed(FOLDER / f"{framework}.npz", **held)
        print(framework, {name: round(float(held[name].mean()), 3) for name in list(held)[2:]})
