"""A job in parts, run in this process, in others on this machine, or on workers of a Dask cluster with the same code.

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


@cache
def code_version() -> str:
    """Return the version of the package and a digest of its sources, which also change between releases."""
    digest = hashlib.sha256()
    for folder in (Path(hw_model.__file__).parent, Path(__file__).parents[1]):
        for path in sorted(folder.rglob("*")):
            if path.suffix in _SUFFIXES:
                content = path.read_bytes()
                digest.update(
                    f"{path.relative_to(folder.parent).as_posix()}\n{len(content)}\n".encode()
                    + content
                )
    try:
        number = version(PACKAGE)
    except PackageNotFoundError:  # run from its sources
        number = "0"
    return f"{number}+{digest.hexdigest()[:12]}"


def check_code(where: str, code: str, wanted: str | None = None) -> None:
    """Refuse results of other code than is wanted, by default this."""
    what, fix = "another version of locsnn-compile runs there", "Install the same one everywhere."
    check_same(code, wanted or code_version(), where, what, fix=fix)


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
    """Return bytes to send to another process; recordings are mostly zeros, and shrink a hundredfold."""
    return zlib.compress(pickle.dumps(value))


@lru_cache(maxsize=2)
def unpacked(content: bytes) -> Any:
    """Return what :func:`packed` was given in one of our processes; it is kept for the next part of the job."""
    return pickle.loads(zlib.decompress(content))


def work_packed(work: bytes, part: bytes) -> Any:
    """Run a part that another process sent; ``work``, which all parts share, is unpacked once."""
    return unpacked(work)(unpacked.__wrapped__(part))


def work_of_version(code: str, where: str, work: bytes, part: bytes) -> Any:
    """Run a part on a worker, which may have joined long after the start, if it runs this code."""
    check_code(where, code_version(), code)
    return work_packed(work, part)


ANSWER_SECONDS, PATIENCE_SECONDS = 10, 30
"""How long to wait for the scheduler, and for a worker: the first one, and again whenever none is left."""
GLANCE_SECONDS = 1.0
"""How often it is looked for workers while a result is waited for."""
AHEAD = 2
"""Parts in progress per thread of the cluster, so the next one is there when one is done."""


def on_workers(
    client: Any, where: str, work: Callable[[Part], Result], parts: Iterable[Part], /
) -> Generator[Result, None, None]:
    """Run parts on the workers of a ``distributed.Client``, a few at a time; ``where`` is how errors name it.

    If a worker dies, Dask runs its part again, but only a few times.
    """
    # The work is sent with every part; if it were sent to workers beforehand, it would be lost with them.
    job = packed(work)
    threads = _ask(where, client.nthreads)
    most = AHEAD * max(1, sum(threads.values()))
    send = partial(client.submit, work_of_version, code_version(), where, job, pure=False)
    waiting = deque[Any]()
    distributed = sys.modules["distributed"]
    try:
        for part in parts:
            waiting.append(send(packed(part)))
            if len(waiting) == most:
                yield _result(client, where, waiting.popleft())
        while waiting:
            yield _result(client, where, waiting.popleft())
    except distributed.KilledWorker:
        raise InputError(
            where, "its workers keep dying", fix="Give them more memory, or fewer recordings."
        ) from None
    except distributed.CancelledError:
        raise InputError(where, "it was lost", fix="Start it and the command again.") from None
    except (AttributeError, ModuleNotFoundError) as error:  # what is sent is not known there
        what, fix = (
            "another version of locsnn-compile runs there",
            "Install the same one everywhere.",
        )
        raise InputError(where, what, measured=str(error), fix=fix) from None


def _result(client: Any, where: str, future: Any) -> Any:
    """Wait for a result as long as there are workers; without any for :data:`PATIENCE_SECONDS`, give up."""
    seen = time.monotonic()
    while True:
        with suppress(TimeoutError):
            return future.result(timeout=GLANCE_SECONDS)
        what, fix = "it has no workers left", "Start some, and the command again."
        try:
            if _within(ANSWER_SECONDS, client.nthreads):
                seen = time.monotonic()
        except Exception:  # of many kinds: the scheduler is silent, or the connection is broken
            what, fix = "it does not answer any more", "Start it and the command again."
        if time.monotonic() - seen > PATIENCE_SECONDS:
            measured = f"for {PATIENCE_SECONDS} s"
            raise InputError(where, what, measured=measured, fix=fix)


def _within(seconds: float, ask: Callable[[], Result]) -> Result:
    """Return what a call gives, or raise what it raises.

    ``TimeoutError`` if it takes too long: it then goes on in a thread for which nothing waits.
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
    """Return what a scheduler that has answered before says within :data:`ANSWER_SECONDS`; ``InputError`` without."""
    try:
        return _within(ANSWER_SECONDS, ask)
    except OSError:  # its connections end with these, and so does waiting
        measured, fix = f"for {ANSWER_SECONDS} s", "Start it and the command again."
        what = "it does not answer any more"
        raise InputError(where, what, measured=measured, fix=fix) from None


@contextmanager
def spread_over(address: str | None, processes: int | None = None) -> Iterator[Spread]:
    """Give what runs the parts of a job: the cluster of a scheduler, processes of this machine, or this process."""
    if address is None:
        yield partial(_in_processes, processes) if processes else here
        return
    with connected(address) as client:
        yield partial(on_workers, client, f"--scheduler {address}")


