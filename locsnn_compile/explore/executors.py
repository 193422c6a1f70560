"""Where points are measured: in this process, in others of this machine, or on a Dask cluster.

Each executor yields points as they are finished, in any order, and every setting once. A process or worker that dies
takes nothing with it: what it had not handed over is measured again.
"""

import signal
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import active_children, get_context

from locsnn_compile.cluster.spread import connected, installed_dask, packed, work_packed
from locsnn_compile.errors import InputError
from locsnn_compile.explore.point import Point, Study, measure
from locsnn_compile.settings import Setting

Points = Generator[Point, None, None]
Executor = Callable[[Study, Sequence[Setting]], Points]

ATTEMPTS = 3
"""Pools in a row that may die without having finished a point."""


def here(study: Study, settings: Sequence[Setting]) -> Points:
    """Measure one setting after the other."""
    for setting in settings:
        yield measure(study, setting)


def on_dask(address: str) -> Executor:
    """Return the executor on the cluster of a scheduler; ``InputError`` where Dask is not installed."""
    installed_dask()
    return partial(_on_dask, address)


def _on_dask(address: str, study: Study, settings: Sequence[Setting]) -> Points:
    job = packed(partial(measure, study))
    with connected(address) as cluster:
        submit = partial(cluster.client.submit, work_packed, job)
        futures = {submit(packed(setting), key=study.key(setting)) for setting in settings}
        for future in cluster.distributed.as_completed(futures, loop=cluster.client.loop):
            point = cluster.result(future)
            futures.discard(future)
            yield point


def in_processes(workers: int) -> Executor:
    """Return the executor with so many processes of this machine."""
    return partial(_in_processes, workers)


def _in_processes(workers: int, study: Study, settings: Sequence[Setting]) -> Points:
    left = dict.fromkeys(settings)
    job = packed(partial(measure, study))
    attempts = ATTEMPTS
    while left and attempts:
        attempts -= 1
        for point in _one_pool(workers, job, tuple(left)):
            del left[point.setting]
            attempts = ATTEMPTS
            yield point
    if left:
        measured = f"{ATTEMPTS} times in a row, {len(left)} settings left"
        fix = "Give fewer workers, or fewer recordings with --recordings."
        raise InputError(f"--workers {workers}", "its processes die", measured=measured, fix=fix)


def _one_pool(workers: int, job: bytes, settings: Sequence[Setting]) -> Points:
    """Yield what a pool finishes before one of its processes dies, if one does: that ends the pool."""
    before = set(active_children())
    # Forking a process with threads, the engine's, may hang.
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_leave_interrupts_to_parent)
    try:
        futures = [pool.submit(work_packed, job, packed(setting)) for setting in settings]
        for future in as_completed(futures):
            try:
                point = future.result()
            except BrokenProcessPool:
                continue
            yield point
    except BaseException:
        # Interrupted or left: nobody waits for what is under way.
        for process in set(active_children()) - before:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _leave_interrupts_to_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
