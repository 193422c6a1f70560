"""Classes by their nearest prototype, the mean of their recordings: the ways with ``smooth`` of ``tried_settings.yaml``.

A recording is the vector of its windows' spikes, the input that the output of `window-snn` has. Distances are plain, or whitened:
directions in which recordings of one class differ a lot count little. These differences are taken from this data set, or from both
(Objects and Containers share the sensor, not the classes).
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from ways import Division, Floats, Nearest, Rows, Scorer, log_probabilities

from hw_model.values import ByteArray
from locsnn_compile.data.read import read_recordings

STEPS, STRIDE = 6, 3
"""Windows of 6 steps, one every 3, as in the configurations of `window-snn`."""
LAST = 250
"""Steps at the end of a recording that are used: as many as both sets have, so that their vectors are equally long."""


def nearest_prototype(way: Nearest, division: Division, rows: Rows) -> Scorer:
    """Return a scorer: minus half the squared distance to each prototype, normalised to log-probabilities."""
    given = division.recordings.spikes[rows]
    copies = [windows(moved(given, by)) for by in sorted({-way.moved, 0, way.moved})]
    means, apart = prototypes(np.concatenate(copies), np.tile(division.labels[rows], len(copies)))
    if way.both_sets:
        apart = np.concatenate([apart, differences_of_the_other(division)])
    turned, offset = metric(means, apart, way.smooth)
    return lambda spikes: log_probabilities(windows(spikes) @ turned.T - offset)


def windows(spikes: ByteArray) -> Floats:
    """Return which channel had an event in which window of the last steps, (samples, windows * channels)."""
    events = np.cumsum(np.pad(spikes[:, -LAST:].astype(np.int32), ((0, 0), (1, 0), (0, 0))), axis=1)
    starts = np.arange(0, events.shape[1] - STEPS, STRIDE)
    return (
        (events[:, starts + STEPS] > events[:, starts]).reshape(len(spikes), -1).astype(np.float64)
    )


def moved(spikes: ByteArray, by: int) -> ByteArray:
    """Return recordings that happen ``by`` steps later, or earlier if it is negative; events that leave them are lost."""
    moved_spikes, steps = np.zeros_like(spikes), spikes.shape[1]
    moved_spikes[:, max(by, 0) : steps + min(by, 0)] = spikes[:, max(-by, 0) : steps - max(by, 0)]
    return moved_spikes


def prototypes(x: Floats, labels: Rows) -> tuple[Floats, Floats]:
    """Return the mean of each class, and the difference of every recording from the mean of its class."""
    means = np.stack([x[labels == label].mean(axis=0) for label in np.unique(labels)])
    return means, x - means[labels]


def metric(means: Floats, apart: Floats, smooth: float | None) -> tuple[Floats, Floats]:
    """Return M @ means and half of means @ M @ means, so that x @ first.T - second is largest for the nearest mean.

    M is (smooth * v I + apart^T apart / n)^-1, v being the mean of the n eigenvalues of apart^T apart / n that are not 0; without
    ``smooth`` it is I. M is large (a row per input), so it is never formed: by the Woodbury identity, only a matrix of recordings by
    recordings is inverted. The factor 1 / (smooth * v), which all distances share, is left out.
    """
    turned = means
    if smooth is not None:
        scale = smooth * (apart**2).sum() / len(apart) / len(apart)
        inner = np.linalg.inv(scale * len(apart) * np.eye(len(apart)) + apart @ apart.T)
        turned = means - (means @ apart.T) @ inner @ apart
    return turned, 0.5 * (means * turned).sum(axis=1)


def differences_of_the_other(division: Division) -> Floats:
    """Return the differences of the other set's training recordings from the prototypes of their classes."""
    other = {"objects": "Containers", "containers": "Objects"}[division.dataset]
    return _differences(division.data / f"Ev-{other}.zip")


@cache
def _differences(path: Path) -> Floats:
    recordings = read_recordings(path, split="train")
    assert recordings.labels is not None
    return prototypes(windows(recordings.spikes), recordings.labels)[1]