def is_answered_at(place: tuple[str, int], *, speaks_first: bool = True) -> bool:
    """Tell whether something at a host and port answers within :data:`ANSWER_SECONDS`.

    A scheduler speaks first, unless by TLS. With a service that accepts and is silent, a client waits for minutes.
    """
    deadline = time.monotonic() + ANSWER_SECONDS
    while time.monotonic() < deadline:
        with suppress(OSError), socket.create_connection(place, 1) as connection:
            connection.settimeout(max(0.1, deadline - time.monotonic()))
            if not speaks_first or connection.recv(1):
                return True
        time.sleep(0.1)
    return False


def _client(distributed: Any, address: str) -> Any:
    """Return a ``distributed.Client`` of a scheduler; ``TimeoutError`` where none speaks."""
    # A client that finds nobody ends with a traceback, after three times as long.
    within = address.startswith("inproc://")  # a scheduler in this process has no port
    if not within:
        place = distributed.comm.addressing.get_address_host_port(address)
        if not is_answered_at(place, speaks_first=not address.startswith("tls://")):
            raise TimeoutError
    return distributed.Client(address, timeout=ANSWER_SECONDS, set_as_default=False)


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Connect a ``distributed.Client`` to a scheduler with a worker or more, all running this code."""
    distributed = needed("distributed", "dask", "--scheduler")
    # What it would log when a scheduler is lost, in dozens of lines, is one of the errors below.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    where = f"--scheduler {address}"
    try:
        # Its own limit does not cover a service that speaks a few bytes and stops.
        client = _within(ANSWER_SECONDS, partial(_client, distributed, address))
    except ValueError as error:
        fix = "Give one such as tcp://127.0.0.1:8786."
        raise InputError(where, f"it is not an address: {error}", fix=fix) from None
    except (
        OSError,
        MemoryError,
    ):  # the answer of another service is taken for the size of a message
        fix = "Start one with: dask scheduler"
        raise InputError(
            where, "no scheduler answers", measured=f"within {ANSWER_SECONDS} s", fix=fix
        ) from None
    try:
        wait_for_workers(client, where, address)
        _check_workers(client, where)
        yield client
    finally:
        with suppress(Exception):  # nobody is there any more
            _within(ANSWER_SECONDS, client.close)


def wait_for_workers(client: Any, where: str, address: str) -> None:
    """Wait until a scheduler has a worker; ``InputError`` after :data:`PATIENCE_SECONDS` without."""
    deadline = time.monotonic() + PATIENCE_SECONDS
    while not _ask(where, client.nthreads):
        if time.monotonic() > deadline:
            measured = f"within {PATIENCE_SECONDS} s"
            fix = f"Start some with: dask worker {address}"
            raise InputError(where, "it has no workers", measured=measured, fix=fix)
        time.sleep(0.1)


def _check_workers(client: Any, where: str) -> None:
    """Refuse workers that run other code, and those that do not say which."""
    try:
        codes = _within(PATIENCE_SECONDS, partial(client.run, code_version))
    except ImportError as error:
        fix = "Install it there."
        raise InputError(
            where, "a worker has no locsnn-compile", measured=str(error), fix=fix
        ) from None
    except OSError:
        what, measured = "a worker does not answer", f"within {PATIENCE_SECONDS} s"
        fix = "End it, or start it again."
        raise InputError(where, what, measured=measured, fix=fix) from None
    for code in codes.values():
        check_code(where, code)


INTERRUPTS = signal.SIGINT, signal.SIG_IGN
"""Ctrl-C is left to the parent of the processes."""
ATTEMPTS = 3
"""Pools of processes that may die in a row without finishing a part."""


def _in_processes(
    workers: int, work: Callable[[Part], Result], parts: Iterable[Part], /
) -> Generator[Result, None, None]:
    """Run parts in that many processes of this machine; results come in any order."""
    job, left = packed(work), dict(enumerate(map(packed, parts)))
    attempts = ATTEMPTS
    while left and attempts:
        attempts -= 1
        for number, result in one_pool(workers, job, left):
            del left[number]
            attempts = ATTEMPTS
            yield result
    if left:
        measured = f"{ATTEMPTS} times in a row, {counted(len(left), 'setting')} left"
        fix = "Give fewer workers, or fewer recordings with --recordings."
        raise InputError(f"--workers {workers}", "its processes die", measured=measured, fix=fix)


def one_pool(workers: int, job: bytes, parts: Mapping[int, bytes]) -> Iterator[tuple[int, Any]]:
    """Yield the results of a pool, until the end or until one of its processes dies, which ends the pool."""
    before = set(active_children())
    # Forking may hang, because the engine has threads.
    pool = ProcessPoolExecutor(
        workers, mp_context=get_context("spawn"), initializer=signal.signal, initargs=INTERRUPTS
    )
    try:
        futures = {pool.submit(work_packed, job, part): number for number, part in parts.items()}
        for future in as_completed(futures):
            try:
                result = future.result()
            except BrokenProcessPool:
                continue
            yield futures[future], result
    except BaseException:
        # Interrupted or abandoned: nobody waits for the parts in progress.
        for process in set(active_children()) - before:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
