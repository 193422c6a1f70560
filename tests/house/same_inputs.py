"""Write the inputs of the byte comparison: ``python same_inputs.py FOLDER``, with this tree on the path.

Shipped models and recordings are copied; files of other tools are those that the tests of the formats write, with spikes.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import nir
import numpy as np

from tests.support import slayer_files
from tests.support.net_files import NETS, write_net
from tests.support.nir_graphs import graphs

ROOT = Path(__file__).parents[2]
NIR_GRAPHS = ("two layers", "biases", "conv2d", "avg pool", "delay", "recurrent", "nested", "if")
NET_FILES = (
    "a decay each",
    "bias",
    "delay of a neuron",
    "recurrent",
    "conv",
    "input layer with neurons",
)
STEPS = 60
SAMPLES = 4
SPIKE_PROBABILITY = 0.3
"""Of each channel, in each step; chosen by hand."""


def main(folder: Path) -> None:
    """Write all inputs into a folder that is emptied first."""
    shutil.rmtree(folder, ignore_errors=True)
    for name in ("models", "recordings"):
        shutil.copytree(
            ROOT / "examples" / name, folder / name, ignore=shutil.ignore_patterns("*.md")
        )
    for name, (graph, shape) in graphs().items():
        if name in NIR_GRAPHS:
            nir.write(folder / f"{file_name(name)}.nir", graph)
            write_spikes(folder / f"{file_name(name)}-nir.npy", int(np.prod(shape)))
    for name in NET_FILES:
        write_net(folder / f"{file_name(name)}.net", NETS[name])
        # These two networks have an input layer of 72 channels, all others one of 10.
        channels = 72 if name in ("conv", "input layer with neurons") else 10
        write_spikes(folder / f"{file_name(name)}-net.npy", channels)
    # Means of weights, chosen by hand: thresholds of the two kinds of neurons are of other sizes.
    for name, neuron, mean in (("srm", slayer_files.SRM, 1.0), ("loihi", slayer_files.LOIHI, 20.0)):
        (folder / f"slayer-{name}").mkdir()
        rng = np.random.default_rng(4)
        weights = {"fc1": rng.normal(mean, 2.0, (8, 12)), "fc2": rng.normal(mean, 2.0, (4, 8))}
        slayer_files.write(folder / f"slayer-{name}", weights, neuron)
        write_spikes(folder / f"slayer-{name}/spikes.npy", 12)


def file_name(name: str) -> str:
    """Return the name of a network as it stands in names of files and cases."""
    return name.replace(" ", "-")


def write_spikes(path: Path, channels: int) -> None:
    """Write random spikes (samples, channels, steps), the axes of arrays that users give."""
    draws = np.random.default_rng(2).random((SAMPLES, channels, STEPS))
    spikes = draws < SPIKE_PROBABILITY
    np.save(path, spikes.astype(np.uint8))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
