"""What a careful user writes without a simulator: a matrix product a layer, and a Python loop over steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from workloads import LayeredNetwork

LAST = 2**23 - 1


def play(network: LayeredNetwork, spikes: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return the spikes of every layer on one recording (steps, lines), after the chip's own integers."""
    found = []
    for weights, threshold in zip(network.weights, network.thresholds, strict=True):
        charge = (spikes.astype(np.float64) @ weights.T).astype(np.int64) << 6
        u = v = np.zeros(len(weights), dtype=np.int64)
        fired = np.zeros(charge.shape, dtype=np.uint8)
        for t in range(1, len(charge)):
            u = _decayed(u, network.decay_u) + charge[t - 1]
            v = np.clip(_decayed(v, network.decay_v) + u, -LAST, LAST)
            fired[t] = v > 64 * threshold
            v = np.where(fired[t], 0, v)
        found.append(fired)
        spikes = fired
    return found


def _decayed(x: NDArray[np.int64], decay: int) -> NDArray[np.int64]:
    return np.sign(x) * ((np.abs(x) * (4096 - decay)) >> 12)
