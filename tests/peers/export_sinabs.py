"""Networks of sinabs 3.1 as NIR, and how they spike: ``export_sinabs.py FOLDER``, in an environment of its own.

sinabs counts time constants in steps, holds inputs for a step, and sends at most one spike per step with ``SingleSpike``.
Weights are multiplied by gains, chosen by hand, with which neurons spike now and then.
"""

import sys

import nir
import sinabs.layers as sl
import torch
from framework_files import save_played
from sinabs.activation import MembraneReset, MembraneSubtract, SingleSpike
from sinabs.nir import to_nir
from torch.nn import Conv1d, Conv2d, Flatten, Linear, Sequential

ZERO = {"spike_fn": SingleSpike, "reset_fn": MembraneReset()}
SUBTRACT = {"spike_fn": SingleSpike, "reset_fn": MembraneSubtract()}


def linear(ins, outs, gain):
    layer = Linear(ins, outs)
    layer.weight.data *= gain
    return layer


def lif(n, how):
    tau = torch.full((n,), 10.0) + 5 * torch.rand(n)
    return sl.LIFSqueeze(tau_mem=tau, spike_threshold=torch.full((n,), 0.4), batch_size=1, **how)


def iaf(how):
    return sl.IAFSqueeze(batch_size=1, **how)


def conv(kind, *shape, **more):
    layer = kind(*shape, **more)
    layer.weight.data *= 5
    return layer


def readout(n):
    return sl.ExpLeakSqueeze(tau_mem=torch.full((n,), 12.0), batch_size=1, norm_input=True)


NETWORKS = {
    "lif": lambda: Sequential(
        linear(ins=20, outs=16, gain=12),
        lif(16, ZERO),
        linear(ins=16, outs=8, gain=12),
        lif(8, ZERO),
    ),
    "lif-subtract": lambda: Sequential(
        linear(ins=20, outs=16, gain=12),
        lif(16, SUBTRACT),
        linear(ins=16, outs=8, gain=12),
        lif(8, SUBTRACT),
    ),
    "iaf": lambda: Sequential(
        linear(ins=20, outs=16, gain=4), iaf(ZERO), linear(ins=16, outs=8, gain=4), iaf(ZERO)
    ),
    "iaf-subtract": lambda: Sequential(
        linear(ins=20, outs=16, gain=2),
        iaf(SUBTRACT),
        linear(ins=16, outs=8, gain=2),
        iaf(SUBTRACT),
    ),
    "li": lambda: Sequential(
        linear(ins=20, outs=16, gain=12), lif(16, ZERO), linear(ins=16, outs=8, gain=4), readout(8)
    ),
}
IMAGES = {
    "conv": lambda: Sequential(
        conv(Conv2d, 2, 4, 3, padding=1, bias=False), iaf(ZERO), sl.SumPool2d(2), conv(Conv2d, 4, 3, 3), iaf(ZERO),
        Flatten(), linear(ins=12, outs=5, gain=8), iaf(ZERO),
    ),
    "conv1d": lambda: Sequential(conv(Conv1d, 3, 4, 3, padding=1), iaf(ZERO), Flatten(), linear(ins=48, outs=5, gain=8), iaf(ZERO)),
}  # fmt: skip
SHAPES = {"conv": (2, 8, 8), "conv1d": (3, 12)}

if __name__ == "__main__":
    for name, make in {**NETWORKS, **IMAGES}.items():
        torch.manual_seed(0)
        network, shape = make(), SHAPES.get(name, (20,))
        with torch.no_grad():
            network(torch.zeros(1, *shape))  # neurons get their size in the first pass
        graph = to_nir(network, torch.zeros(1, *shape))
        graph.infer_types()  # a Flatten cannot be written without
        nir.write(f"{sys.argv[1]}/{name}.nir", graph)
        layers = {key: m for key, m in network.named_modules() if isinstance(m, sl.StatefulLayer)}
        for layer in layers.values():
            layer.reset_states()
        save_played(sys.argv[1], name, network, layers, shape)
