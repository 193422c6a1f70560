"""Loops that other processes compile, while this one compiles others: numba compiles one function at a time."""

import atexit
import os
import subprocess
import sys
from pathlib import Path

from hw_model.engine.threads import cores


class _Helper:
    """A module that compiles loops, those of ``modules``, when it is run as a process."""

    def __init__(self, name: str, modules: tuple[str, ...]) -> None:
        self._name = name
        self.modules = modules
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start the process, once."""
        if self.process is None:
            self.process = _started(self._name)


_helpers: dict[str, _Helper] = {}
"""By name: they are started as soon as something is found not compiled."""


def compile_ahead(name: str, modules: tuple[str, ...]) -> None:
    """Let module ``name``, run as a process, compile the loops of ``modules`` as soon as others are compiled here.

    Who needs these loops then waits for its end. With one core nothing happens.
    """
    if name not in _helpers and cores() > 1 and sys.executable:
        _helpers[name] = _Helper(name, modules)


def start_ahead() -> None:
    """Start what compiles ahead: something is not compiled, or soon will be missed."""
    for helper in _helpers.values():
        helper.start()


def compiled_ahead(module: str) -> bool:
    """Start all that compiles ahead; wait for what compiles the loops of a module, and tell whether it did."""
    start_ahead()
    for helper in _helpers.values():
        if module in helper.modules and helper.process is not None:
            return helper.process.wait() == 0
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
