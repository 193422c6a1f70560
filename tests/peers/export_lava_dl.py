"""Networks of lava-dl 0.6 as ``.net`` files, and how they spike: ``export_lava_dl.py FOLDER``, in its environment."""

import sys
import types

import h5py
import numpy as np
import torch
from framework_files import save_trace

sys.modules["lava.lib.dl.slayer.object_detection"] = types.ModuleType(
    "unused"
)  # the only part that needs torchvision
from lava.lib.dl import slayer  # noqa: E402

CUBA = slayer.block.cuba
NEURON = {"threshold": 1.25, "current_decay": 0.25, "voltage_decay": 0.03, "requires_grad": False}
INPUT = {"threshold": 0.5, "current_decay": 1, "voltage_decay": 1}
STEPS = 60


def dense(ins, outs, neuron=NEURON, **more):
    """Return a fully connected block. A ``weight_scale`` of 4 makes its neurons spike now and then."""
    return CUBA.Dense(dict(neuron), ins, outs, weight_scale=4, **more)


def images(first):
    """Return first blocks for images, and what follows them: pooling and a readout of 5 classes."""
    return [
        *first,
        CUBA.Pool(dict(NEURON), 2, weight_scale=8),
        CUBA.Flatten(),
        dense(ins=16, outs=5),
    ]


def conv(**more):
    return CUBA.Conv(dict(NEURON), 2, 4, 3, padding=1, weight_scale=4, **more)


NETWORKS = {
    "dense": lambda: [dense(ins=20, outs=16), dense(ins=16, outs=8)],
    "weight-norm": lambda: [
        dense(ins=20, outs=16, weight_norm=True),
        dense(ins=16, outs=8, weight_norm=True),
    ],
    "decay-of-each": lambda: [
        dense(
            ins=20, outs=16, neuron={**NEURON, "current_decay": [0.2, 0.4], "shared_param": False}
        ),
        dense(ins=16, outs=8),
    ],
    "recurrent": lambda: [
        CUBA.Recurrent(dict(NEURON), 20, 16, weight_scale=4),
        dense(ins=16, outs=8),
    ],
    "delay": lambda: [dense(ins=20, outs=16, delay=True), dense(ins=16, outs=8, delay=True)],
    "input": lambda: [CUBA.Input(dict(INPUT)), dense(ins=20, outs=8)],
    "conv": lambda: images([CUBA.Input(dict(INPUT)), conv(stride=2)]),
    "conv-groups-delay": lambda: [
        conv(groups=2, delay=True),
        CUBA.Flatten(),
        dense(ins=256, outs=5),
    ],
    "affine": lambda: [dense(ins=20, outs=16), CUBA.Affine(dict(NEURON), 16, 4)],
}

if __name__ == "__main__":
    for name, make in NETWORKS.items():
        torch.manual_seed(1)
        blocks, shape = make(), (1, 2, 8, 8) if "conv" in name else (1, 20)
        given = torch.tensor(
            np.random.default_rng(3).random((*shape, STEPS)) < 0.2, dtype=torch.float32
        )
        if "delay" in name:
            # Delays get their size in the first pass, so a pass comes before they are drawn, from 0 to 9 steps.
            self_sized = given
            for block in blocks:
                self_sized = block(self_sized)
                if getattr(block, "delay", None) is not None:
                    block.delay.delay.data = 9 * torch.rand_like(block.delay.delay.data)
        found, spikes = {}, given
        with torch.no_grad():
            for number, block in enumerate(blocks):
                spikes = block(spikes)
                found[f"layer{number}"] = np.moveaxis(spikes.numpy()[0], -1, 0)
        with h5py.File(f"{sys.argv[1]}/{name}.net", "w") as file:
            for number, block in enumerate(blocks):
                block.export_hdf5(file.create_group(f"layer/{number}"))
        save_trace(sys.argv[1], name, np.moveaxis(given.numpy()[0], -1, 0), found)
