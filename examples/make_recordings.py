"""Make the synthetic recordings of this folder: ``python examples/make_recordings.py [FOLDER]``.

The files are byte-identical from run to run. No recording of a real sensor is in them.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from locsnn_compile.data import synthetic_touches, write_recordings


def main(folder: Path) -> None:
    """Write four files into ``folder``, three of one fingertip and one of two.

    ``touches.npz`` (250 steps) and ``touches-long.npz`` (325 steps) have no labels: they are for checking the example
    networks, whose classes are objects. ``motions.npz`` (100 steps) and ``two-fingertips.npz`` (60 steps, 156 channels)
    have the generator's motions as labels: networks can be trained on them.
    """
    for name, samples, steps, seed in (("touches.npz", 8, 250, 1), ("touches-long.npz", 4, 325, 2)):
        touches = synthetic_touches(samples, steps=steps, seed=seed)
        write_recordings(folder / name, replace(touches, labels=None))
    write_recordings(folder / "motions.npz", synthetic_touches(48, steps=100, classes=4, seed=3))
    write_recordings(
        folder / "two-fingertips.npz",
        synthetic_touches(40, steps=60, fingertips=2, classes=4, seed=7),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "recordings")
