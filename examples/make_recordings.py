"""Make the synthetic recordings of this folder: ``python examples/make_recordings.py [FOLDER]``.

The files are byte-identical from run to run. No recording of a real sensor is in them.
"""

from __future__ import annotations

import sys
from pathlib import Path

from locsnn_compile.data import synthetic_touches, write_recordings


def main(folder: Path) -> None:
    """Write ``touches.npz`` (250 steps) and ``touches-long.npz`` (325 steps), one fingertip each, into ``folder``."""
    write_recordings(folder / "touches.npz", synthetic_touches(8, steps=250, classes=4, seed=1))
    write_recordings(folder / "touches-long.npz", synthetic_touches(4, steps=325, classes=2, seed=2))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "recordings")
