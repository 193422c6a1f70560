"""Train 156-32-20 networks of Leaky and of Synaptic neurons briefly: ``train_snntorch.py FOLDER``, in snnTorch's environment.

A class is a synthetic pattern of rates, one for each channel. Each trained network is written as NIR, with labelled
recordings that it has not learned from and its spikes for them.
"""

import sys

import nir
import numpy as np
import snntorch as snn
import torch
from framework_files import heard, save_trace
from snntorch.export_nir import export_to_nir
from torch.nn import Linear, Sequential

CHANNELS, HIDDEN, CLASSES, STEPS = 156, 32, 20, 50
ZERO = {"reset_mechanism": "zero", "reset_delay": False, "init_hidden": True}
EPOCHS, BATCH, TRAINED, TESTED = 60, 50, 400, 40


def recordings(samples, patterns, rng):
    """Return spikes (samples, steps, channels) of classes in turn, each channel at its pattern's rate, and labels."""
    labels = np.arange(samples) % CLASSES
    rates = patterns[labels][:, None]
    return (rng.random((samples, STEPS, CHANNELS)) < rates).astype(np.float32), labels


def neurons(kind, n):
    each = torch.ones(n)
    if kind == "leaky":
        return snn.Leaky(beta=0.9 * each, threshold=each, **ZERO)
    return snn.Synaptic(alpha=0.7 * each, beta=0.9 * each, threshold=each, **ZERO)


def counts(network, given):
    """Return the output's spike counts (batch, classes) for recordings (batch, steps, channels), starting from rest."""
    for module in network:
        if isinstance(module, snn.SpikingNeuron):
            module.reset_mem()
    return sum(network(row) for row in given.transpose(0, 1))


def train(network, given, labels):
    adam = torch.optim.Adam(network.parameters(), lr=2e-3)
    for _ in range(EPOCHS):
        for part in torch.randperm(len(given)).split(BATCH):
            loss = torch.nn.functional.cross_entropy(
                0.3 * counts(network, given[part]), labels[part]
            )
            adam.zero_grad()
            loss.backward()
            adam.step()


if __name__ == "__main__":
    torch.set_num_threads(1)
    rng = np.random.default_rng(0)
    patterns = rng.uniform(0.02, 0.12, (CLASSES, CHANNELS))
    seen, unseen = recordings(TRAINED, patterns, rng), recordings(TESTED, patterns, rng)
    for kind in ("leaky", "synaptic"):
        torch.manual_seed(0)
        network = Sequential(
            Linear(CHANNELS, HIDDEN),
            neurons(kind, HIDDEN),
            Linear(HIDDEN, CLASSES),
            neurons(kind, CLASSES),
        )
        train(network, torch.tensor(seen[0]), torch.tensor(seen[1]))
        nir.write(
            f"{sys.argv[1]}/{kind}.nir",
            export_to_nir(network, torch.zeros(1, CHANNELS), ignore_dims=[0]),
        )
        found = heard({"1": network[1], "3": network[3]})
        with torch.no_grad():
            counts(network, torch.tensor(unseen[0]))
        given = unseen[0].reshape(-1, CHANNELS)
        layers = {
            name: np.stack(rows, axis=1).reshape(len(given), -1) for name, rows in found.items()
        }
        save_trace(sys.argv[1], kind, given, {**layers, "labels": np.repeat(unseen[1], STEPS)})
