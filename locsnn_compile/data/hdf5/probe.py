"""Read HDF5 files before anybody else does, in processes that may die: the library in C does not survive all damage.

Run as a script with the number of an open connection. A request is the bytes of a file; the answer is one byte: 1 where
a process of its own read all of it, whatever it found, and 0 where that process crashed, took too much memory or did
not come to an end. Imports nothing of this project, so that it starts at once.
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
"""More than all datasets take that are read: some damage has the library ask for gigabytes."""
KIB = 1 if sys.platform == "darwin" else 1024
"""Of the system's figure for memory."""
MAX_BYTES = 500_000_000
"""Datasets are read up to this size together: what is larger is refused later, unread."""


def main() -> None:
    """Answer requests until there are no more."""
    asked = Connection(int(sys.argv[1]))
    with contextlib.suppress(EOFError):
        while True:
            asked.send_bytes(bytes([survives(asked.recv_bytes())]))


def survives(data: bytes) -> bool:
    """Read a file in a process of its own; tell whether that came to an end by itself."""
    pid = os.fork()
    if pid == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        # What Python can tell of is told again, in words, by who reads the file after this.
        with contextlib.suppress(BaseException), h5py.File(io.BytesIO(data), "r") as file:
            _read(file, MAX_BYTES, set())
        more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * KIB
        os._exit(int(more > MAX_MEMORY_BYTES))
    signal.signal(signal.SIGALRM, lambda *_: os.kill(pid, signal.SIGKILL))
    signal.alarm(WALL_SECONDS)
    _, status = os.waitpid(pid, 0)
    signal.alarm(0)
    return os.WIFEXITED(status) and os.WEXITSTATUS(status) == 0


def _read(group: h5py.Group, left: int, seen: set[object]) -> int:
    """Read all datasets of a group that are stored in the file; return how many bytes may still be read."""
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
