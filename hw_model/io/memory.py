"""Whether an error comes from too little memory, which libraries say in many ways, rather than from what was read."""

import errno
import os
import sys
from pathlib import Path

from hw_model.errors import InputError

NEAR_BYTES = 256 << 20
"""A process with less than this left below its limit cannot load a large library, such as LLVM."""
MIB = 1 << 20


def memory_limit() -> int | None:
    """Return how many bytes of addresses this process may have (``ulimit -v``); None where there is no limit."""
    if sys.platform == "win32":
        return None
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


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
