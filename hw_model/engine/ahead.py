"""Compile loops in helper processes while this process compiles others.

numba compiles one function at a time. Modules register helpers (:func:`compile_ahead`): modules that,
run as processes, compile some loops and leave them in numba's cache. The helpers start as soon as a
loop turns out not to be compiled, and whoever needs one of their loops waits for them.
"""

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
            self.process = _start_process(self._name)


TILE_FILES = "__pycache__/tiles.run_tile-*.nbi"
"""Index files of numba's cache for :func:`hw_model.engine.tiles.run_tile`, the loop that takes longest to compile."""
_helpers: dict[str, _Helper] = {}
"""The registered helpers, by the names of their modules."""


def compile_ahead(name: str, modules: tuple[str, ...]) -> None:
    """Register module ``name`` as a helper that compiles the loops of ``modules`` when it runs as a process.

    The process starts as soon as this one compiles a loop; whoever then needs the helper's loops waits for its end
    (:func:`compiled_ahead`). With a single core nothing is registered, as it would only slow this process down.
    """
    if name not in _helpers and cores() > 1 and sys.executable:
        _helpers[name] = _Helper(name, modules)


def start_ahead() -> None:
    """Start all helpers. Called when a loop that is needed, or soon will be, is not compiled."""
    for helper in _helpers.values():
        helper.start()


def start_ahead_where_nothing_is_compiled() -> None:
    """Start all helpers if no tile was ever compiled next to this copy of the package.

    This only looks for files: asking numba would be exact, but importing it takes a third of a second. If numba's
    cache lies elsewhere, because this folder cannot be written, nothing is started yet.
    """
    folder = Path(__file__).parent
    is_kept_here = "NUMBA_CACHE_DIR" not in os.environ and os.access(folder, os.W_OK)
    if is_kept_here and not any(folder.glob(TILE_FILES)):
        start_ahead()


def compiled_ahead(module: str) -> bool:
    """Start all helpers, wait for the one that compiles the loops of a module, and return whether it succeeded."""
    start_ahead()
    for helper in _helpers.values():
        if module in helper.modules and helper.process is not None:
            return helper.process.wait() == 0
    return False


def _start_process(module: str) -> subprocess.Popen[bytes]:
    """Start a module as a process that imports this copy of the package, and no other that may be installed."""
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
    """Stop a helper when this process ends: what it has not cached yet is compiled another time."""
    process.kill()
    process.wait()
