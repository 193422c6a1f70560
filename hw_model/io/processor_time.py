"""How much processor time a process may use (``ulimit -t``), and the words for when it is used up."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from hw_model.errors import InputError

if sys.platform != "win32":
    import resource

LEAST_SECONDS = 2
"""The last second is kept for saying that the time is used up."""


_kept: list[int] = []
"""The limit that was inherited, while a second of it is kept."""


def processor_seconds() -> int | None:
    """Return how many seconds of processor time this process may use; None where there is no limit."""
    if sys.platform == "win32":
        return None
    if _kept:
        return _kept[0]
    limits = resource.getrlimit(resource.RLIMIT_CPU)
    return min((limit for limit in limits if limit != resource.RLIM_INFINITY), default=None)


def too_little_time(seconds: int) -> InputError:
    """Return the message for a process whose seconds of processor time are used up."""
    measured = f"{seconds} s for this process"
    fix = "Raise the limit, as with ulimit -t, or give fewer recordings."
    return InputError("processor time", "there is too little", measured=measured, fix=fix)


@contextmanager
def last_second_kept() -> Iterator[int | None]:
    """Let the system send SIGXCPU a second before it kills the process; give the seconds that it may use, or None.

    A shell's ``ulimit -t`` sets both limits, of which the upper one kills without a signal that can be handled.
    Raises ``InputError`` where no second can be kept.
    """
    seconds = processor_seconds()
    if sys.platform == "win32" or seconds is None:
        yield None
        return
    if seconds < LEAST_SECONDS:
        measured = f"{seconds} s for this process against {LEAST_SECONDS} s"
        fix = "Raise the limit, as with ulimit -t."
        raise InputError("processor time", "there is too little", measured=measured, fix=fix)
    inherited = resource.getrlimit(resource.RLIMIT_CPU)
    if inherited[0] == inherited[1]:
        resource.setrlimit(resource.RLIMIT_CPU, (seconds - 1, inherited[1]))
    _kept.append(seconds)
    try:
        yield seconds
    finally:
        _kept.clear()
        resource.setrlimit(resource.RLIMIT_CPU, inherited)
