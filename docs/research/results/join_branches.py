"""Join a hybrid and windows, trained apart, into one `hybrid-window` network.

    locsnn train --data Ev-Objects.zip --config examples/configs/objects-hybrid.yaml --validation-fraction 0 -o hybrid.pt
    locsnn train --data Ev-Objects.zip --config examples/configs/objects-window-snn.yaml --validation-fraction 0 -o windows.pt
    python docs/research/results/join_branches.py hybrid.pt windows.pt -o joined.pt

Each network's class scores, times the `count_scale` of its training, are logarithms of probabilities. The joined network adds
them: the potentials of the windows are brought to the units of spikes. Several networks of windows are averaged first, which makes
them one network. Where the hybrid was trained on a chip's integers (`locsnn train --target`), so is the joined network: the hybrid's
integers stay, and the windows are rounded. With --test the test part of recordings is measured, once.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.chip_entry import ChipNumbers
from locsnn_compile.models.networks import build_network
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.measure import confusion
from locsnn_compile.training.target import chip_numbers


def joined(hybrid: Checkpoint, windows: Sequence[Checkpoint], name: str) -> Checkpoint:
    """Return the network of all three branches; its `training` has the entries of all, with the name of the branch in front."""
    hybrid_training, first = hybrid.training, windows[0].description
    description = replace(
        hybrid.description, name=name, architecture="hybrid-window", window=first.windows
    )
    weights = dict(hybrid.float_weights)
    for joined_name, windows_name in zip(description.window_names, first.window_names, strict=True):
        scaled_weights = [_scale(part, hybrid) * part.weights[windows_name] for part in windows]
        weights[joined_name] = np.mean(scaled_weights, axis=0)
    training: dict[str, Any] = {
        "seed": hybrid_training["seed"],
        "dataset": hybrid_training["dataset"],
    }
    names = ["windows", *(f"windows_{number}" for number in range(2, len(windows) + 1))]
    for part, network in zip(["hybrid", *names], [hybrid, *windows], strict=True):
        training |= {f"{part}_{key}": value for key, value in network.training.items()}
    joined_network = Checkpoint(description, weights, None, training, "")
    return joined_network if hybrid.chip is None else _on_integers(joined_network, hybrid.chip)


def _on_integers(network: Checkpoint, hybrid: ChipNumbers) -> Checkpoint:
    """Return the joined network on the chip's integers: those of its hybrid stay, and the windows are rounded."""
    config = TrainingConfig(target=hybrid.target, strategy=hybrid.strategy, weight_room=1.0)
    numbers = chip_numbers(config, network.description, network.weights)
    chip = replace(numbers, populations={**numbers.populations, **hybrid.populations})
    built = build_network(network.description, chip=chip)
    built.load_weights(network.weights)
    return replace(network, weights=built.mantissas(), chip=chip)


def _scale(windows: Checkpoint, hybrid: Checkpoint) -> np.float32:
    """Return how many spikes of the hybrid a potential of 1 of the windows is worth.

    Both times their `count_scale` are logarithms of probabilities, so the ratio of these scales brings one to the other.
    """
    theirs, ours = (float(network.training["count_scale"]) for network in (windows, hybrid))  # type: ignore[arg-type]
    return np.float32(theirs / ours)


def write(
    path: Path, hybrid: Checkpoint, windows: Sequence[Checkpoint], test: Recordings | None
) -> float | None:
    """Write the joined network, and return its accuracy on ``test``, which is measured once, in float64."""
    joined_network = joined(hybrid, windows, path.stem)
    training = dict(joined_network.training)
    if test is not None:
        network = build_network(joined_network.description, chip=joined_network.chip)
        network.load_weights(joined_network.float_weights)
        confusion_matrix = confusion(network.double(), test)
        training |= {
            "test_recordings": int(confusion_matrix.sum()),
            "test_accuracy": int(np.trace(confusion_matrix)) / int(confusion_matrix.sum()),
        }
    replace(joined_network, training=training).save(path)
    return training.get("test_accuracy")


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("hybrid", type=Path)
    parser.add_argument("windows", type=Path, nargs="+")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--test", type=Path, help="recordings whose test part is measured")
    args = parser.parse_args(arguments)
    test = None if args.test is None else read_recordings(args.test, split="test")
    windows = [read_checkpoint(path) for path in args.windows]
    accuracy = write(args.output, read_checkpoint(args.hybrid), windows, test)
    if test is not None:
        print(f"{args.output}: {accuracy:.4f} of {len(test)} test recordings")


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
