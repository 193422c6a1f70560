"""Files of test cases: arrays with keys ``number/name``, where the number is that of the case.

Networks of Xylo and of SpiNNaker are exchanged in this form with the programs that stand for the chips (witnesses), which
run in other environments.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np


def write(path: Path, cases: Iterable[Mapping[str, np.ndarray]]) -> None:
    """Write the arrays of each case."""
    arrays = {}
    for number, case in enumerate(cases):
        for name, array in case.items():
            arrays[f"{number}/{name}"] = array
    np.savez_compressed(path, **arrays)


def read(path: Path) -> list[dict[str, np.ndarray]]:
    """Return the arrays of each case by name, in the order of their numbers."""
    cases: dict[int, dict[str, np.ndarray]] = {}
    with np.load(path) as arrays:
        for key, array in arrays.items():
            number, name = key.split("/")
            cases.setdefault(int(number), {})[name] = array
    return [cases[number] for number in sorted(cases)]
