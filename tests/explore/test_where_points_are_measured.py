"""Processes and Dask workers measure the same points as one process, byte for byte, even if they are killed.

Schedulers that are missing, silent or gone, and workers of another version, end in one line.
"""

import logging
import multiprocessing
import os
import signal
import socket
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace
from functools import partial

import distributed
import pytest
from distributed import LocalCluster

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.cluster import spread
from locsnn_compile.cluster.spread import connected, here, packed, spread_over, work_packed
from locsnn_compile.errors import InputError
from locsnn_compile.explore.events import choose_events
from locsnn_compile.explore.point import Point, Study, measure
from locsnn_compile.explore.sweep import Store, sweep
from locsnn_compile.settings import DIALS, settings
from tests.support.explored_model import explore, files_without_timings, narrow, setting, workers_of

GRID = narrow("dendrite", "reset", bits=(2, 4, 6, 8))


@pytest.fixture(scope="module")
def serial(model, events, tmp_path_factory):
    """The files of a run in one process."""
    folder = tmp_path_factory.mktemp("serial") / "out"
    assert explore(model, "--events", events, *GRID, "-o", folder, "--quiet") == 0
    return files_without_timings(folder)


@pytest.fixture(scope="module")
def study(model, events):
    """A study without engines to time, calibrated and checked on the same recordings."""
    network = lc.load(model)
    recordings = choose_events(network, str(events), part=None, bound=None).recordings
    return Study(network, "digest", hw.chip("loihi-sim"), recordings, recordings)


@pytest.fixture(scope="module")
def grid(study):
    """Fourteen settings: two strategies, with every width of weights."""
    neutral = {dial.name: [dial.neutral] for dial in DIALS}
    values = {"strategy": ["dendrite", "reset"], "weight_bits": [1, 2, 3, 4, 5, 6, 8]}
    return settings(study.network, neutral | values, 8)


@pytest.fixture(scope="module")
def points(study, grid, tmp_path_factory):
    """The points of a run in one process."""
    return sweep(study, grid, Store(tmp_path_factory.mktemp("here"), Point), here)


def killed_after(first, pids):
    """A progress callback that kills processes once so many points are finished; and what it killed."""
    killed = []

    def progress(done, total):
        if done >= first and not killed:
            killed.extend(pids())
            for pid in killed:
                os.kill(pid, signal.SIGKILL)

    return progress, killed


def test_a_packed_study_is_the_same(study):
    some_setting = setting("dendrite", 4)
    assert work_packed(packed(partial(measure, study)), packed(some_setting)) == measure(
        study, some_setting
    )


@pytest.mark.slow
def test_processes_find_the_same_bytes(model, events, serial, tmp_path):
    assert (
        explore(model, "--events", events, *GRID, "--workers", 2, "-o", tmp_path / "out", "--quiet")
        == 0
    )
    assert files_without_timings(tmp_path / "out") == serial


@pytest.mark.slow
def test_dask_finds_the_same_bytes(model, events, serial, cluster, tmp_path):
    address = cluster.scheduler_address
    assert (
        explore(
            model,
            "--events",
            events,
            *GRID,
            "--scheduler",
            address,
            "-o",
            tmp_path / "out",
            "--quiet",
        )
        == 0
    )
    assert files_without_timings(tmp_path / "out") == serial


@pytest.mark.slow
def test_a_process_killed_in_the_middle_takes_nothing_along(study, grid, points, tmp_path):
    progress, killed = killed_after(2, lambda: [multiprocessing.active_children()[0].pid])
    with spread_over(address=None, processes=2) as processes:
        assert sweep(study, grid, Store(tmp_path, Point), processes, progress) == points
    assert len(killed) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "many", [1, pytest.param(2, marks=pytest.mark.minutes)], ids=["one of two", "both"]
)
def test_dask_workers_killed_in_the_middle_take_nothing_along(
    study, grid, points, cluster, tmp_path, many
):
    worker_pids = workers_of(cluster)
    progress, killed = killed_after(2, lambda: worker_pids[:many])
    with spread_over(cluster.scheduler_address) as workers:
        assert sweep(study, grid, Store(tmp_path, Point), workers, progress) == points
    assert killed == worker_pids[:many]
    assert len(list(tmp_path.iterdir())) == len(grid)


def test_processes_that_always_die_are_one_error(study, grid, monkeypatch):
    monkeypatch.setattr(spread, "one_pool", lambda *arguments: iter(()))
    with pytest.raises(InputError) as caught, spread_over(address=None, processes=2) as processes:
        list(processes(partial(measure, study), grid[:1]))
    assert str(caught.value) == (
        "--workers 2: its processes die (3 times in a row, 1 setting left). "
        "Give fewer workers, or fewer recordings with --recordings."
    )


