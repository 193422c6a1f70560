"""Write ``tests/frontends/lava-dl-numbers/<network>.npz``, in the environment of lava-dl 0.6.

The files let tests compare networks with real-valued inputs without lava-dl. With ``record_lava_dl_numbers.py FOLDER SEED``,
write networks of the same kinds with other weights, and other recordings.
Each file holds a network as lava-dl exports it, ``net`` (the bytes of a ``.net`` file), real-valued recordings,
``inputs`` (samples, steps, ...), and what each layer of neurons sends in slayer's forward pass, by the layer's
name, (samples, steps, neurons).
"""

import io
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
import torch

sys.modules["lava.lib.dl.slayer.object_detection"] = types.ModuleType(
    "unused"
)  # the only part that needs torchvision
from lava.lib.dl import slayer  # noqa: E402

FOLDER = Path(__file__).resolve().parents[1] / "frontends" / "lava-dl-numbers"
SAMPLES = 3
STEPS = 40
CUBA = slayer.block.cuba
NEURON = {"threshold": 1.25, "current_decay": 0.25, "voltage_decay": 0.03}
Blocks = list[torch.nn.Module]


def signal_blocks() -> Blocks:
    """An input layer with a weight and a bias, whose neurons have decays of their own."""
    neuron = {
        "threshold": 1.0,
        "current_decay": [0.2, 0.9],
        "voltage_decay": [0.02, 0.2],
        "shared_param": False,
    }
    return [
        CUBA.Input(neuron, weight=0.8, bias=0.15),
        CUBA.Dense(NEURON, 12, 20, weight_scale=4),
        CUBA.Dense(NEURON, 20, 6, weight_scale=4),
    ]


def image_blocks() -> Blocks:
    """An input layer of images, which is driven by their numbers without weight and bias."""
    return [
        CUBA.Input({"threshold": 1.5, "current_decay": 0.6, "voltage_decay": 0.07}),
        CUBA.Conv(NEURON, 2, 4, 3, padding=1, stride=2, weight_scale=4),
        CUBA.Flatten(),
        CUBA.Dense(NEURON, 36, 5, weight_scale=4),
    ]


def recurrent_blocks() -> Blocks:
    """Numbers that reach neurons with connections to themselves."""
    return [
        CUBA.Recurrent(dict(NEURON), 9, 16, weight_scale=4),
        CUBA.Dense(NEURON, 16, 6, weight_scale=6),
    ]


def convolved_blocks() -> Blocks:
    """Images that reach a convolution unrounded."""
    return [
        CUBA.Conv(NEURON, 2, 4, 3, padding=1, weight_scale=4),
        CUBA.Pool(dict(NEURON), 2, weight_scale=8),
        CUBA.Flatten(),
        CUBA.Dense(NEURON, 36, 5, weight_scale=4),
    ]


def direct_blocks() -> Blocks:
    """Numbers that reach a layer of weights without an input layer, unrounded."""
    return [
        CUBA.Dense(NEURON, 9, 16, weight_scale=4),
        CUBA.Dense(NEURON, 16, 6, weight_scale=6),
    ]


def signals(channels: int) -> torch.Tensor:
    """Return sines with noise, some of them beyond the largest number of 8 bits, 127 / 32."""
    time = torch.arange(STEPS) / 8
    phases = 6 * torch.rand(SAMPLES, channels, 1)
    noise = 0.2 * torch.randn(SAMPLES, channels, STEPS)
    sizes = torch.linspace(0.3, 4.5, channels)[None, :, None]
    return sizes * torch.sin(time + phases) + noise


def held_images(*shape: int) -> torch.Tensor:
    """Return images that are shown unchanged in every step."""
    return torch.rand(SAMPLES, *shape, 1).repeat(*(1,) * (len(shape) + 1), STEPS)


class Recorded(NamedTuple):
    """A network: its blocks, and its recordings (samples, ..., steps)."""

    blocks: Callable[[], Blocks]
    recordings: Callable[[], torch.Tensor]


NETWORKS = {
    "signals": Recorded(signal_blocks, lambda: signals(12)),
    "images": Recorded(image_blocks, lambda: held_images(2, 6, 6)),
    "direct": Recorded(direct_blocks, lambda: 0.3 * signals(9)),
    "recurrent": Recorded(recurrent_blocks, lambda: 0.4 * signals(9)),
    "convolved": Recorded(convolved_blocks, lambda: held_images(2, 6, 6)),
}


def record(name: str, seed: int) -> dict[str, np.ndarray]:
    """Return the arrays of a network's file by their names."""
    torch.manual_seed(seed)
    blocks = NETWORKS[name].blocks()
    inputs = NETWORKS[name].recordings()
    sent: dict[str, np.ndarray] = {}
    values = inputs
    with torch.no_grad():
        for number, block in enumerate(blocks):
            values = block(values)
            if not isinstance(block, CUBA.Flatten):
                rows = np.moveaxis(values.numpy(), -1, 1).reshape(SAMPLES, STEPS, -1)
                sent[f"layer{number}"] = rows.astype(np.uint8)
    exported = io.BytesIO()
    with h5py.File(exported, "w") as file:
        for number, block in enumerate(blocks):
            block.export_hdf5(file.create_group(f"layer/{number}"))
    net = np.frombuffer(exported.getvalue(), np.uint8)
    return {"net": net, "inputs": np.moveaxis(inputs.numpy(), -1, 1), **sent}


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    seed = int(sys.argv[2]) if len(sys.argv) > 1 else 4
    folder.mkdir(exist_ok=True)
    for name in NETWORKS:
        recorded = record(name, seed)
        np.savez_compressed(folder / f"{name}.npz", **recorded)
        spikes = {key: array for key, array in recorded.items() if key.startswith("layer")}
        print(name, {key: round(float(array.mean()), 3) for key, array in spikes.items()})
