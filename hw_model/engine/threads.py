"""Divide a batch between threads, which run in parallel: our compiled loops and numpy release Python's lock."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise
from typing import TypeVar

T = TypeVar("T")
LITTLE = 1 << 19
"""Bytes below which waking a thread takes longer than looking through them; chosen by hand."""


def in_parts(work: Callable[[int, int], T], batch: int, size: int = LITTLE) -> list[T]:
    """Run ``work(start, stop)`` on equal parts of a batch, one per core, in threads, and return the results in order.

    ``size``: the bytes that the work reads; with less than :data:`LITTLE`, the batch is not divided.
    """
    parts = 1 if size < LITTLE else min(batch, cores())
    if parts == 1:
        return [work(0, batch)]
    # This thread takes the first part, so that one thread less has to be woken.
    first_part, *other_parts = pairwise(batch * part // parts for part in range(parts + 1))
    futures = [_threads(os.getpid()).submit(work, *part) for part in other_parts]
    return [work(*first_part), *(future.result() for future in futures)]


@lru_cache(maxsize=1)
def cores() -> int:
    """Return how many cores this process may use.

    The answer is cached, as asking takes as long as the last steps of a short recording.
    """
    affinity = getattr(os, "sched_getaffinity", None)  # missing on macOS and Windows
    if affinity:
        return len(affinity(0))
    return os.cpu_count() or 1


@lru_cache(maxsize=1)
def _threads(process: int) -> ThreadPoolExecutor:
    """Return the threads of a process. The process is the key of the cache, as a fork does not inherit threads."""
    return ThreadPoolExecutor(cores(), thread_name_prefix="hw_model")
