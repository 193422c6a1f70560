"""Record what the machine code of sPyNNaker does with random networks: the witness of ``test_machine_code.py``.

Run ``python -m tests.spinnaker.record_machine PYTHON``, where PYTHON is an interpreter that has sPyNNaker and the
emulator unicorn. The result is a file next to this one, so that the test needs neither.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from tests.support.machine_files import RECORDED, write_cases
from tests.support.numbered_arrays import read
from tests.support.random_spinnaker import Case, random_case

DRIVER = Path(__file__).parents[1] / "peers" / "drive_spinnaker.py"
SEEDS = (3, 6, 12, 20, 25, 31, 50, 60, 70, 115, 117, 142)
"""Seeds of networks in which together everything happens that the arithmetic distinguishes, and faults show."""
TIMEOUT_SECONDS = 1800


def ask_machine(
    python: Path | str, cases: Iterable[Case], folder: Path
) -> list[dict[str, np.ndarray]]:
    """Return constants, registers and spikes of networks, as the machine code gives them: a mapping per network."""
    write_cases(folder / "networks.npz", cases)
    call = [str(python), str(DRIVER), str(folder / "networks.npz"), str(folder / "result.npz")]
    subprocess.run(call, check=True, timeout=TIMEOUT_SECONDS)
    return read(folder / "result.npz")


def record(python: str, cases: Sequence[Case], path: Path) -> None:
    """Write networks, their input, and what the machine code did, into one file."""
    arrays = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        results = ask_machine(python, cases, folder)
        networks = read(folder / "networks.npz")
    for number, (case, result) in enumerate(zip(networks, results, strict=True)):
        arrays |= {f"{number}/{key}": value for key, value in {**case, **result}.items()}
    np.savez_compressed(path, **arrays)


if __name__ == "__main__":
    record(sys.argv[1], [random_case(seed) for seed in SEEDS], RECORDED)
