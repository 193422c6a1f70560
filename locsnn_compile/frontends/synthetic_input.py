"""What a network from elsewhere is checked on, where no events are given: files of other tools carry none."""

import numpy as np

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS
from locsnn_compile.data.synthetic import synthetic_touches

SAMPLES = 8
RATE = 0.05
"""Share of channels that spike in a step."""
_MOST = 10_000_000
_FEWEST_STEPS = 30
"""A touch that is shorter has no phases to tell apart."""


def touch_fingertips(channels: int) -> int | None:
    """Return how many fingertips have so many channels, one or two; None for other inputs."""
    return {TAXELS * POLARITIES: 1, 2 * TAXELS * POLARITIES: 2}.get(channels)


def synthetic_recordings(channels: int, steps: int, step_seconds: float | None) -> Recordings:
    """Return synthetic touches for a fingertip's channels, else random spikes; no labels; equal every time."""
    fingertips = touch_fingertips(channels)
    if fingertips is not None and steps >= _FEWEST_STEPS:
        touches = synthetic_touches(SAMPLES, steps=steps, fingertips=fingertips, seed=0)
        return Recordings(touches.spikes, None, step_seconds, touches.source, touches.origin)
    samples = int(np.clip(_MOST // (channels * steps), 1, SAMPLES))
    spikes = np.random.default_rng(0).random((samples, steps, channels), dtype=np.float32) < RATE
    source = f"synthetic spikes, {RATE:.0%} a step"
    return Recordings(spikes.astype(np.uint8), None, step_seconds, source, "made up")
