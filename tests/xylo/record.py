"""Write what xylosim says of random and of compiled networks: ``python -m tests.xylo.record PYTHON``.

PYTHON is one that has xylosim.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

import locsnn_compile as lc
from hw_model.xylo.network import XyloNetwork
from hw_model.xylo.playing import rows_of
from tests.support.random_xylo import random_xylo
from tests.support.small_xylo_networks import NETWORKS, touches
from tests.support.witness_files import RECORDED, RECORDED_COMPILED, read, write_networks

DRIVER = Path(__file__).parents[1] / "peers" / "drive_xylosim.py"
SEEDS = (2, 3, 5, 6, 8, 10, 16, 18, 20, 23, 33, 39)
"""Small networks, in two of which charges wrap."""


Case = tuple[XyloNetwork, np.ndarray]


def ask_witness(
    python: Path | str, cases: Iterable[Case], folder: Path
) -> list[dict[str, np.ndarray]]:
    """Return what xylosim does with networks and rows of events, a mapping of registers for each."""
    write_networks(folder / "networks.npz", cases)
    call = [str(python), str(DRIVER), str(folder / "networks.npz"), str(folder / "result.npz")]
    subprocess.run(call, check=True, timeout=1800)
    return read(folder / "result.npz")


def compiled_cases() -> list[Case]:
    """The small networks as compiled, each with the rows of one recording."""
    recordings = touches()
    cases = []
    for make in NETWORKS.values():
        compiled = lc.compile(make(), target="xylo-audio3", events=recordings)
        cases.append((compiled.program.network, rows_of(recordings[0])))
    return cases


def record(python: str, cases: Sequence[Case], path: Path) -> None:
    """Write networks, events, and what the witness did."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        arrays = {}
        for number, result in enumerate(ask_witness(python, cases, folder)):
            arrays |= {f"{number}/{key}": value for key, value in result.items()}
        with np.load(folder / "networks.npz") as networks:
            arrays |= dict(networks.items())
    np.savez_compressed(path, **arrays)


if __name__ == "__main__":
    record(sys.argv[1], [random_xylo(seed) for seed in SEEDS], RECORDED)
    record(sys.argv[1], compiled_cases(), RECORDED_COMPILED)
