"""Limits of memory (``ulimit -v``): refuse a limit that is too low, and recognise errors that come from one.

Libraries report a lack of memory in many ways, and some hang or abort. The commands check the limit before they load
such libraries. Readers of files ask whether an exception means damaged bytes or too little memory.
"""

import errno
import os
import sys
from pathlib import Path

from hw_model.errors import InputError

if sys.platform != "win32":
    # Imported early, because it cannot be loaded any more once memory has run out.
    import resource

MIB = 1 << 20
NEAR_BYTES = 256 * MIB
"""A process with less than this left below its limit cannot load a large library, such as LLVM."""
READING_BYTES = 192 * MIB
"""The lowest limit with which commands start that read and write files.

With less, numpy's OpenBLAS ends the process, and scipy's retries for ever.
"""
PLAYING_BYTES = 768 * MIB
"""The lowest limit with which commands start that play recordings."""
LOOPS_BYTES = 400 * MIB
"""How much must be left below the limit before the compiled loops are loaded: LLVM aborts if it gets too little."""
RESERVE_BYTES = 16 * MIB
"""How much :func:`keep_reserve` holds back for the error message."""
_NOT_LOADED = ("failed to map segment", "cannot allocate memory", "cannot create shared object")
"""Messages of the dynamic loader when there is no room for a library."""

_reserve: list[bytearray] = []
"""The memory that is held back, if any."""


def memory_limit() -> int | None:
    """Return how many bytes of address space this process may have (``ulimit -v``); None if there is no limit."""
    if sys.platform == "win32":
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def check_memory(least_bytes: int) -> None:
    """Raise InputError if the limit is below ``least_bytes``, with which C libraries hang or abort silently."""
    limit = memory_limit()
    if limit is not None and limit < least_bytes:
        # The need is rounded up to MiB (`-(-a // b)`), the limit down.
        measured = f"{limit // MIB} MiB for this process against {-(-least_bytes // MIB)} MiB"
        fix = "Raise the limit, as with ulimit -v."
        raise InputError("memory", "there is too little", measured=measured, fix=fix)


def check_room(more_bytes: int) -> None:
    """Raise InputError if this process may not take ``more_bytes`` in addition to what it has."""
    check_memory(_address_space_bytes() + more_bytes)


def keep_reserve() -> None:
    """Hold some memory back until :func:`spend_reserve`, if there is a limit: an error message takes memory, too."""
    if memory_limit() is not None and not _reserve:
        _reserve.append(bytearray(RESERVE_BYTES))


def spend_reserve() -> None:
    """Free the memory that :func:`keep_reserve` held back."""
    _reserve.clear()


def near_limit() -> bool:
    """Return whether this process has nearly as much memory as it may have."""
    limit = memory_limit()
    return limit is not None and limit - _address_space_bytes() < NEAR_BYTES


def lacks_memory(error: BaseException) -> bool:
    """Return whether an exception that is none of our own errors comes from too little memory."""
    if isinstance(error, MemoryError):
        return True
    if isinstance(error, OSError) and error.errno is not None:
        return error.errno == errno.ENOMEM
    message = str(error).lower()
    if memory_limit() is not None and any(words in message for words in _NOT_LOADED):
        return True
    # A library that cannot be loaded, or a thread that cannot be started, raises exceptions of many kinds.
    return isinstance(error, ImportError | OSError | RuntimeError | SystemError) and near_limit()


def too_little(error: BaseException) -> InputError:
    """Return the error for the user, given an exception that :func:`lacks_memory`."""
    limit = memory_limit()
    if limit is None:
        fix = "Give fewer recordings, or free some."
        return InputError("memory", "there is too little", measured=str(error), fix=fix)
    measured = f"{limit // MIB} MiB for this process"
    fix = "Raise the limit, as with ulimit -v, or give fewer recordings."
    return InputError("memory", "there is too little", measured=measured, fix=fix)


def _address_space_bytes() -> int:
    """Return how many bytes of address space this process has; 0 if the system does not tell."""
    try:
        # The first number is the size of the address space in pages, see proc(5).
        pages = Path("/proc/self/statm").read_text("ascii").split()[0]
    except OSError:
        return 0
    return int(pages) * os.sysconf("SC_PAGE_SIZE")
