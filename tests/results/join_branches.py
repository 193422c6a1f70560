"""Join a hybrid and a network of windows, trained apart, into one `hybrid-window` network: `examples/models/objects-best.pt`.

    locsnn train --data Ev-Objects.zip --config examples/configs/objects-hybrid.yaml --validation-fraction 0 -o hybrid.pt
    locsnn train --data Ev-Objects.zip --config examples/configs/objects-window-snn.yaml --validation-fraction 0 -o windows.pt
    python tests/results/join_branches.py hybrid.pt windows.pt -o objects-best.pt

Each network's class scores, times the `count_scale` of its training, are logarithms of probabilities. The joined network adds
them: the potentials of the windows are brought to the units of spikes. With --test the test part of recordings is measured, once.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.networks import build_network
from locsnn_compile.training.measure import confusion


def joined(hybrid: Checkpoint, windows: Checkpoint, name: str) -> Checkpoint:
    """Return the network of all three branches; its `training` says what either was trained with."""
    ours, theirs = hybrid.training, windows.training
    scale = np.float32(float(theirs["count_scale"]) / float(ours["count_scale"]))  # type: ignore[arg-type]
    description = replace(
        hybrid.description, name=name, architecture="hybrid-window", window=windows.description.windows
    )
    names = zip(description.window_names, windows.description.window_names, strict=True)
    weights = hybrid.weights | {own: scale * windows.weights[of_windows] for own, of_windows in names}
    training: dict[str, Any] = {"seed": ours["seed"], "dataset": ours["dataset"]}
    for part, entry in (("hybrid", ours), ("windows", theirs)):
        training |= {f"{part}_{key}": value for key, value in entry.items()}
    return Checkpoint(description, weights, None, training, "")


def write(path: Path, hybrid: Checkpoint, windows: Checkpoint, test: Recordings | None) -> float | None:
    """Write the joined network, and return its accuracy on ``test``, which is measured once, in float64."""
    found = joined(hybrid, windows, path.stem)
    training = dict(found.training)
    if test is not None:
        network = build_network(found.description)
        network.load_weights(found.weights)
        right = confusion(network.double(), test)
        training |= {"test_recordings": int(right.sum()), "test_accuracy": int(np.trace(right)) / int(right.sum())}
    Checkpoint(found.description, found.weights, training=training).save(path)
    return training.get("test_accuracy")


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hybrid", type=Path)
    parser.add_argument("windows", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--test", type=Path, help="recordings whose test part is measured")
    args = parser.parse_args(arguments)
    test = None if args.test is None else read_recordings(args.test, split="test")
    accuracy = write(args.output, read_checkpoint(args.hybrid), read_checkpoint(args.windows), test)
    if test is not None:
        print(f"{args.output}: {accuracy:.4f} of {len(test)} test recordings")


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
