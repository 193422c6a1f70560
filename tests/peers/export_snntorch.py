"""Networks of snnTorch 1.0 as NIR, and how they spike: ``export_snntorch.py FOLDER``, in an environment of its own.

snnTorch resets a neuron at once (``reset_delay=False``) or, by default, in the step after its spike: *late*. Gains of weights
were chosen by hand, so that neurons spike now and then.
"""

import sys

import nir
import snntorch as snn
import torch
from framework_files import save_played
from snntorch.export_nir import export_to_nir
from torch.nn import AvgPool2d, Conv2d, Flatten, Linear, Sequential

ZERO = {"reset_mechanism": "zero", "reset_delay": False}
LATE_ZERO, LATE_SUBTRACT = {"reset_mechanism": "zero"}, {"reset_mechanism": "subtract"}

ALL_TO_ALL = {"all_to_all": True, "linear_features": 16}


def linear(ins, outs, gain=3.0):
    layer = Linear(ins, outs)
    layer.weight.data *= gain
    return layer


def leaky(*shape, beta=0.9, how=ZERO):
    beta = torch.full(shape, beta) + (0.05 * torch.rand(shape) if 0 < beta < 1 else 0)
    return snn.Leaky(beta=beta, threshold=torch.ones(shape), init_hidden=True, **how)


def synaptic(n, how=ZERO):
    each = torch.ones(n)
    return snn.Synaptic(alpha=0.7 * each, beta=0.9 * each, threshold=each, init_hidden=True, **how)


def recurrent(n, how=ZERO, **weights):
    return snn.RLeaky(
        beta=torch.full((n,), 0.9), threshold=torch.ones(n), init_hidden=True, **weights, **how
    )


def recurrent_synaptic(n, how):
    each = torch.ones(n)
    return snn.RSynaptic(
        alpha=0.7 * each, beta=0.9 * each, threshold=each, init_hidden=True, **ALL_TO_ALL, **how
    )


def layers(neuron, how=ZERO):
    return Sequential(
        linear(ins=20, outs=16), neuron(16, how=how), linear(ins=16, outs=8), neuron(8, how=how)
    )


NETWORKS = {
    "leaky": lambda: layers(leaky),
    "synaptic": lambda: layers(synaptic),
    "leaky-late-subtract": lambda: layers(leaky, LATE_SUBTRACT),
    "synaptic-late-subtract": lambda: layers(synaptic, LATE_SUBTRACT),
    "synaptic-late-zero": lambda: layers(synaptic, LATE_ZERO),
    "beta-1": lambda: Sequential(linear(ins=20, outs=16), leaky(16, beta=1.0)),
    "beta-0": lambda: Sequential(linear(ins=20, outs=16), leaky(16, beta=0.0)),
    "recurrent": lambda: Sequential(
        linear(ins=20, outs=16), recurrent(16, **ALL_TO_ALL), linear(ins=16, outs=8), leaky(8)
    ),
    "recurrent-one-to-one": lambda: Sequential(
        linear(ins=20, outs=16), recurrent(16, all_to_all=False, V=-torch.rand(16))
    ),
    "recurrent-late-zero": lambda: Sequential(
        linear(ins=20, outs=16), recurrent(16, LATE_ZERO, **ALL_TO_ALL)
    ),
    "recurrent-late-subtract": lambda: Sequential(
        linear(ins=20, outs=16), recurrent(16, LATE_SUBTRACT, **ALL_TO_ALL)
    ),
    "recurrent-synaptic-late-zero": lambda: Sequential(
        linear(ins=20, outs=16), recurrent_synaptic(16, LATE_ZERO)
    ),
    "recurrent-synaptic-late-subtract": lambda: Sequential(
        linear(ins=20, outs=16), recurrent_synaptic(16, LATE_SUBTRACT)
    ),
    "nested": lambda: Sequential(
        Sequential(linear(ins=20, outs=16), leaky(16)), Sequential(linear(ins=16, outs=8), leaky(8))
    ),
}
IMAGES = {
    "conv": lambda: Sequential(
        Conv2d(2, 4, 3, padding=1), leaky(4, 8, 8), AvgPool2d(2), Conv2d(4, 3, 3, bias=False), leaky(3, 2, 2),
        Flatten(), linear(ins=12, outs=5), leaky(5),
    ),
}  # fmt: skip

if __name__ == "__main__":
    for name, make in {**NETWORKS, **IMAGES}.items():
        torch.manual_seed(0)
        network, shape = make(), (2, 8, 8) if name in IMAGES else (20,)
        if name in IMAGES:
            network[0].weight.data *= 3
            network[3].weight.data *= 6
        graph = export_to_nir(network, torch.zeros(1, *shape), ignore_dims=[0])
        nir.write(f"{sys.argv[1]}/{name}.nir", graph)
        neurons = {key: m for key, m in network.named_modules() if isinstance(m, snn.SpikingNeuron)}
        for neuron in neurons.values():
            neuron.reset_mem()
        save_played(sys.argv[1], name, network, neurons, shape)
