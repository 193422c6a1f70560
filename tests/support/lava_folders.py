"""Folders that ``--emit lava`` writes, run with a package that stands in for Lava, since Lava is not installed.

The script in such a folder imports ``lava``; here its imports lead to ``tests/support/lava_stand_in.py``.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from locsnn_compile.emitters import bench_files
from tests.support.emitter_faults import Arrays
from tests.support.lava_programs import Case, edge_cases, random_case

ROOT = Path(__file__).parents[2]
MODULES = {
    "magma/core/run_conditions": ("RunSteps",),
    "magma/core/run_configs": ("Loihi2SimCfg",),
    "proc/dense/process": ("Dense", "DelayDense"),
    "proc/io/sink": ("Sink as RingBuffer",),
    "proc/io/source": ("Source as RingBuffer",),
    "proc/lif/process": ("LIF",),
    "utils/weightutils": ("SignMode",),
}
"""Names that the script imports, by the module of ``lava`` that has them."""


def write_folder(folder: Path, case: Case) -> Path:
    """Write the files that ``--emit lava`` writes for a case, and return the folder."""
    program, spikes = case
    folder.mkdir(parents=True)
    for name, content in bench_files(program, ["lava"], spikes).items():
        (folder / Path(name).name).write_bytes(content)
    return folder


def write_stand_in(folder: Path) -> Path:
    """Write a package ``lava`` and return the folder to import it from."""
    for module, names in MODULES.items():
        path = folder / "lava" / f"{module}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"from tests.support.lava_stand_in import {', '.join(names)}\n")
    return folder


def run_script(folder: Path, packages: Path) -> subprocess.CompletedProcess[str]:
    """Run the script of a folder with the stand-in."""
    return subprocess.run(
        [sys.executable, str(folder / "network.py")],
        env={"PYTHONPATH": f"{packages}:{ROOT}"},
        capture_output=True,
        text=True,
        check=False,
    )


def arrays_of(path: Path) -> Arrays:
    """Return all arrays of a file."""
    with np.load(path) as arrays:
        return dict(arrays)


def cases(seeds: Iterable[int]) -> dict[str, Case]:
    """Return the programs of the edge cases, and a random one per seed, by name."""
    edges = {f"edge-{number}": case for number, case in enumerate(edge_cases().values())}
    random_programs = {f"random-{seed}": random_case(seed) for seed in seeds}
    return edges | random_programs


def differences(played: Arrays, expected: Arrays) -> int:
    """Return how many spikes and registers differ."""
    assert played.keys() == expected.keys()
    return sum(int((played[key] != expected[key]).sum()) for key in expected)


def stand_in_script(folder: Path) -> Any:
    """Return the emitted script as a module that imports the stand-in for Lava."""
    path = write_folder(folder / "script", random_case(0)) / "network.py"
    spec = importlib.util.spec_from_file_location("network", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    packages = str(write_stand_in(folder / "packages"))
    sys.path.insert(0, packages)
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(packages)
    return module


def play_file(script: Any, path: Path) -> Arrays:
    """Run the network of a file by the script, and return its spikes and registers by the keys of ``expected.npz``."""
    return {
        f"run{number}/neurons{group}/{name}": values
        for number, run in enumerate(script.numbered(script.load(path), "run"))
        for group, results in enumerate(script.play(run))
        for name, values in results.items()
    }
