"""Whether an error comes from too little memory, which libraries say in many ways, rather than from what was read."""

import errno
import os
import sys
from pathlib import Path

from hw_model.errors import InputError

if sys.platform != "win32":
    import resource  # here, because it cannot be loaded any more when memory has run out

MIB = 1 << 20
NEAR_BYTES = 256 * MIB
"""A process with less than this left below its limit cannot load a large library, such as LLVM."""
READING_BYTES, PLAYING_BYTES = 192 * MIB, 768 * MIB
"""The lowest limits with which commands begin: those that read and write files, and those that play recordings.

With less, numpy's OpenBLAS ends the process, and scipy's tries again without end.
"""
LOOPS_BYTES = 400 * MIB
"""What is left below the limit before the compiled loops are loaded: LLVM ends the process where it gets too little."""
RESERVE_BYTES = 16 * MIB
_NOT_LOADED = ("failed to map segment", "cannot allocate memory", "cannot create shared object")
"""How the loader of libraries says that there was no room for one."""

_reserve: list[bytearray] = []


def memory_limit() -> int | None:
    """Return how many bytes of addresses this process may have (``ulimit -v``); None where there is no limit."""
    if sys.platform == "win32":
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def check_memory(least_bytes: int) -> None:
    """Refuse a limit below ``least_bytes``: libraries in C hang or abort without a word."""
    limit = memory_limit()
    if limit is not None and limit < least_bytes:
        measured = f"{limit // MIB} MiB for this process against {-(-least_bytes // MIB)} MiB"
        fix = "Raise the limit, as with ulimit -v."
        raise InputError("memory", "there is too little", measured=measured, fix=fix)


def check_room(more_bytes: int) -> None:
    """Refuse a limit that leaves less than ``more_bytes`` above what this process has."""
    check_memory(_addresses() + more_bytes)


def keep_reserve() -> None:
    """Hold some addresses until :func:`spend_reserve`, where there is a limit: saying that it is reached takes some."""
    if memory_limit() is not None and not _reserve:
        _reserve.append(bytearray(RESERVE_BYTES))


def spend_reserve() -> None:
    """Give back what :func:`keep_reserve` held."""
    _reserve.clear()


def near_limit() -> bool:
    """Tell whether this process has nearly as much memory as it may have."""
    limit = memory_limit()
    return limit is not None and limit - _addresses() < NEAR_BYTES


def lacks_memory(error: BaseException) -> bool:
    """Tell whether an error that no reader has put into words comes from too little memory."""
    if isinstance(error, MemoryError):
        return True
    if isinstance(error, OSError) and error.errno is not None:
        return error.errno == errno.ENOMEM
    if memory_limit() is not None and any(said in str(error).lower() for said in _NOT_LOADED):
        return True
    # A library that cannot be loaded, or a thread that cannot be started, is an error of its own kind each time.
    return isinstance(error, ImportError | OSError | RuntimeError | SystemError) and near_limit()


def too_little(error: BaseException) -> InputError:
    """Return the message for an error that :func:`lacks_memory`."""
    limit = memory_limit()
    if limit is None:
        fix = "Give fewer recordings, or free some."
        return InputError("memory", "there is too little", measured=str(error), fix=fix)
    measured = f"{limit // MIB} MiB for this process"
    fix = "Raise the limit, as with ulimit -v, or give fewer recordings."
    return InputError("memory", "there is too little", measured=measured, fix=fix)


def _addresses() -> int:
    """Return how many bytes of addresses this process has; 0 where the system does not say."""
    try:
        pages = Path("/proc/self/statm").read_text("ascii").split()[0]
    except OSError:
        return 0
    return int(pages) * os.sysconf("SC_PAGE_SIZE")
