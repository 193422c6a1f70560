"""Whether the HDF5 library survives a file: asked of a process that is started once and may die in our place."""

import atexit
import hashlib
import os
import subprocess
import sys
import threading
from pathlib import Path

_PROBE = Path(__file__).with_name("probe.py")


class _Prober:
    """The process, and what it said of files so far, by their hashes: loading looks at a file more than once."""

    def __init__(self) -> None:
        self.owner = os.getpid()
        self.known: dict[bytes, bool] = {}
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
        self.process = subprocess.Popen(
            [sys.executable, "-P", str(_PROBE)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
        )
        atexit.register(self.close)

    def survives(self, data: bytes) -> bool:
        """Ask it; ``OSError`` where it is gone."""
        digest = hashlib.sha256(data).digest()
        if digest not in self.known:
            assert self.process.stdin is not None
            assert self.process.stdout is not None
            self.process.stdin.write(len(data).to_bytes(8, "big"))
            self.process.stdin.write(data)
            self.process.stdin.flush()
            answer = self.process.stdout.read(1)
            if not answer:
                raise BrokenPipeError
            self.known[digest] = answer == b"\1"
        return self.known[digest]

    def close(self) -> None:
        """Let the process end, where it is ours."""
        if self.owner == os.getpid() and self.process.stdin is not None and self.process.stdout is not None:
            self.process.stdin.close()
            self.process.stdout.close()
            self.process.wait()


_prober: _Prober | None = None
_lock = threading.Lock()


def library_survives(data: bytes) -> bool:
    """Tell whether reading these bytes as HDF5 comes to an end; True as well where no process can be started to try.

    The library crashes, or runs for ever, on some damaged files; neither can be caught in the process that reads.
    """
    global _prober
    if sys.platform == "win32":
        return True
    try:
        with _lock:
            if _prober is None or _prober.owner != os.getpid():
                _prober = _Prober()
            return _prober.survives(data)
    except OSError:
        _prober = None
        return True
