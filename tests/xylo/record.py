"""Record what xylosim, the vendor's simulator, does with random and with compiled networks: the witness of the tests.

Run ``python -m tests.xylo.record PYTHON``, where PYTHON is an interpreter that has xylosim. The results are files next to
this one, so that the tests need no xylosim.
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
from tests.support.numbered_arrays import read
from tests.support.random_xylo import random_xylo
from tests.support.small_xylo_networks import NETWORKS, touches
from tests.support.witness_files import RECORDED, RECORDED_COMPILED, write_networks

DRIVER = Path(__file__).parents[1] / "peers" / "drive_xylosim.py"
SEEDS = (2, 3, 5, 6, 8, 10, 16, 18, 20, 23, 33, 39)
"""Seeds of small random networks, in two of which charges wrap."""
TIMEOUT_SECONDS = 1800

Case = tuple[XyloNetwork, np.ndarray]
"""A network, and the rows of input events that are played to it."""


def ask_witness(
    python: Path | str, cases: Iterable[Case], folder: Path
) -> list[dict[str, np.ndarray]]:
    """Return what xylosim does with networks and rows of events: a mapping of registers per network."""
    write_networks(folder / "networks.npz", cases)
    call = [str(python), str(DRIVER), str(folder / "networks.npz"), str(folder / "result.npz")]
    subprocess.run(call, check=True, timeout=TIMEOUT_SECONDS)
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
    """Write networks, events, and what xylosim did, into one file."""
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
