"""A job in parts, run in this process, in others on this machine, or on workers of a Dask cluster with the same code.

A *spread* is a function that takes the work of a job and its parts, and yields the results: ``here`` runs the parts one
after the other, and :func:`spread_over` gives the spreads of processes and clusters. Callers that play many recordings
or measure many settings take a spread as an argument, and do not know where the parts run.

Dask needs the extra ``dask``. If a process or worker dies, its part runs again. Figures are comparable only if the same
code made them.
"""

import hashlib
import logging
import pickle
import signal
import socket
import sys
import threading
import time
import zlib
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import cache, lru_cache, partial
from importlib.metadata import PackageNotFoundError, version
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any, Protocol, TypeVar

import hw_model
from hw_model.io.extras import needed
from locsnn_compile.errors import InputError, check_same, counted

PACKAGE = "locsnn-compile"
_SUFFIXES = (".py", ".yaml")
"""Of files that determine results: code, and descriptions of chips."""


@cache
def code_version() -> str:
    """Return the version of the package and a digest of its sources, which also change between releases."""
    digest = hashlib.sha256()
    for package_folder in (Path(hw_model.__file__).parent, Path(__file__).parents[1]):
        # Sorted, because systems list folders in different orders.
        for path in sorted(package_folder.rglob("*")):
            if path.suffix in _SUFFIXES:
                content = path.read_bytes()
                name = path.relative_to(package_folder.parent).as_posix()
                # The length says where one file ends and the next one begins.
                digest.update(f"{name}\n{len(content)}\n".encode() + content)
    try:
        number = version(PACKAGE)
    except PackageNotFoundError:  # run from its sources
        number = "0"
    return f"{number}+{digest.hexdigest()[:12]}"


def check_code(where: str, code: str, expected: str | None = None) -> None:
    """Refuse code of another version than the expected one, by default that of this process."""
    what = "another version of locsnn-compile runs there"
    fix = "Install the same one everywhere."
    check_same(code, expected or code_version(), where, what, fix=fix)


Part = TypeVar("Part")
Result = TypeVar("Result")


class Spread(Protocol):
    """Runs the parts of a job, holding only the parts and results that are in progress."""

    def __call__(
        self, work: Callable[[Part], Result], parts: Iterable[Part], /
    ) -> Generator[Result, None, None]:
        """Yield the result of ``work`` for each part, in order."""


def here(work: Callable[[Part], Result], parts: Iterable[Part], /) -> Generator[Result, None, None]:
    """Run the parts one by one in this process."""
    for part in parts:
        yield work(part)


def packed(value: object) -> bytes:
    """Return a value as bytes to send to another process; recordings are mostly zeros, and shrink a hundredfold."""
    return zlib.compress(pickle.dumps(value))


@lru_cache(maxsize=2)
def unpacked(content: bytes) -> Any:
    """Return the value that :func:`packed` turned into bytes; the last ones are kept for the next parts of the job.

    Unpickling runs code: this is only called with bytes that another process of the same job has packed.
    """
    return pickle.loads(zlib.decompress(content))


def work_packed(work: bytes, part: bytes) -> Any:
    """Run a part that another process sent; ``work``, which all parts share, is unpacked once."""
    run = unpacked(work)
    # Without the cache: no part comes twice, and parts would push the work out.
    return run(unpacked.__wrapped__(part))


def work_of_version(code: str, where: str, work: bytes, part: bytes) -> Any:
    """Run a part on a worker, if the worker runs code of this version.

    Workers are checked at the start of the job, but others may join later.
    """
    check_code(where, code_version(), code)
    return work_packed(work, part)


# These times are chosen by hand.
ANSWER_SECONDS = 10
"""How long to wait for an answer of the scheduler."""
PATIENCE_SECONDS = 30
"""How long to wait for a worker: the first one, and again whenever none is left."""
CHECK_SECONDS = 1.0
"""How often to check, while waiting for a result, that there are workers."""
AHEAD = 2
"""Parts in progress per thread of the cluster, so that the next one is there when one is done."""


