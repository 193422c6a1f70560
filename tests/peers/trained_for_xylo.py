"""Networks that were trained on the integers of a Xylo, each on recordings of a set whose channels are merged to 16 inputs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded_sets import DATA

import locsnn_compile as lc

INPUTS = 16
CHIP = "xylo-audio3"
EPOCHS = 3
LEARNED_FROM = 500
"""About so many recordings of an archive: enough for networks that spike, in a minute of training."""
OPTIONS = {
    "target": CHIP,
    "channels": INPUTS,
    "hidden": 32,
    "epochs": EPOCHS,
    "dash_mem": "3 5",
}
SETS = ("spoken digits", "grasps", "letters in Braille")


def compiled_for(name: str, count: int) -> tuple[lc.CompiledXylo, np.ndarray]:
    """Return a network trained for a set and compiled, and ``count`` recordings of its test part.

    The test is skipped if the set is not next to the repository.
    """
    train, labels, test, test_labels = _divided(name)
    checkpoint = lc.train(train, {**OPTIONS, "seed": 0}, labels=labels)
    rows = np.linspace(0, len(test) - 1, min(count, len(test))).round().astype(np.int64)
    few = test[rows]
    compiled = lc.compile(lc.load(checkpoint), CHIP, events=few, labels=test_labels[rows])
    return compiled, few


def _divided(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return recordings (samples, steps, 16) and labels to learn from, and recordings and labels to play."""
    if name == "grasps":
        # One finger of the hand: its 24 channels, of which neighbours are merged.
        grasps = _read(DATA / "icub_grasp" / "grasps.npz", None)
        spikes = _merged(grasps.spikes[:, :, :24], INPUTS)
        is_test = np.arange(len(spikes)) % 4 == 0
        labels = grasps.labels
        return spikes[~is_test], labels[~is_test], spikes[is_test], labels[is_test]
    archive = {
        "spoken digits": DATA / "fsdd" / "fsdd.zip",
        "letters in Braille": DATA / "braille" / "braille.zip",
    }[name]
    train = _read(archive, "train")
    test = _read(archive, "test")
    # Some recordings are enough for what is compared here.
    every = len(train) // LEARNED_FROM
    return (
        _merged(train.spikes[::every], INPUTS),
        train.labels[::every],
        _merged(test.spikes, INPUTS),
        test.labels,
    )


def _read(path: Path, part: str | None) -> lc.Recordings:
    if not path.exists():
        pytest.skip(f"{path.name} is not next to the repository")
    return lc.read_recordings(path, split=part)


def _merged(spikes: np.ndarray, inputs: int) -> np.ndarray:
    """Return recordings in which neighbouring channels are one input, with a spike wherever any of them has one."""
    starts = np.linspace(0, spikes.shape[2], inputs, endpoint=False).astype(np.int64)
    return np.maximum.reduceat(spikes, starts, axis=2)
