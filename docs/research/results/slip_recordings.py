"""Write the synthetic slip recordings of the results, ``slip.npz`` to learn from and ``slip-test.npz``, here.

python docs/research/results/slip_recordings.py
"""

from __future__ import annotations

from pathlib import Path

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.data.write import write_recordings

PARTS = {"slip.npz": (80, 11), "slip-test.npz": (20, 12)}
"""File -> how many recordings, and the seed. The published set has 100 recordings of two classes and 150 steps."""


def slip_recordings() -> tuple[Recordings, Recordings]:
    """Return the train and the test part."""
    train, test = (
        synthetic_touches(count, steps=150, classes=2, seed=seed, step_seconds=0.001)
        for count, seed in PARTS.values()
    )
    return train, test


if __name__ == "__main__":
    for name, recordings in zip(PARTS, slip_recordings(), strict=True):
        write_recordings(Path(name), recordings)
