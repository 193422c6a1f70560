"""Networks of norse 1.1 as NIR, and how they spike: ``export_norse.py FOLDER``, in an environment of its own.

norse multiplies each time constant with its step of 1e-3 once more when it writes, so its graphs are read with a step of
1e-6. Its own models are chains; graphs with skip connections are written here and run by nirtorch with norse's cells.
"""

import sys

import nir
import numpy as np
import torch
from framework_files import heard, recording, save_trace
from nirtorch import nir_to_torch
from norse.torch import SequentialState, to_nir
from norse.torch.module.iaf import IAFCell, IAFParameters
from norse.torch.module.leaky_integrator_box import LIBoxCell, LIBoxParameters
from norse.torch.module.lif_box import LIFBoxCell, LIFBoxParameters
from torch.nn import Linear


def linear(ins, outs):
    layer = Linear(ins, outs)
    layer.weight.data *= 8  # with the weights of torch neurons would be silent
    return layer


def box(n, leak=0.0):
    parameters = {
        "tau_mem_inv": 100 + 50 * torch.rand(n),
        "v_th": torch.full((n,), 0.3),
        "v_leak": torch.full((n,), leak),
    }
    return LIFBoxCell(LIFBoxParameters(**parameters))


def readout(n):
    return LIBoxCell(LIBoxParameters(tau_mem_inv=torch.full((n,), 100.0), v_leak=torch.zeros(n)))


NETWORKS = {
    "lif": lambda: SequentialState(
        linear(ins=20, outs=16), box(16), linear(ins=16, outs=8), box(8)
    ),
    "lif-at-rest-off-0": lambda: SequentialState(
        linear(ins=20, outs=16), box(n=16, leak=0.1), linear(ins=16, outs=8), box(n=8, leak=-0.2)
    ),
    "iaf": lambda: SequentialState(
        linear(ins=20, outs=16), IAFCell(IAFParameters(v_th=torch.ones(16)))
    ),
    "li": lambda: SequentialState(
        linear(ins=20, outs=16), box(16), linear(ins=16, outs=8), readout(8)
    ),
}
CHAIN = ("input a", "a b", "b c", "c d")
GRAPHS = {
    "skip": ((*CHAIN, "a c"), {}),
    "skips": ((*CHAIN, "a c", "b d", "a d", "input c"), {}),
    "branches": (("input a", "a b", "input c", "b d", "c d"), {}),
    "recurrent-skip": ((*CHAIN, "a a", "b b", "a c"), {}),
    "spikes-by-itself": ((*CHAIN, "a c"), {"a": (0.5, 0.1), "b": (0.3, 0.0), "c": (0.4, -0.2)}),
}
SIZES = {"input": 20, "a": 12, "b": 10, "c": 9, "d": 8}


def graph(rng, ways, rests):
    """Return a graph with weights for each way ``source target``.

    ``rests``: v_leak and v_reset of the populations where they are not 0.
    """
    nodes, edges = (
        {"input": nir.Input(np.array([20])), "output": nir.Output(np.array([8]))},
        [("d", "output")],
    )
    for way in ways:
        source, target = way.split()
        ins, outs = SIZES[source], SIZES[target]
        # nirtorch leaves the bias of a loop out of the first step; snnTorch does not, nor do we.
        back = source == target
        bias = np.zeros(outs) if back else rng.normal(0.05, 0.1, outs)
        nodes[f"{source}_{target}"] = nir.Affine(
            rng.normal(0.1, 0.15 if back else 1.0, (outs, ins)), bias
        )
        edges += [(source, f"{source}_{target}"), (f"{source}_{target}", target)]
    for name in "abcd":
        leak, reset = (np.full(SIZES[name], value) for value in rests.get(name, (0.0, 0.0)))
        tau, limit = rng.uniform(5e-6, 2e-5, SIZES[name]), np.full(SIZES[name], 0.3)
        nodes[name] = nir.LIF(tau, np.ones_like(tau), leak, limit, reset)
    nodes["d"] = nir.IF(np.ones(8), np.ones(8), np.full(8, -0.4))
    return nir.NIRGraph(nodes, edges)


def tensor(values):
    return torch.from_numpy(np.asarray(values)).float()


def cell(node):
    parameters = LIFBoxParameters(
        1e-3 / tensor(node.tau),
        v_leak=tensor(node.v_leak),
        v_th=tensor(node.v_threshold),
        v_reset=tensor(node.v_reset),
    )
    return LIFBoxCell(parameters)


def affine(node):
    layer = Linear(*node.weight.shape[::-1])
    layer.weight.data, layer.bias.data = tensor(node.weight), tensor(node.bias)
    return layer


def integrator(node):
    return IAFCell(IAFParameters(v_th=tensor(node.v_threshold), v_reset=tensor(node.v_reset)))


def written(made, path):
    """Write a model of norse, or a graph; return what runs it."""
    if isinstance(made, nir.NIRGraph):
        nir.write(path, made)
        return nir_to_torch(nir.read(path), {nir.LIF: cell, nir.IF: integrator, nir.Affine: affine})
    nir.write(path, to_nir(made, torch.zeros(1, 20)))
    return made


if __name__ == "__main__":
    for name in (*NETWORKS, *GRAPHS):
        torch.manual_seed(0)
        made = (
            NETWORKS[name]() if name in NETWORKS else graph(np.random.default_rng(5), *GRAPHS[name])
        )
        network, given = written(made, f"{sys.argv[1]}/{name}.nir"), recording((20,))
        cells = {
            k: m
            for k, m in network.named_modules()
            if isinstance(m, LIFBoxCell | LIBoxCell | IAFCell)
        }
        found, state = heard(cells), None
        with torch.no_grad():
            for row in given:
                _, state = network(torch.tensor(row)[None], state)
        save_trace(sys.argv[1], name, given, found)
