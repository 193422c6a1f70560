"""Points measured on the workers of a Dask cluster; needs the extra ``dask``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from types import ModuleType
from typing import Any

from locsnn_compile.errors import InputError
from locsnn_compile.explore.code import check_code, code_version
from locsnn_compile.explore.executors import Executor, Points
from locsnn_compile.explore.point import measure_packed
from locsnn_compile.explore.study import Study
from locsnn_compile.settings import Setting

PATIENCE_SECONDS = 30
"""For the scheduler to answer, and for its first worker."""


def on_dask(address: str) -> Executor:
    """Return the executor on the cluster of a scheduler; ``InputError`` where Dask is not installed."""
    try:
        import distributed
    except ImportError:
        raise InputError(
            "--scheduler", "Dask is not installed", fix="Install it with: pip install 'locsnn-compile[dask]'"
        ) from None
    return partial(_on_dask, distributed, address)


def _on_dask(distributed: ModuleType, address: str, study: Study, settings: Sequence[Setting]) -> Points:
    packed, where = study.packed(), _where(address)
    with _client(distributed, address) as client:
        # The study goes with every task, not to the workers beforehand, where it would be lost with them.
        futures = {client.submit(measure_packed, packed, setting, key=study.key(setting)) for setting in settings}
        for future in distributed.as_completed(futures, loop=client.loop):
            try:
                point = future.result()
            except distributed.KilledWorker:
                fix = "Give them more memory, or fewer recordings with --recordings."
                raise InputError(where, "its workers die on a setting", fix=fix) from None
            except distributed.CancelledError:
                fix = "Start it and the command again: finished settings are kept."
                raise InputError(where, "it was lost", fix=fix) from None
            futures.discard(future)
            yield point


@contextmanager
def _client(distributed: ModuleType, address: str) -> Iterator[Any]:
    """Connect to a scheduler that has at least one worker, all of them with this code."""
    where, waited = _where(address), f"within {PATIENCE_SECONDS} s"
    try:
        client = distributed.Client(address, timeout=PATIENCE_SECONDS, set_as_default=False)
    except ValueError as error:
        raise InputError(where, f"it is no address: {error}", fix="Give one such as tcp://127.0.0.1:8786.") from None
    except OSError:
        fix = "Start one with: dask scheduler"
        raise InputError(where, "no scheduler answers", measured=waited, fix=fix) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE_SECONDS)
        except TimeoutError:
            fix = f"Start some with: dask worker {address}"
            raise InputError(where, "it has no workers", measured=waited, fix=fix) from None
        try:
            codes = client.run(code_version)
        except ImportError as error:
            fix = "Install it there."
            raise InputError(where, "a worker has no locsnn-compile", measured=str(error), fix=fix) from None
        for code in codes.values():
            check_code(where, code)
        yield client


def _where(address: str) -> str:
    return f"--scheduler {address}"
