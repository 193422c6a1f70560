"""Networks of spikingjelly 2.0 as NIR, and how they spike: ``export_spikingjelly.py FOLDER``, in its environment.

Gains of weights were chosen by hand, so that neurons spike now and then.
"""

import sys

import torch
from framework_files import save_played
from spikingjelly.activation_based import functional, layer
from spikingjelly.activation_based.neuron import (
    BaseNode,
    CUBALIFNode,
    IFNode,
    LIFNode,
    ParametricLIFNode,
)
from spikingjelly.activation_based.nir_exchange import export_to_nir
from torch.nn import Module, Sequential


def scaled(made, gain=8.0):
    made.weight.data *= gain
    return made


def linear(ins, outs, gain=8.0):
    return scaled(layer.Linear(ins, outs), gain)


def two(neuron, gain=8.0, **more):
    """Return a network of two layers of a kind of neuron."""
    return Sequential(
        linear(ins=20, outs=16, gain=gain),
        neuron(**more),
        linear(ins=16, outs=8, gain=2 * gain),
        neuron(**more),
    )


class Skip(Module):
    """A network whose output has inputs from both hidden layers: through separate weights, or (``summed``) their sum."""

    def __init__(self, summed):
        super().__init__()
        self.summed, self.first, self.second, self.last = (
            summed,
            *(LIFNode(tau=4.0) for _ in range(3)),
        )
        self.fc1, self.fc2, self.fc3, self.over = (
            linear(ins=20, outs=16, gain=12),
            linear(ins=16, outs=16),
            linear(ins=16, outs=8),
            linear(ins=16, outs=8),
        )

    def forward(self, x):
        a = self.first(self.fc1(x))
        b = self.second(self.fc2(a))
        return self.last(self.fc3(a + b) if self.summed else self.fc3(b) + self.over(a))


NETWORKS = {
    "lif": lambda: two(LIFNode, tau=3.0),
    "lif-at-rest-off-0": lambda: two(LIFNode, tau=3.0, v_reset=-0.2),
    "lif-whole-input": lambda: two(LIFNode, 4.0, tau=5.0, decay_input=False, v_reset=0.2),
    "parametric": lambda: two(ParametricLIFNode, init_tau=3.0),
    "if": lambda: two(IFNode, 3.0),
    "if-reset-off-0": lambda: two(IFNode, 3.0, v_reset=-0.5),
    "cuba": lambda: two(CUBALIFNode, 3.0, c_decay=0.6, v_decay=0.8),
    "skip": lambda: Skip(summed=False),
    "skip-sum": lambda: Skip(summed=True),
}
IMAGES = {
    "conv": lambda: Sequential(
        scaled(layer.Conv2d(2, 4, 3, padding=1)), LIFNode(tau=3.0), layer.AvgPool2d(2, padding=1),
        scaled(layer.Conv2d(4, 3, 3, bias=False), 16), LIFNode(tau=2.0), layer.Flatten(), linear(ins=27, outs=5, gain=12), LIFNode(),
    ),
    "conv1d": lambda: Sequential(
        scaled(layer.Conv1d(3, 4, 3, padding="same")), LIFNode(tau=3.0), layer.Flatten(), linear(ins=48, outs=5, gain=12), LIFNode()
    ),
}  # fmt: skip
SHAPES = {"conv": (2, 8, 8), "conv1d": (3, 12)}

if __name__ == "__main__":
    for name, make in {**NETWORKS, **IMAGES}.items():
        torch.manual_seed(0)
        network, shape = make(), SHAPES.get(name, (20,))
        export_to_nir(network, torch.zeros(1, *shape), save_path=f"{sys.argv[1]}/{name}.nir")
        functional.reset_net(network)
        # Nodes of a chain are called _0, _1, ...
        neurons = {
            f"_{k}" if k.isdigit() else k: m
            for k, m in network.named_modules()
            if isinstance(m, BaseNode)
        }
        save_played(sys.argv[1], name, network, neurons, shape)
