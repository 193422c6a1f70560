"""What a training epoch is fed: the split, the order of recordings, and how they are changed.

Every draw comes from a generator of (seed, purpose, epoch), so an epoch needs no state but its number.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from locsnn_compile.training.augment import augmented
from locsnn_compile.training.config import TrainingConfig


def epoch_generator(seed: int, *purpose: int) -> np.random.Generator:
    """Return the generator of one purpose of a run: equal numbers give equal draws, on every machine."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *purpose])))


def stratified_split(
    labels: NDArray[np.int64], fraction: float, seed: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (training, validation) indices, sorted; each class gives ``fraction`` of its recordings,
    rounded.

    A class gives at least one recording where it has two or more and ``fraction`` is above 0.
    """
    rng = epoch_generator(seed, 0)
    validation: list[NDArray[np.int64]] = [np.zeros(0, dtype=np.int64)]
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        wanted = round(fraction * len(members))
        if fraction > 0 and len(members) >= 2:
            wanted = min(max(wanted, 1), len(members) - 1)
        validation.append(np.sort(rng.permutation(members)[:wanted]))
    held = np.sort(np.concatenate(validation))
    return np.setdiff1d(np.arange(len(labels)), held), held


def batches(
    spikes: NDArray[np.uint8],
    labels: NDArray[np.int64],
    config: TrainingConfig,
    rng: np.random.Generator,
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.int64]]]:
    """Yield (spikes (batch, steps, channels), labels (batch,)) of one epoch, every recording once."""
    order = rng.permutation(len(labels))
    for start in range(0, len(order), config.batch_size):
        rows = order[start : start + config.batch_size]
        yield augmented(spikes[rows].astype(np.float32), config, rng), labels[rows]
