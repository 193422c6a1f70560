"""Changes to recordings before they are learned from: events, channels and taxels dropped, recordings moved in time.

All take and return spikes (batch, steps, channels), float32, 0 or 1, and draw anew for every recording. What is off
draws nothing, so that it does not change what the others draw.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from locsnn_compile.data.sensor import POLARITIES
from locsnn_compile.training.config import TrainingConfig

Spikes = NDArray[np.float32]


def augmented(spikes: Spikes, config: TrainingConfig, rng: np.random.Generator) -> Spikes:
    """Return changed spikes, as a training configuration asks for."""
    spikes = drop_events(spikes, config.event_dropout, rng)
    spikes = drop_channels(spikes, config.channel_dropout, rng)
    spikes = drop_taxels(spikes, config.taxel_dropout, rng)
    return shift_in_time(spikes, config.time_shift, rng)


def drop_events(spikes: Spikes, largest: float, rng: np.random.Generator) -> Spikes:
    """Drop events, of each recording with a probability of 0..``largest``."""
    return spikes if largest == 0 else spikes * _kept(spikes.shape, largest, rng)


def drop_channels(spikes: Spikes, largest: float, rng: np.random.Generator) -> Spikes:
    """Drop channels with all their events, of each recording with a probability of 0..``largest``."""
    return spikes if largest == 0 else spikes * _kept((len(spikes), 1, spikes.shape[2]), largest, rng)


def drop_taxels(spikes: Spikes, largest: float, rng: np.random.Generator) -> Spikes:
    """Drop taxels, both polarities of each, of each recording with a probability of 0..``largest``."""
    shape = len(spikes), 1, spikes.shape[2] // POLARITIES
    return spikes if largest == 0 else spikes * _kept(shape, largest, rng).repeat(POLARITIES, axis=2)


def _kept(shape: tuple[int, ...], largest: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw what stays of (batch, steps, channels), each recording with a probability to lose of 0..``largest``."""
    probability = rng.random((shape[0], 1, 1), dtype=np.float32) * np.float32(largest)
    kept: NDArray[np.bool_] = rng.random(shape, dtype=np.float32) >= probability
    return kept


def shift_in_time(spikes: Spikes, largest: int, rng: np.random.Generator) -> Spikes:
    """Move each recording by up to ``largest`` steps to either side; what leaves it is lost, silence follows."""
    if largest == 0:
        return spikes
    steps = spikes.shape[1]
    moved = np.zeros_like(spikes)
    for row, by in enumerate(rng.integers(-largest, largest, size=len(spikes), endpoint=True).clip(-steps, steps)):
        moved[row, max(by, 0) : steps + min(by, 0)] = spikes[row, max(-by, 0) : steps - max(by, 0)]
    return moved
