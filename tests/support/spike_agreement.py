"""How well two rasters of spikes agree."""

from __future__ import annotations

import numpy as np


def spike_agreement(first: np.ndarray, second: np.ndarray) -> float:
    """Return the share of spikes that both have: twice the shared ones over all of both; 1 if neither has any."""
    total = first.sum() + second.sum()
    return 2 * (first * second).sum() / total if total else 1.0
