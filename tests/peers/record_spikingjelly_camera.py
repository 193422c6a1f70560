"""Write ``tests/frontends/scene-by-spikingjelly.npz``, in the environment of spikingjelly.

It holds a network as NIR, ``nir`` (bytes), and the spikes of its layers, ``1`` and ``5``, (steps,
neurons), for the events of ``tests/data/scene-evt3.raw`` in steps of a millisecond from the first on.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import torch
from spikingjelly.activation_based import functional, layer
from spikingjelly.activation_based.neuron import LIFNode
from spikingjelly.activation_based.nir_exchange import export_to_nir

TESTS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TESTS.parent))
from tests.support.raw_cameras import SIZE, scene  # noqa: E402

STEPS = 50
STEP_MICROSECONDS = 1_000


def frames() -> torch.Tensor:
    """Return the events as (steps, 1, polarity, y, x) of 0 and 1."""
    columns, rows = SIZE
    events = np.array(scene())
    step = (events[:, 0] - events[:, 0].min()) // STEP_MICROSECONDS
    images = torch.zeros(STEPS, 1, 2, rows, columns)
    images[step, 0, events[:, 3], events[:, 2], events[:, 1]] = 1
    return images


if __name__ == "__main__":
    torch.manual_seed(0)
    network = torch.nn.Sequential(
        layer.Conv2d(2, 4, 5, stride=2),
        LIFNode(tau=3.0),
        layer.AvgPool2d(2),
        layer.Flatten(),
        layer.Linear(4 * 4 * 7, 6),
        LIFNode(tau=2.0),
    )
    network[0].weight.data *= 16  # gains chosen by hand, so that neurons spike now and then
    network[4].weight.data *= 60
    columns, rows = SIZE
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.nir"
        export_to_nir(network, torch.zeros(1, 2, rows, columns), save_path=path)
        graph = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    functional.reset_net(network)
    spikes: dict[str, list[np.ndarray]] = {"1": [], "5": []}
    with torch.no_grad():
        for frame in frames():
            hidden = network[:2](frame)
            spikes["1"].append(hidden.flatten().numpy().astype(np.uint8))
            spikes["5"].append(network[2:](hidden).flatten().numpy().astype(np.uint8))
    target = TESTS / "frontends" / "scene-by-spikingjelly.npz"
    np.savez_compressed(
        target, nir=graph, **{name: np.array(rows) for name, rows in spikes.items()}
    )
    print({name: int(np.sum(rows)) for name, rows in spikes.items()})
