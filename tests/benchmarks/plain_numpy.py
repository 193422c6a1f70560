"""What a careful user writes without a simulator: one matrix product per layer, and a Python loop over steps.

It is timed next to the simulators, and its spikes are those that all of them must give.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from workloads import LayeredNetwork

LAST = 2**23 - 1
"""The largest voltage of the chip; voltages are clipped there."""


def play(network: LayeredNetwork, spikes: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return the spikes of every layer on one recording (steps, lines), in the integers of the chip.

    The charge of a step is the weights of the spikes a step before, times 64, the unit of a weight in the registers.
    """
    spikes_of_layers = []
    for weights, threshold in zip(network.weights, network.thresholds, strict=True):
        charge = (spikes.astype(np.float64) @ weights.T).astype(np.int64) << 6
        u = v = np.zeros(len(weights), dtype=np.int64)
        fired = np.zeros(charge.shape, dtype=np.uint8)
        for t in range(1, len(charge)):
            u = _decayed(u, network.decay_u) + charge[t - 1]
            v = np.clip(_decayed(v, network.decay_v) + u, -LAST, LAST)
            fired[t] = v > 64 * threshold
            v = np.where(fired[t], 0, v)
        spikes_of_layers.append(fired)
        spikes = fired
    return spikes_of_layers


def _decayed(x: NDArray[np.int64], decay: int) -> NDArray[np.int64]:
    """Return what a decay (in 4096ths) leaves of a register, rounded towards zero as on the chip."""
    return np.sign(x) * ((np.abs(x) * (4096 - decay)) >> 12)
