"""Changes to recordings before they are learned from: events, channels and taxels dropped, recordings moved in time.

All take and return spikes (batch, steps, channels), float32, 0 or 1, and draw anew for every recording. What is off
draws nothing, so that it does not change what the others draw.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locsnn_compile.data.sensor import POLARITIES
from locsnn_compile.training.config import TrainingConfig

Spikes = NDArray[np.float32]


@dataclass(frozen=True)
class Augmentation:
    """How much of each change at the most: shares 0..1, ``time_shift`` in steps."""

    event_dropout: float = 0.0
    channel_dropout: float = 0.0
    taxel_dropout: float = 0.0
    time_shift: int = 0

    @classmethod
    def of(cls, config: TrainingConfig) -> Augmentation:
        """Return what a training configuration asks for."""
        return cls(config.event_dropout, config.channel_dropout, config.taxel_dropout, config.time_shift)

    def __call__(self, spikes: Spikes, rng: np.random.Generator) -> Spikes:
        """Return changed spikes."""
        spikes = drop_events(spikes, self.event_dropout, rng)
        spikes = drop_channels(spikes, self.channel_dropout, rng)
        spikes = drop_taxels(spikes, self.taxel_dropout, rng)
        return shift_in_time(spikes, self.time_shift, rng)


def drop_events(spikes: Spikes, largest: float, rng: np.random.Generator) -> Spikes:
    """Drop events, of each recording with a probability of 0..``largest``."""
    if largest == 0:
        return spikes
    probability = rng.random(len(spikes), dtype=np.float32) * np.float32(largest)
    kept = rng.random(spikes.shape, dtype=np.float32) >= probability[:, np.newaxis, np.newaxis]
    return spikes * kept


def drop_channels(spikes: Spikes, largest: float, rng: np.random.Generator) -> Spikes:
    """Drop channels with all their events, of each recording with a probability of 0..``largest``."""
    if largest == 0:
        return spikes
    probability = rng.random((len(spikes), 1, 1), dtype=np.float32) * np.float32(largest)
    return spikes * (rng.random((len(spikes), 1, spikes.shape[2]), dtype=np.float32) >= probability)


def drop_taxels(spikes: Spikes, largest: float, rng: np.random.Generator) -> Spikes:
    """Drop taxels, both polarities of each, of each recording with a probability of 0..``largest``."""
    if largest == 0:
        return spikes
    probability = rng.random((len(spikes), 1, 1), dtype=np.float32) * np.float32(largest)
    kept = rng.random((len(spikes), 1, spikes.shape[2] // POLARITIES), dtype=np.float32) >= probability
    return spikes * kept.repeat(POLARITIES, axis=2)


def shift_in_time(spikes: Spikes, largest: int, rng: np.random.Generator) -> Spikes:
    """Move each recording by up to ``largest`` steps to either side; what leaves it is lost, silence follows."""
    if largest == 0:
        return spikes
    steps = spikes.shape[1]
    moved = np.zeros_like(spikes)
    for row, by in enumerate(rng.integers(-largest, largest, size=len(spikes), endpoint=True).clip(-steps, steps)):
        moved[row, max(by, 0) : steps + min(by, 0)] = spikes[row, max(-by, 0) : steps - max(by, 0)]
    return moved
