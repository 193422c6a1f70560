"""Time an epoch of the hybrid in a peer's own environment: ``training_peer.py TOOL RECORDINGS.npz``.

Each line of input is a batch size and is answered with ``{"seconds": ...}``, the processor time of one epoch. Each of both
branches has two fully connected layers of the tool's own neurons with a synaptic current. Current and membrane have the same
decay, and the tool's own reset stands in the place of the refractory kernel; so does its own surrogate gradient. Sums of
weights are one matrix product for all steps, and the loss is the cross-entropy of scaled spike counts, with AdamW: this is
what ``locsnn train`` does without dropping events.
"""

import json
import math
import sys
import time
from importlib.metadata import version

import numpy as np
import torch
from torch import nn

HIDDEN, TAU, THETA, COUNT_SCALE = 32, 10.0, 10.0, 0.1
DECAY = math.exp(-1.0 / TAU)


class SnnTorchLayer(nn.Module):
    """A fully connected layer of ``snn.Synaptic`` neurons, stepped in Python."""

    def __init__(self, inputs, outputs):
        super().__init__()
        import snntorch

        self.sums = nn.Linear(inputs, outputs, bias=False)
        self.neurons = snntorch.Synaptic(alpha=DECAY, beta=DECAY, threshold=THETA)

    def forward(self, x):
        synapse, membrane = self.neurons.init_synaptic()
        spikes = []
        for drive in self.sums(x):
            fired, synapse, membrane = self.neurons(drive, synapse, membrane)
            spikes.append(fired)
        return torch.stack(spikes)


class SpikingJellyLayer(nn.Module):
    """A fully connected layer, a synapse filter and ``LIFNode`` neurons, all in multi-step mode."""

    def __init__(self, inputs, outputs):
        super().__init__()
        from spikingjelly.activation_based import layer, neuron

        self.all = nn.Sequential(
            layer.Linear(inputs, outputs, bias=False, step_mode="m"),
            layer.SynapseFilter(tau=1 / (1 - DECAY), step_mode="m"),
            neuron.LIFNode(
                tau=1 / (1 - DECAY), decay_input=False, v_threshold=THETA, step_mode="m"
            ),
        )

    def forward(self, x):
        from spikingjelly.activation_based import functional

        functional.reset_net(self.all)
        return self.all(x)


LAYERS = {"snntorch": SnnTorchLayer, "spikingjelly": SpikingJellyLayer}


def main():
    tool, path = sys.argv[1:]
    torch.set_num_threads(1)
    with np.load(path) as arrays:
        spikes, labels = arrays["spikes"], torch.from_numpy(arrays["labels"])
    _, steps, channels = spikes.shape
    classes, make = int(labels.max()) + 1, LAYERS[tool]
    torch.manual_seed(0)
    time_branch = nn.Sequential(make(channels, HIDDEN), make(HIDDEN, classes))
    location_branch = nn.Sequential(make(steps, HIDDEN), make(HIDDEN, classes))
    parameters = [*time_branch.parameters(), *location_branch.parameters()]
    with torch.no_grad():
        for weight in parameters:
            weight.uniform_(-3 / math.sqrt(weight.shape[-1]), 3 / math.sqrt(weight.shape[-1]))
    optimizer = torch.optim.AdamW(parameters, lr=0.003, weight_decay=0.1, foreach=True)

    def epoch(batch, rows):
        for first in range(0, rows, batch):
            x = torch.from_numpy(spikes[first : first + batch].astype(np.float32))
            counts = time_branch(x.transpose(0, 1)).sum(0) + location_branch(
                x.permute(2, 0, 1)
            ).sum(0)
            loss = nn.functional.cross_entropy(COUNT_SCALE * counts, labels[first : first + batch])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()

    epoch(8, 8)  # a first batch, which is not timed: torch prepares itself
    print(json.dumps({"version": version(tool)}), flush=True)
    for line in sys.stdin:
        before = time.process_time()
        epoch(int(line), len(spikes))
        print(json.dumps({"seconds": time.process_time() - before}), flush=True)


if __name__ == "__main__":
    main()