def test_without_dask_there_is_a_command_to_install_it(model, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert explore(model, "--scheduler", "tcp://127.0.0.1:8786", "-o", tmp_path / "out") == 2
    line = "--scheduler: it needs distributed, which is not installed. Install it with: pip install 'dask[distributed]'.\n"
    assert capsys.readouterr() == ("", line)


@pytest.mark.parametrize(
    ("address", "line"),
    [
        ("tcp://127.0.0.1:9", "no scheduler answers (within 0.2 s). Start one with: dask scheduler"),
        ("nonsense", "it is not an address: missing port number in address 'nonsense'. Give one such as tcp://127.0.0.1:8786."),
    ],
    ids=["nobody", "no address"],
)  # fmt: skip
def test_schedulers_that_do_not_answer(model, address, line, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(spread, "ANSWER_SECONDS", 0.2)
    assert explore(model, "--scheduler", address, "-o", tmp_path / "out") == 2
    assert capsys.readouterr() == ("", f"--scheduler {address}: {line}\n")


@pytest.mark.parametrize("address", ["nonsense", "tcp://host", "none://host:1"])
def test_no_client_is_made_for_what_is_not_an_address(
    model, address, tmp_path, monkeypatch, capsys
):
    """A client would wait a minute for its end, and print a traceback after the line."""
    monkeypatch.setattr(distributed, "Client", None)
    assert explore(model, "--scheduler", address, "-o", tmp_path / "out") == 2
    assert capsys.readouterr().err.startswith(f"--scheduler {address}: it is not an address: ")


def test_a_scheduler_that_starts_late_is_waited_for():
    with socket.socket() as late:
        late.bind(("127.0.0.1", 0))

        def speak():
            late.listen()
            caller, _ = late.accept()
            with caller:
                caller.sendall(b"\0")

        threading.Timer(0.5, speak).start()
        assert spread.is_answered_at(late.getsockname())


def test_a_service_that_accepts_and_is_silent_is_no_scheduler(model, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(spread, "ANSWER_SECONDS", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        start = time.monotonic()
        assert explore(model, "--scheduler", address, "-o", tmp_path / "out") == 2
        assert time.monotonic() - start < 30
    line = "no scheduler answers (within 0.5 s). Start one with: dask scheduler"
    assert capsys.readouterr() == ("", f"--scheduler {address}: {line}\n")


@pytest.mark.slow
@pytest.mark.parametrize("spoken", [b"\0", (1000).to_bytes(8, "little")], ids=["a byte", "a size"])
def test_a_service_that_speaks_and_stops_is_no_scheduler(
    spoken, model, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(spread, "ANSWER_SECONDS", 1)
    callers = []
    with socket.create_server(("127.0.0.1", 0)) as other:

        def speak():
            with suppress(OSError):  # the test is over
                while True:
                    caller, _ = other.accept()
                    callers.append(caller)
                    caller.sendall(spoken)

        threading.Thread(target=speak, daemon=True).start()
        address = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        start = time.monotonic()
        assert explore(model, "--scheduler", address, "-o", tmp_path / "out") == 2
        assert time.monotonic() - start < 30
    for caller in callers:
        caller.close()
    line = "no scheduler answers (within 1 s). Start one with: dask scheduler"
    assert capsys.readouterr() == ("", f"--scheduler {address}: {line}\n")


class Futures:
    """A client of Dask whose workers come and go.

    ``workers`` has how many there are each time that it is asked; the last number stays.
    """

    def __init__(self, workers, *, code=None):
        self.workers = list(workers)
        self.code = code

    def nthreads(self):
        """Return the threads of each worker."""
        is_last = len(self.workers) == 1
        count = self.workers[0] if is_last else self.workers.pop(0)
        return dict.fromkeys(range(count), 1)

    def submit(self, work, code, *arguments, pure):
        """Return a part that runs later, by the code of the workers."""
        return Future(self, partial(work, self.code or code, *arguments))


class Future:
    """A part that runs as soon as there is a worker."""

    def __init__(self, client, run):
        self.client = client
        self.run = run

    def result(self, timeout):
        """Run the part, or end as a call that waited too long."""
        if self.client.workers[0]:
            return self.run()
        raise TimeoutError


def spread_on(client):
    """The absolute values of -1 and -2, computed by the workers of a client."""
    return list(spread.on_workers(client, "--scheduler x", abs, [-1, -2]))


def test_workers_that_come_back_go_on(monkeypatch):
    monkeypatch.setattr(spread, "PATIENCE_SECONDS", 60)
    assert spread_on(Futures([1, 0, 0, 1])) == [1, 2]


def test_without_any_worker_left_it_ends(monkeypatch):
    monkeypatch.setattr(spread, "PATIENCE_SECONDS", 0.2)
    with pytest.raises(InputError) as caught:
        spread_on(Futures([1, 0]))
    line = "it has no workers left (for 0.2 s). Start some, and the command again."
    assert str(caught.value) == f"--scheduler x: {line}"


def never():
    """Wait like a call to a process that was stopped."""
    threading.Event().wait(60)


def test_a_scheduler_that_stops_in_the_middle_ends_the_job(monkeypatch):
    monkeypatch.setattr(spread, "ANSWER_SECONDS", 0.1)
    monkeypatch.setattr(spread, "PATIENCE_SECONDS", 0.2)
    stopped = Futures([1, 0])
    asked = iter([stopped.nthreads])
    monkeypatch.setattr(stopped, "nthreads", lambda: next(asked, never)())
    stopped.workers[0] = 0
    with pytest.raises(InputError) as caught:
        spread_on(stopped)
    line = "it does not answer any more (for 0.2 s). Start it and the command again."
    assert str(caught.value) == f"--scheduler x: {line}"


@pytest.mark.parametrize("ended", [never, OSError], ids=["silent", "gone"])
def test_a_scheduler_that_stops_before_the_work_is_one_line(ended, monkeypatch):
    def nthreads():
        raise ended() or AssertionError

    stopped = Futures([1])
    monkeypatch.setattr(stopped, "nthreads", nthreads)
    monkeypatch.setattr(spread, "ANSWER_SECONDS", 0.1)
    line = "it does not answer any more (for 0.1 s). Start it and the command again."
    for job in (spread_on, lambda client: spread.wait_for_workers(client, "--scheduler x", "x")):
        with pytest.raises(InputError) as caught:
            job(stopped)
        assert str(caught.value) == f"--scheduler x: {line}"


def test_a_worker_that_is_stopped_before_the_work_is_one_line(cluster, monkeypatch):
    monkeypatch.setattr(spread, "PATIENCE_SECONDS", 0.5)
    worker = workers_of(cluster)[0]
    os.kill(worker, signal.SIGSTOP)
    try:
        with pytest.raises(InputError) as caught, spread_over(cluster.scheduler_address):
            pass
    finally:
        os.kill(worker, signal.SIGCONT)
    line = "a worker does not answer (within 0.5 s). End it, or start it again."
    assert str(caught.value) == f"--scheduler {cluster.scheduler_address}: {line}"


def test_a_worker_of_other_code_that_joins_later_is_refused():
    with pytest.raises(InputError) as caught:
        spread_on(Futures([1], code="9+other"))
    line = "another version of locsnn-compile runs there ({} against 9+other). Install the same one everywhere."
    assert str(caught.value) == f"--scheduler x: {line.format(spread.code_version())}"


def test_another_service_is_no_scheduler(model, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(spread, "ANSWER_SECONDS", 1)
    with socket.create_server(("127.0.0.1", 0)) as other:

        def answer():
            while True:
                try:
                    caller, _ = other.accept()
                except OSError:  # the test is over
                    return
                with caller:
                    caller.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n" * 4)

        threading.Thread(target=answer, daemon=True).start()
        address = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        assert explore(model, "--scheduler", address, "-o", tmp_path / "out") == 2
    assert capsys.readouterr() == (
        "",
        f"--scheduler {address}: no scheduler answers (within 1 s). Start one with: dask scheduler\n",
    )


def test_dask_does_not_log_what_our_errors_say():
    with (
        LocalCluster(n_workers=1, processes=False, dashboard_address=":0") as local_cluster,
        connected(local_cluster.scheduler_address),
    ):
        assert {
            logging.getLogger(name).level for name in ("distributed", "distributed.client")
        } == {logging.CRITICAL}


def test_a_cluster_without_workers(monkeypatch):
    monkeypatch.setattr(spread, "PATIENCE_SECONDS", 0.2)
    with LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=50) as empty:
        address = empty.scheduler_address
        with pytest.raises(InputError) as caught, spread_over(address):
            pass
    assert str(caught.value) == (
        f"--scheduler {address}: it has no workers (within 0.2 s). Start some with: dask worker {address}"
    )


@pytest.fixture
def other_code(monkeypatch):
    """Let this process run another version than its workers, whose version is given."""
    theirs = spread.code_version()
    spread.code_version.cache_clear()
    monkeypatch.setattr(spread, "version", lambda name: "9")
    yield theirs
    spread.code_version.cache_clear()


def test_workers_with_other_code_are_refused(cluster, other_code):
    address = cluster.scheduler_address
    with pytest.raises(InputError) as caught, spread_over(address):
        pass
    message = "another version of locsnn-compile runs there ({} against {}). Install the same one everywhere."
    assert (
        str(caught.value)
        == f"--scheduler {address}: {message.format(other_code, spread.code_version())}"
    )


def test_points_of_other_code_are_not_kept(study, grid, tmp_path):
    def elsewhere(work, settings):
        yield replace(work(settings[0]), code="0+old")

    with pytest.raises(InputError) as caught:
        sweep(study, grid[:1], Store(tmp_path, Point), elsewhere)
    message = "another version of locsnn-compile runs there (0+old against {}). Install the same one everywhere."
    assert str(caught.value) == f"setting {grid[0]}: {message.format(spread.code_version())}"
    assert not list(tmp_path.iterdir())
