"""Loops that other processes compile, while this one compiles others: numba compiles one function at a time."""

import atexit
import os
import subprocess
import sys
from pathlib import Path

from hw_model.engine.threads import cores


class _Helper:
    """A module that, run as a process, compiles the loops of ``modules``."""

    def __init__(self, name: str, modules: tuple[str, ...]) -> None:
        self._name = name
        self.modules = modules
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start the process, once."""
        if self.process is None:
            self.process = _started(self._name)


TILE_FILES = "__pycache__/tiles.run_tile-*.nbi"
"""Files in which numba keeps the compiled tile, which takes longest."""
_helpers: dict[str, _Helper] = {}
"""By the name of their module: they are started as soon as a loop turns out not to be compiled."""


def compile_ahead(name: str, modules: tuple[str, ...]) -> None:
    """Let module ``name``, run as a process, compile the loops of ``modules``.

    It is started as soon as this process compiles others, and who needs these loops then waits for its end
    (:func:`compiled_ahead`). With one core nothing happens.
    """
    if name not in _helpers and cores() > 1 and sys.executable:
        _helpers[name] = _Helper(name, modules)


def start_ahead() -> None:
    """Start all helpers, because a loop that is needed, or soon will be, is not compiled."""
    for helper in _helpers.values():
        helper.start()


def start_ahead_where_nothing_is_compiled() -> None:
    """Start all helpers where no tile was ever compiled next to this copy of the package.

    numba, which knows better, takes a third of a second to import. Where it keeps code elsewhere, because nothing can
    be written here, nothing is started yet.
    """
    folder = Path(__file__).parent
    is_kept_here = "NUMBA_CACHE_DIR" not in os.environ and os.access(folder, os.W_OK)
    if is_kept_here and not any(folder.glob(TILE_FILES)):
        start_ahead()


def compiled_ahead(module: str) -> bool:
    """Start all helpers, and wait for the one that compiles the loops of a module; tell whether it succeeded."""
    start_ahead()
    for helper in _helpers.values():
        if module in helper.modules and helper.process is not None:
            return helper.process.wait() == 0
    return False


def _started(module: str) -> subprocess.Popen[bytes]:
    """Start a module as a process that imports this very copy of the package."""
    root = str(Path(__file__).parents[2])
    python_path = os.pathsep.join((root, os.environ.get("PYTHONPATH", ""))).rstrip(os.pathsep)
    process = subprocess.Popen(
        # -P: no module is imported from the folder that the user happens to be in.
        [sys.executable, "-P", "-m", module],
        env=os.environ | {"PYTHONPATH": python_path},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    atexit.register(_end, process)
    return process


def _end(process: subprocess.Popen[bytes]) -> None:
    """Let no process outlive this one: loops that it has not cached yet are compiled another time."""
    process.kill()
    process.wait()
