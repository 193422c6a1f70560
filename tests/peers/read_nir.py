"""Networks that we write as NIR, read and run by a framework: ``read_nir.py FRAMEWORK FOLDER``, in its environment.

Next to each graph lie its input spikes, one row per step; the spikes of populations a, b and c are written there.
"""

import sys
from pathlib import Path

import nir
import numpy as np
import torch
from framework_files import heard


def read(framework, graph):
    """Return a module of a framework for a graph, with a step of 1e-4 s."""
    if framework == "snntorch":
        from snntorch.import_nir import import_from_nir

        return import_from_nir(graph)
    if framework == "norse":
        from norse.torch import from_nir

        return from_nir(graph, dt=1e-4)
    from spikingjelly.activation_based.nir_exchange import import_from_nir

    return import_from_nir(graph, dt=1e-4)


if __name__ == "__main__":
    framework, folder = sys.argv[1:]
    for path in sorted(Path(folder).glob("*.nir")):
        module = read(framework, nir.read(path))
        spikes = np.load(path.with_suffix(".npy")).astype(np.float32)
        # What each population sends is appended to its list as the module runs.
        sent = heard({name: module.get_submodule(name) for name in "abc"})
        steps = torch.from_numpy(spikes)
        if framework != "norse":
            steps = steps[:, None]  # the others take a batch
        state = None
        with torch.no_grad():
            for row in steps:
                _, state = module(row, state)
        by_population = {name: np.reshape(rows, (len(spikes), -1)) for name, rows in sent.items()}
        np.savez(path.with_suffix(".npz"), **by_population)