def on_workers(
    client: Any, where: str, work: Callable[[Part], Result], parts: Iterable[Part], /
) -> Generator[Result, None, None]:
    """Run parts on the workers of a ``distributed.Client``, a few at a time; ``where`` is how errors name it.

    If a worker dies, Dask runs its part again, but only a few times.
    """
    # The work is sent with every part; if it were sent to workers beforehand, it would be lost with them.
    job = packed(work)
    threads_by_worker = _ask(where, client.nthreads)
    most_in_progress = AHEAD * max(1, sum(threads_by_worker.values()))
    # Without ``pure=False``, Dask would return the result of an equal part instead of running the part again.
    send = partial(client.submit, work_of_version, code_version(), where, job, pure=False)
    in_progress = deque[Any]()  # the oldest first, so that results come in order
    distributed = sys.modules["distributed"]  # imported by ``connected``: not everybody has it
    try:
        for part in parts:
            in_progress.append(send(packed(part)))
            if len(in_progress) == most_in_progress:
                yield _result(client, where, in_progress.popleft())
        while in_progress:
            yield _result(client, where, in_progress.popleft())
    except distributed.KilledWorker:
        raise InputError(
            where, "its workers keep dying", fix="Give them more memory, or fewer recordings."
        ) from None
    except distributed.CancelledError:
        raise InputError(where, "it was lost", fix="Start it and the command again.") from None
    except (AttributeError, ModuleNotFoundError) as error:
        # The worker has no function or module of the name that was sent, so it cannot check versions either.
        what = "another version of locsnn-compile runs there"
        fix = "Install the same one everywhere."
        raise InputError(where, what, measured=str(error), fix=fix) from None


def _result(client: Any, where: str, future: Any) -> Any:
    """Wait for a result as long as there are workers; without any for :data:`PATIENCE_SECONDS`, give up."""
    workers_seen_at = time.monotonic()
    while True:
        with suppress(TimeoutError):
            return future.result(timeout=CHECK_SECONDS)
        what = "it has no workers left"
        fix = "Start some, and the command again."
        try:
            if _within(ANSWER_SECONDS, client.nthreads):
                workers_seen_at = time.monotonic()
        except Exception:  # of many kinds: the scheduler is silent, or the connection is broken
            what = "it does not answer any more"
            fix = "Start it and the command again."
        if time.monotonic() - workers_seen_at > PATIENCE_SECONDS:
            measured = f"for {PATIENCE_SECONDS} s"
            raise InputError(where, what, measured=measured, fix=fix)


def _within(seconds: float, ask: Callable[[], Result]) -> Result:
    """Return the result of a call, or raise its error.

    Raises ``TimeoutError`` if it takes too long: the call then goes on in a thread for which nothing waits.
    """
    answer = Future[Result]()

    def run() -> None:
        try:
            answer.set_result(ask())
        except BaseException as error:
            answer.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return answer.result(seconds)


def _ask(where: str, ask: Callable[[], Result]) -> Result:
    """Return the answer of a scheduler that has answered before; ``InputError`` after :data:`ANSWER_SECONDS`."""
    try:
        return _within(ANSWER_SECONDS, ask)
    except OSError:  # of a broken connection; TimeoutError is one, too
        what = "it does not answer any more"
        measured = f"for {ANSWER_SECONDS} s"
        fix = "Start it and the command again."
        raise InputError(where, what, measured=measured, fix=fix) from None


@contextmanager
def spread_over(address: str | None, processes: int | None = None) -> Iterator[Spread]:
    """Give a spread: over the cluster of a scheduler, over processes of this machine, or in this process.

    ``address`` is that of the scheduler, and ``processes`` their number; with neither, nothing is spread.
    """
    if address is None:
        yield partial(_in_processes, processes) if processes else here
        return
    with connected(address) as client:
        yield partial(on_workers, client, f"--scheduler {address}")


def is_answered_at(place: tuple[str, int], *, speaks_first: bool = True) -> bool:
    """Return whether something at a host and port answers within :data:`ANSWER_SECONDS`.

    A scheduler speaks first, unless by TLS. With a service that accepts and is silent, a client of Dask would wait for
    minutes.
    """
    deadline = time.monotonic() + ANSWER_SECONDS
    while time.monotonic() < deadline:
        with suppress(OSError), socket.create_connection(place, 1) as connection:
            # A timeout of 0 would not wait at all, and a negative one is an error.
            connection.settimeout(max(0.1, deadline - time.monotonic()))
            if not speaks_first or connection.recv(1):
                return True
        time.sleep(0.1)
    return False


