"""Try HDF5 files in processes that may die: the C library does not survive all damage.

Run as a script with the number of an open connection. A request is the bytes of a file, and the answer is one byte: 1
if a separate process read all of it, whatever it found, or 0 if that process crashed, took too much memory or did not
end. It imports nothing of this project, so that it starts at once.
"""

import contextlib
import io
import os
import resource
import signal
import sys
from multiprocessing.connection import Connection

import h5py

CPU_SECONDS, WALL_SECONDS = 5, 60
MAX_MEMORY_BYTES = 3 << 29
"""More than all datasets that are read need: some damage makes the library ask for gigabytes."""
MOST_ADDRESSES = 8 << 30
KIB = 1 if sys.platform == "darwin" else 1024
"""Unit of the system's figure for memory, in bytes."""
MAX_BYTES = 500_000_000
"""Datasets are read up to this size in all; larger ones are refused later, unread."""


def main() -> None:
    """Answer requests until the connection is closed."""
    asked = Connection(int(sys.argv[1]))
    with contextlib.suppress(EOFError):
        while True:
            asked.send_bytes(bytes([survives(asked.recv_bytes())]))


def survives(data: bytes) -> bool:
    """Read a file in a separate process; tell whether that process ended by itself."""
    pid = os.fork()
    if pid == 0:
        lower(resource.RLIMIT_CPU, CPU_SECONDS)
        lower(resource.RLIMIT_CORE, 0)
        lower(resource.RLIMIT_AS, MOST_ADDRESSES)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        # Exceptions do not matter here: whoever reads the file after this reports them.
        with contextlib.suppress(BaseException), h5py.File(io.BytesIO(data), "r") as file:
            _read(file, MAX_BYTES, set())
        more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * KIB
        os._exit(int(more > MAX_MEMORY_BYTES))
    signal.signal(signal.SIGALRM, lambda *_: os.kill(pid, signal.SIGKILL))
    signal.alarm(WALL_SECONDS)
    _, status = os.waitpid(pid, 0)
    signal.alarm(0)
    return os.WIFEXITED(status) and os.WEXITSTATUS(status) == 0


def lower(kind: int, limit: int) -> None:
    """Lower a limit of this process; what it inherited may be lower already, and then stays: none can be raised."""
    inherited = resource.getrlimit(kind)
    most = min([limit, *(bound for bound in inherited if bound != resource.RLIM_INFINITY)])
    resource.setrlimit(kind, (most, most))


def _read(group: h5py.Group, left: int, seen: set[object]) -> int:
    """Read all datasets of a group that are stored in the file itself; return how many bytes may still be read."""
    for name in group:
        # A damaged entry must not hide those after it.
        with contextlib.suppress(Exception):
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue
            found = group[name]
            if isinstance(found, h5py.Group):
                if found.id not in seen:
                    seen.add(found.id)
                    left = _read(found, left, seen)
            elif found.shape is not None and not found.is_virtual and not found.external:
                size = int(found.size) * max(8, found.dtype.itemsize)
                if size <= left:
                    left -= size
                    found[()]
    return left


if __name__ == "__main__":
    main()
