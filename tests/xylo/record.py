"""Write what xylosim says of twelve random networks: ``python tests/xylo/record.py PYTHON``, one that has xylosim."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from random_xylo import random_xylo
from witness_files import RECORDED, read, write_networks

DRIVER = Path(__file__).parents[1] / "peers" / "drive_xylosim.py"
SEEDS = (2, 3, 5, 6, 8, 10, 16, 18, 20, 23, 33, 39)
"""Small networks, in two of which charges wrap."""


def ask_witness(
    python: Path | str, seeds: Sequence[int], folder: Path
) -> list[dict[str, np.ndarray]]:
    """Return what xylosim does with random networks, a mapping of registers for each."""
    write_networks(folder / "networks.npz", map(random_xylo, seeds))
    call = [str(python), str(DRIVER), str(folder / "networks.npz"), str(folder / "result.npz")]
    subprocess.run(call, check=True, timeout=1800)
    return read(folder / "result.npz")


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        arrays = {}
        for number, result in enumerate(ask_witness(sys.argv[1], SEEDS, folder)):
            arrays |= {f"{number}/{key}": value for key, value in result.items()}
        with np.load(folder / "networks.npz") as networks:
            arrays |= dict(networks.items())
    np.savez_compressed(RECORDED, **arrays)


if __name__ == "__main__":
    main()
