"""A small hybrid network with random weights, saved as a checkpoint together with recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import LOCATION_ORDERS, neutouch
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.models.networks import build_network

STEPS = 9
CHANNELS = 78
"""39 taxels (touch-sensitive points) of one fingertip of the NeuTouch sensor, with two polarities each."""

DESCRIPTION = NetworkDescription(
    "hybrid",
    InputLayout(neutouch(1), steps=STEPS, step_seconds=0.02),
    classes=3,
    hidden=4,
    location_order="arch",
    location_taxels=LOCATION_ORDERS["arch"],
    name="small",
)
AGAIN = "Write it again with 'locsnn train'."
"""The way out in error messages about checkpoints."""


def recordings(samples: int = 2) -> Recordings:
    """Return random recordings, each of a class of its own."""
    shape = (samples, STEPS, CHANNELS)
    spikes = np.random.default_rng(0).integers(0, 2, size=shape, dtype=np.uint8)
    return Recordings(spikes, np.arange(samples), step_seconds=0.02, source="made up")


def save(path: Path) -> Path:
    """Save the network with its recordings, and return the path."""
    weights = build_network(DESCRIPTION, seed=1).weights()
    Checkpoint(
        DESCRIPTION, weights, recordings=recordings(), training={"seed": 1, "dataset": "none"}
    ).save(path)
    return path
