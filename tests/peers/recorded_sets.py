"""Shipped networks, each with recordings of the set that it was trained for.

The environment variable ``LOCSNN_PEER_RECORDINGS`` says how many recordings of a set are played; by default 20.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.network import Network

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
RECORDINGS = int(os.environ.get("LOCSNN_PEER_RECORDINGS", "20"))
SETS = {
    "objects-hybrid": DATA / "neutouch" / "Ev-Objects.zip",
    "containers-hybrid": DATA / "neutouch" / "Ev-Containers.zip",
    "containers-window-16": DATA / "neutouch" / "Ev-Containers.zip",
    "two-fingertips": ROOT / "examples" / "recordings" / "two-fingertips.npz",
}


def shipped_network(model: str) -> Network:
    """Return a network that ships."""
    return lc.load(ROOT / "examples" / "models" / f"{model}.pt")


def few_recordings(model: str) -> Recordings:
    """Return a few recordings, evenly spread over the set of a network, from its test part if it has one.

    The test is skipped if the set is not next to the repository.
    """
    path = SETS[model]
    if not path.exists():
        pytest.skip(f"{path.name} is not next to the repository")
    part = "test" if path.suffix == ".zip" else None
    recordings = lc.read_recordings(path, split=part, model=shipped_network(model).expected)
    count = min(RECORDINGS, len(recordings))
    rows = np.linspace(0, len(recordings) - 1, count).round().astype(np.int64)
    return recordings.subset(rows)
