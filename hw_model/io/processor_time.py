"""The limit of processor time (``ulimit -t``): keep the last second of it for an error message.

When a process reaches its hard limit, the system kills it at once. At its soft limit, it only sends the signal SIGXCPU,
which the commands handle. So the soft limit is set a second below the hard one.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from hw_model.errors import InputError

if sys.platform != "win32":
    import resource

LEAST_SECONDS = 2
"""The smallest limit with which a command starts: one second to work, and one for the error message."""


_inherited_seconds: list[int] = []
"""The limit of the process while :func:`last_second_kept` has lowered it; else empty."""


def processor_seconds() -> int | None:
    """Return how many seconds of processor time this process may use; None if there is no limit."""
    if sys.platform == "win32":
        return None
    if _inherited_seconds:
        return _inherited_seconds[0]
    # The soft and the hard limit: what is reached first counts.
    limits = resource.getrlimit(resource.RLIMIT_CPU)
    return min((limit for limit in limits if limit != resource.RLIM_INFINITY), default=None)


def too_little_time(seconds: int) -> InputError:
    """Return the error for the user when the processor time, ``seconds`` in all, is used up."""
    measured = f"{seconds} s for this process"
    fix = "Raise the limit, as with ulimit -t, or give fewer recordings."
    return InputError("processor time", "there is too little", measured=measured, fix=fix)


@contextmanager
def last_second_kept() -> Iterator[int | None]:
    """Make the system send SIGXCPU a second before it kills the process.

    The value is the seconds that the process may use, or None if there is no limit. Raises ``InputError`` if the limit
    is too short to keep a second of it.
    """
    seconds = processor_seconds()
    if sys.platform == "win32" or seconds is None:
        yield None
        return
    if seconds < LEAST_SECONDS:
        measured = f"{seconds} s for this process against {LEAST_SECONDS} s"
        fix = "Raise the limit, as with ulimit -t."
        raise InputError("processor time", "there is too little", measured=measured, fix=fix)
    inherited_limits = resource.getrlimit(resource.RLIMIT_CPU)
    soft_limit, hard_limit = inherited_limits
    # A shell's `ulimit -t` sets both limits. If they differ already, SIGXCPU comes in time.
    if soft_limit == hard_limit:
        resource.setrlimit(resource.RLIMIT_CPU, (seconds - 1, hard_limit))
    _inherited_seconds.append(seconds)
    try:
        yield seconds
    finally:
        _inherited_seconds.clear()
        resource.setrlimit(resource.RLIMIT_CPU, inherited_limits)
