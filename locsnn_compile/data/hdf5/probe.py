"""Read HDF5 files in processes that may crash, because the C library does not survive all damage.

``read.py`` starts this file as a script, once, with the number of an open connection. A request is the bytes of a
file. For each, this process forks a child that reads the whole file, and answers with one byte about how the child
ended:

- ``SURVIVED``: it read everything, whatever it found (even if it raised an ordinary exception)
- ``DIED``: it crashed, took too much memory or did not end
- ``OUT_OF_TIME``: it used up the processor time that this process inherited, which is no fault of the file

It imports nothing of this project, so that it starts at once.
"""

import contextlib
import io
import os
import resource
import signal
import sys
from multiprocessing.connection import Connection

import h5py

DIED = 0
SURVIVED = 1
OUT_OF_TIME = 2
CPU_SECONDS = 5
"""Processor time of a process that reads a file: the largest files that are read take less than a second."""
WALL_SECONDS = 60
"""Time until such a process is killed, by the clock: generous, because a busy machine may let it wait."""
MAX_MEMORY_BYTES = 3 << 29
"""1.5 GiB, about three times what all datasets that are read need: some damage makes the library ask for gigabytes."""
MAX_ADDRESSES_BYTES = 8 << 30
"""8 GiB of address space: libraries reserve some that they never use."""
KIB = 1 if sys.platform == "darwin" else 1024
"""Unit of the system's figure for memory, in bytes."""
MAX_BYTES = 500_000_000
"""Datasets are read up to this size in all; larger ones are refused later, unread."""


def main() -> None:
    """Answer requests until the connection is closed."""
    requests = Connection(int(sys.argv[1]))
    with contextlib.suppress(EOFError):
        while True:
            file_bytes = requests.recv_bytes()
            requests.send_bytes(bytes([outcome(file_bytes)]))


def outcome(data: bytes) -> int:
    """Read a file in a separate process; return how that process ended."""
    # Whether the child is ended by the limit that is set here, rather than by a lower one that this
    # process inherited.
    is_our_limit = CPU_SECONDS <= min(inherited_limits(resource.RLIMIT_CPU), default=CPU_SECONDS)
    pid = os.fork()
    if pid == 0:
        lower(resource.RLIMIT_CPU, CPU_SECONDS)
        lower(resource.RLIMIT_CORE, 0)
        lower(resource.RLIMIT_AS, MAX_ADDRESSES_BYTES)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        # Exceptions do not matter here: the process that reads the file after this reports them.
        with contextlib.suppress(BaseException), h5py.File(io.BytesIO(data), "r") as file:
            _read(file, MAX_BYTES, set())
        added_bytes = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * KIB
        # Ends at once, without the parent's exit handlers, which the fork has copied.
        os._exit(int(added_bytes > MAX_MEMORY_BYTES))
    # In the parent: kill the child after WALL_SECONDS, and wait for it.
    signal.signal(signal.SIGALRM, lambda *_: os.kill(pid, signal.SIGKILL))
    signal.alarm(WALL_SECONDS)
    _, status = os.waitpid(pid, 0)
    # alarm(0) returns the seconds that were left: 0 if the alarm has gone off.
    late = signal.alarm(0) == 0
    if os.WIFEXITED(status):
        return SURVIVED if os.WEXITSTATUS(status) == 0 else DIED
    # SIGKILL and SIGXCPU are how the system ends a process whose processor time is used up.
    if not is_our_limit and not late and os.WTERMSIG(status) in (signal.SIGKILL, signal.SIGXCPU):
        return OUT_OF_TIME
    return DIED


def lower(kind: int, limit: int) -> None:
    """Lower a limit of this process, unless it inherited a lower one already, which cannot be raised."""
    lowest = min([limit, *inherited_limits(kind)])
    resource.setrlimit(kind, (lowest, lowest))


def inherited_limits(kind: int) -> list[int]:
    """Return the limits of a kind that this process has inherited."""
    return [bound for bound in resource.getrlimit(kind) if bound != resource.RLIM_INFINITY]


def _read(group: h5py.Group, bytes_left: int, groups_read: set[object]) -> int:
    """Read all datasets of a group that are stored in the file itself; return how many bytes may still be read.

    ``bytes_left`` is how many there were before; ``groups_read`` are the ids of the groups that were read, because
    hard links can make a group contain itself.
    """
    for name in group:
        # A damaged entry must not hide those after it.
        with contextlib.suppress(Exception):
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue
            member = group[name]
            if isinstance(member, h5py.Group):
                if member.id not in groups_read:
                    groups_read.add(member.id)
                    bytes_left = _read(member, bytes_left, groups_read)
            elif member.shape is not None and not member.is_virtual and not member.external:
                # The reader turns numbers into int64 or float64, so each takes 8 bytes or more.
                size = int(member.size) * max(8, member.dtype.itemsize)
                if size <= bytes_left:
                    bytes_left -= size
                    member[()]  # reads all values
    return bytes_left


if __name__ == "__main__":
    main()
