"""Networks of sinabs 3.1 whose potentials have a floor (``min_v_mem``), and how they spike.

``record_sinabs_floors.py FILE.npz`` writes them, in an environment of its own that has sinabs, nir
and h5py. Each network has two layers. The file has the following arrays for each network:

- ``NAME.nir``: its graph, the bytes of the file that sinabs' own export writes
- ``NAME.floor``: its floor, which a NIR file cannot express
- ``NAME.input``: the spikes of its input (steps, channels)
- ``NAME.first`` and ``NAME.second``: the spikes of its layers (steps, neurons)
- ``NAME.free``: the spikes of the first layer without a floor; inhibition is strong, so that many
  potentials reach the floor and these differ
"""

import sys
import tempfile
from pathlib import Path

import nir
import numpy as np
import sinabs.layers as sl
import torch
from sinabs.activation import MembraneReset, MembraneSubtract, SingleSpike
from sinabs.nir import to_nir
from torch.nn import Linear, Sequential

CHANNELS, HIDDEN, OUTPUTS, STEPS = 20, 16, 8, 120
RESETS = {"zero": MembraneReset(), "subtract": MembraneSubtract()}
FLOORS = {"at-rest": 0.0, "shallow": -0.3, "one-threshold": -1.0, "deep": -2.5}
"""In the units of the threshold of ``iaf``."""
THRESHOLD = {"iaf": 1.0, "lif": 0.4}


def layer(kind, neurons, reset, floor):
    """Return neurons that send at most one spike per step."""
    how = {"spike_fn": SingleSpike, "reset_fn": RESETS[reset], "min_v_mem": floor, "batch_size": 1}
    if kind == "iaf":
        return sl.IAFSqueeze(spike_threshold=torch.full((neurons,), THRESHOLD[kind]), **how)
    tau = torch.linspace(8, 20, neurons)
    threshold = torch.full((neurons,), THRESHOLD[kind])
    return sl.LIFSqueeze(tau_mem=tau, spike_threshold=threshold, **how)


def network(kind, reset, floor, seed):
    """Return a network of two layers, with weights that are mostly negative in the first."""
    generator = torch.Generator().manual_seed(seed)
    gain = {"iaf": 1.0, "lif": 9.0}[kind]

    def linear(ins, outs, mean):
        made = Linear(ins, outs, bias=False)
        made.weight.data = gain * (0.5 * torch.randn(outs, ins, generator=generator) + mean)
        return made

    return Sequential(
        linear(CHANNELS, HIDDEN, -0.05),
        layer(kind, HIDDEN, reset, floor),
        linear(HIDDEN, OUTPUTS, 0.05),
        layer(kind, OUTPUTS, reset, floor),
    )


def play(made, spikes):
    """Return the spikes of both layers (steps, neurons)."""
    for module in made:
        if isinstance(module, sl.StatefulLayer):
            module.reset_states()
    with torch.no_grad():
        first = made[1](made[0](spikes))
        second = made[3](made[2](first))
    return first.numpy().astype(np.uint8), second.numpy().astype(np.uint8)


def graph_bytes(made):
    """Return the content of the NIR file that sinabs writes."""
    graph = to_nir(made, torch.zeros(1, CHANNELS))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "graph.nir"
        nir.write(path, graph)
        return np.frombuffer(path.read_bytes(), dtype=np.uint8)


def main():
    arrays = {}
    for seed, (kind, reset, floor) in enumerate(
        (kind, reset, floor) for kind in THRESHOLD for reset in RESETS for floor in FLOORS
    ):
        name = f"{kind}-{reset}-{floor}"
        generator = torch.Generator().manual_seed(100 + seed)
        spikes = (torch.rand(STEPS, CHANNELS, generator=generator) < 0.2).float()
        recorded_network = network(kind, reset, FLOORS[floor], seed)
        # Neurons get their size in the first pass, which the export needs.
        play(recorded_network, spikes)
        arrays[f"{name}.nir"] = graph_bytes(recorded_network)
        arrays[f"{name}.floor"] = np.array(FLOORS[floor])
        arrays[f"{name}.input"] = spikes.numpy().astype(np.uint8)
        arrays[f"{name}.first"], arrays[f"{name}.second"] = play(recorded_network, spikes)
        arrays[f"{name}.free"], _ = play(network(kind, reset, floor=None, seed=seed), spikes)
        changed = int((arrays[f"{name}.free"] != arrays[f"{name}.first"]).sum())
        counts = [int(arrays[f"{name}.{part}"].sum()) for part in ("first", "second")]
        print(f"{name}: {counts} spikes, {changed} differ without a floor")
    np.savez_compressed(sys.argv[1], **arrays)


if __name__ == "__main__":
    main()