def _client(distributed: Any, address: str) -> Any:
    """Return a ``distributed.Client`` of a scheduler; ``TimeoutError`` where none speaks."""
    # Looked for first, because a client that finds nobody ends with a traceback, after three times as long.
    is_in_this_process = address.startswith("inproc://")  # such a scheduler has no port
    if not is_in_this_process:
        host_and_port = distributed.comm.addressing.get_address_host_port(address)
        if not is_answered_at(host_and_port, speaks_first=not address.startswith("tls://")):
            raise TimeoutError
    return distributed.Client(address, timeout=ANSWER_SECONDS, set_as_default=False)


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Give a ``distributed.Client`` of a scheduler that has at least one worker; all must run this code."""
    distributed = needed(package="distributed", extra="dask", where="--scheduler")
    # When a scheduler is lost, Dask logs dozens of lines; here it is one of the errors below.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    where = f"--scheduler {address}"
    try:
        # The client has a timeout of its own, which does not cover a service that sends a few bytes and stops.
        client = _within(ANSWER_SECONDS, partial(_client, distributed, address))
    except ValueError as error:
        fix = "Give one such as tcp://127.0.0.1:8786."
        raise InputError(where, f"it is not an address: {error}", fix=fix) from None
    except (OSError, MemoryError):
        # MemoryError, because Dask takes the first bytes of another service for the size of a message.
        fix = "Start one with: dask scheduler"
        raise InputError(
            where, "no scheduler answers", measured=f"within {ANSWER_SECONDS} s", fix=fix
        ) from None
    try:
        wait_for_workers(client, where, address)
        _check_workers(client, where)
        yield client
    finally:
        with suppress(Exception):  # if the scheduler is gone, there is nothing left to close
            _within(ANSWER_SECONDS, client.close)


def wait_for_workers(client: Any, where: str, address: str) -> None:
    """Wait until a scheduler has a worker; raise ``InputError`` after :data:`PATIENCE_SECONDS`."""
    deadline = time.monotonic() + PATIENCE_SECONDS
    while not _ask(where, client.nthreads):
        if time.monotonic() > deadline:
            measured = f"within {PATIENCE_SECONDS} s"
            fix = f"Start some with: dask worker {address}"
            raise InputError(where, "it has no workers", measured=measured, fix=fix)
        time.sleep(0.1)


def _check_workers(client: Any, where: str) -> None:
    """Refuse workers that run other code, that do not have the package, or that do not answer."""
    try:
        codes = _within(PATIENCE_SECONDS, partial(client.run, code_version))
    except ImportError as error:
        fix = "Install it there."
        raise InputError(
            where, "a worker has no locsnn-compile", measured=str(error), fix=fix
        ) from None
    except OSError:
        what = "a worker does not answer"
        measured = f"within {PATIENCE_SECONDS} s"
        fix = "End it, or start it again."
        raise InputError(where, what, measured=measured, fix=fix) from None
    for code in codes.values():
        check_code(where, code)


IGNORE_INTERRUPTS = (signal.SIGINT, signal.SIG_IGN)
"""Arguments of ``signal.signal``: Ctrl-C reaches all processes of a terminal, and only the parent handles it."""
ATTEMPTS = 3
"""Pools of processes that may die in a row without finishing a part: chosen by hand."""


def _in_processes(
    workers: int, work: Callable[[Part], Result], parts: Iterable[Part], /
) -> Generator[Result, None, None]:
    """Run parts in ``workers`` processes of this machine; results come in any order.

    If a process dies, as when memory runs out, Python's pool breaks: the parts that are left then run in a new pool.
    """
    job = packed(work)
    unfinished = dict(enumerate(map(packed, parts)))
    attempts = ATTEMPTS
    while unfinished and attempts:
        attempts -= 1
        for number, result in one_pool(workers, job, unfinished):
            del unfinished[number]
            attempts = ATTEMPTS  # something was finished, so another pool is worth trying
            yield result
    if unfinished:
        measured = f"{ATTEMPTS} times in a row, {counted(len(unfinished), 'setting')} left"
        fix = "Give fewer workers, or fewer recordings with --recordings."
        raise InputError(f"--workers {workers}", "its processes die", measured=measured, fix=fix)


def one_pool(workers: int, job: bytes, parts: Mapping[int, bytes]) -> Iterator[tuple[int, Any]]:
    """Yield (number of the part, result) of a new pool, until the end or until one of its processes dies."""
    children_before = set(active_children())
    # Forking may hang, because the engine has threads.
    pool = ProcessPoolExecutor(
        workers,
        mp_context=get_context("spawn"),
        initializer=signal.signal,
        initargs=IGNORE_INTERRUPTS,
    )
    try:
        futures = {pool.submit(work_packed, job, part): number for number, part in parts.items()}
        for future in as_completed(futures):
            try:
                result = future.result()
            except BrokenProcessPool:
                continue  # results that were finished before may still follow
            yield futures[future], result
    except BaseException:
        # Also GeneratorExit, if the caller closes the generator: nobody waits for the parts in progress.
        for process in set(active_children()) - children_before:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
