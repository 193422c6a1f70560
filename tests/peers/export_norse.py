"""Networks of norse 1.1 as NIR, and how they spike: ``export_norse.py FOLDER``, in an environment of its own.

norse writes ``tau = dt * tau``: with its dt of 1e-3 the graphs are read with a step of 1e-6.
"""

import sys

import nir
import torch
from framework_files import heard, recording, save_trace
from norse.torch import SequentialState, to_nir
from norse.torch.module.iaf import IAFCell, IAFParameters
from norse.torch.module.leaky_integrator_box import LIBoxCell, LIBoxParameters
from norse.torch.module.lif_box import LIFBoxCell, LIFBoxParameters
from torch.nn import Linear


def linear(ins, outs):
    made = Linear(ins, outs)
    made.weight.data *= 8
    return made


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
    "lif": lambda: SequentialState(linear(20, 16), box(16), linear(16, 8), box(8)),
    "lif-at-rest-off-0": lambda: SequentialState(linear(20, 16), box(16, 0.1), linear(16, 8), box(8, -0.2)),
    "iaf": lambda: SequentialState(linear(20, 16), IAFCell(IAFParameters(v_th=torch.ones(16)))),
    "li": lambda: SequentialState(linear(20, 16), box(16), linear(16, 8), readout(8)),
}

if __name__ == "__main__":
    for name, make in NETWORKS.items():
        torch.manual_seed(0)
        network, given = make(), recording((20,))
        nir.write(f"{sys.argv[1]}/{name}.nir", to_nir(network, torch.zeros(1, 20)))
        cells = {k: m for k, m in network.named_modules() if isinstance(m, LIFBoxCell | LIBoxCell | IAFCell)}
        found, state = heard(cells), None
        with torch.no_grad():
            for row in given:
                _, state = network(torch.tensor(row)[None], state)
        save_trace(sys.argv[1], name, given, found)
