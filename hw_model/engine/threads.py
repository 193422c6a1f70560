"""Threads that share a batch; compiled loops, and numpy's on long arrays, let others run."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise
from typing import TypeVar

T = TypeVar("T")
LITTLE = 1 << 19
"""Bytes that are looked through faster than a thread is woken."""


def in_parts(work: Callable[[int, int], T], batch: int, size: int = LITTLE) -> list[T]:
    """Run ``work(start, stop)`` on even parts of a batch, one a core, in threads, and return what they return.

    ``size``: bytes to be looked through; a batch of few is not divided.
    """
    parts = 1 if size < LITTLE else min(batch, cores())
    if parts == 1:
        return [work(0, batch)]
    first, *rest = pairwise(batch * part // parts for part in range(parts + 1))
    others = [_threads(os.getpid()).submit(work, *part) for part in rest]
    return [work(*first), *(other.result() for other in others)]


@lru_cache(maxsize=1)
def cores() -> int:
    """Return how many cores this process may use; asking for it takes as long as a short recording's last steps."""
    may_use = getattr(os, "sched_getaffinity", None)  # macOS and Windows have none
    return len(may_use(0)) if may_use else os.cpu_count() or 1


@lru_cache(maxsize=1)
def _threads(process: int) -> ThreadPoolExecutor:
    """Return the threads of this process; a fork has none of its parent's."""
    return ThreadPoolExecutor(cores(), thread_name_prefix="hw_model")
