"""Loops that another process compiles, while this one compiles others: numba compiles one function at a time."""

import atexit
import os
import subprocess
import sys
from pathlib import Path

from hw_model.engine.threads import cores

_processes: dict[str, subprocess.Popen[bytes] | None] = {}
"""By module: the process that compiles the loops of its package, None until something is found not compiled."""


def compile_ahead(module: str) -> None:
    """Let ``module``, run as a process, compile the loops of its package as soon as others are compiled here.

    Loops of that package then wait for its end. With one core nothing happens.
    """
    if module not in _processes and cores() > 1 and sys.executable:
        _processes[module] = None


def compiled_ahead(package: str) -> bool:
    """Wait for the process that compiles the loops of a package, if there is one; else start those of others."""
    for module, process in _processes.items():
        if module.startswith(package + ".") and process is not None:
            return process.wait() == 0
    for module, process in _processes.items():
        if process is None:
            _processes[module] = _started(module)
    return False


def _started(module: str) -> subprocess.Popen[bytes]:
    root = str(Path(__file__).parents[2])
    found = os.pathsep.join((root, os.environ.get("PYTHONPATH", ""))).rstrip(os.pathsep)
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", module], env=os.environ | {"PYTHONPATH": found},
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    atexit.register(_end, process)
    return process


def _end(process: subprocess.Popen[bytes]) -> None:
    """Let no process outlive this one: what it has not kept yet is compiled another time."""
    process.kill()
    process.wait()
