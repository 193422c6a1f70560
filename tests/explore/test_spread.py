"""Work spread over Dask workers: ``run`` and ``compile`` give the same bytes as on one machine, even if workers die.

Only a few recordings are in memory at a time.
"""

import gc
import io
import os
import signal
import sys
import tracemalloc
from contextlib import redirect_stdout

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main
from locsnn_compile.cluster import spread
from locsnn_compile.cluster.spread import AHEAD, packed, spread_over, unpacked
from locsnn_compile.errors import InputError, TargetError
from tests.support.explored_model import labelled, workers_of

MANY = 70
"""Recordings, in five parts of at most 16: so many are played together."""


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """A file of more recordings than are taken at a time."""
    return labelled(tmp_path_factory.mktemp("many") / "many.npz", seed=3, many=MANY)


@pytest.fixture(scope="module")
def compiled(model, many):
    """The network, compiled and checked on the many recordings."""
    return lc.compile(lc.load(model), events=many, diagnosis=False, strategy="dendrite")


@pytest.fixture(scope="module")
def build(compiled, tmp_path_factory):
    """A folder with the program."""
    folder = tmp_path_factory.mktemp("build") / "small"
    compiled.program.save(folder)
    return folder


def files(folder):
    """Return the bytes of all files in a folder, by path."""
    return {
        path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


@pytest.mark.slow
@pytest.mark.parametrize("options", [(), ("--stop", "proven", "--json")])
def test_run_prints_the_same(build, many, cluster, capsys, options):
    arguments = ["run", str(build), "--events", str(many), *options]
    assert main(arguments) == 0
    printed_here = capsys.readouterr()
    assert main([*arguments, "--scheduler", cluster.scheduler_address]) == 0
    assert capsys.readouterr() == printed_here
    assert (
        f"recording {MANY - 1}" in printed_here.out
        or f'"recording": {MANY - 1}' in printed_here.out
    )


@pytest.mark.slow
def test_compile_writes_the_same(model, many, cluster, tmp_path):
    arguments = [str(model), "--events", str(many), "--quiet", "--min-agreement", "0.1"]
    assert compile_main([*arguments, "-o", str(tmp_path / "here")]) == 0
    assert (
        compile_main(
            [*arguments, "-o", str(tmp_path / "there"), "--scheduler", cluster.scheduler_address]
        )
        == 0
    )
    assert files(tmp_path / "there") == files(tmp_path / "here")


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_loses_nothing(compiled, many, cluster):
    workers, killed, progress_calls = workers_of(cluster), [], []

    def progress(done, total):
        progress_calls.append((done, total))
        if not killed:
            killed.append(workers[0])
            os.kill(workers[0], signal.SIGKILL)

    match = lc.verify(compiled, many, progress=progress, scheduler=cluster.scheduler_address)
    assert vars(match).keys() == vars(compiled.match).keys()
    for name, value in vars(compiled.match).items():
        assert repr(getattr(match, name)) == repr(value), name
    assert killed == workers[:1]
    assert progress_calls == [(16, MANY), (32, MANY), (48, MANY), (64, MANY), (MANY, MANY)]


def test_no_more_is_taken_than_is_under_way(cluster):
    taken = []
    with spread_over(cluster.scheduler_address) as spread:
        for i, result in enumerate(spread(abs, (taken.append(i) or -i for i in range(40)))):
            assert result == i
            threads = 2  # of the fixture ``cluster``
            assert len(taken) <= i + AHEAD * threads
    assert len(taken) == 40


def test_an_error_of_a_worker_is_the_line_it_is_here(build, cluster, tmp_path, capsys):
    np.save(tmp_path / "wide.npy", np.zeros((3, 80, 40), dtype=np.uint8))
    arguments = ["run", str(build), "--events", str(tmp_path / "wide.npy")]
    assert main(arguments) == 2
    printed_here = capsys.readouterr()
    assert main([*arguments, "--scheduler", cluster.scheduler_address]) == 2
    assert capsys.readouterr() == printed_here
    assert printed_here.err.count("\n") == 1


@pytest.mark.parametrize("kind", [InputError, TargetError])
def test_errors_go_to_other_processes(kind):
    error = kind("here", "it fails", measured="1 against 2", fix="Give 2.")
    again = unpacked(packed(error))
    assert (type(again), str(again), vars(again)) == (kind, str(error), vars(error))


@pytest.mark.slow
def test_workers_that_always_die_are_one_line(cluster):
    with pytest.raises(InputError) as caught, spread_over(cluster.scheduler_address) as spread:
        list(spread(os._exit, [1]))
    where = f"--scheduler {cluster.scheduler_address}"
    assert (
        str(caught.value)
        == f"{where}: its workers keep dying. Give them more memory, or fewer recordings."
    )


def commands(build, model, many):
    """Both commands on recordings, by name."""
    return {
        "run": lambda *more: main(["run", str(build), "--events", str(many), *more]),
        "compile": lambda *more: compile_main([str(model), "--events", str(many), *more]),
    }


@pytest.mark.parametrize("command", ["run", "compile"])
def test_a_scheduler_that_does_not_answer(build, model, many, command, monkeypatch, capsys):
    monkeypatch.setattr(spread, "ANSWER_SECONDS", 0.2)
    assert commands(build, model, many)[command]("--scheduler", "tcp://127.0.0.1:9") == 2
    line = "--scheduler tcp://127.0.0.1:9: no scheduler answers (within 0.2 s). Start one with: dask scheduler\n"
    assert capsys.readouterr() == ("", line)


@pytest.mark.parametrize("command", ["run", "compile"])
def test_without_dask(build, model, many, command, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert commands(build, model, many)[command]("--scheduler", "tcp://127.0.0.1:8786") == 2
    line = "--scheduler: it needs distributed, which is not installed. Install it with: pip install 'dask[distributed]'.\n"
    assert capsys.readouterr() == ("", line)


def test_what_is_timed_is_not_spread(build, many, capsys):
    assert (
        main(
            [
                "run",
                str(build),
                "--events",
                str(many),
                "--stream",
                "--scheduler",
                "tcp://127.0.0.1:8786",
            ]
        )
        == 2
    )
    line = "--scheduler: steps are timed on this machine. Leave out --scheduler or --stream.\n"
    assert capsys.readouterr() == ("", line)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """A program of four inputs and two classes."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    touch = builder.add_input("touch", 4)
    out = builder.add_compartments("out", 2, decay_u=4096, threshold=10)
    builder.connect(touch, out, [[20, 4, 0, 0], [0, 0, 8, 40]])
    builder.read_out(out)
    folder = tmp_path_factory.mktemp("tiny") / "tiny"
    builder.build().save(folder)
    return folder


class Nowhere(io.StringIO):
    """Forgets what is written, and collects garbage now and then: what waits for that, up to megabytes, is not held."""

    lines = 0

    def write(self, text):
        self.lines += 1
        if self.lines % 200 == 0:
            gc.collect()
        return len(text)


def most_bytes_held(program, folder, recordings):
    """Most bytes that ``locsnn run`` held at a time, over what was held before."""
    file = folder / f"{recordings}.npy"
    np.save(file, (np.random.default_rng(0).random((recordings, 4, 50)) < 0.1).astype(np.uint8))
    with redirect_stdout(Nowhere()):
        tracemalloc.start()
        try:
            assert main(["run", str(program), "--events", str(file)]) == 0
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("few", "many", "bytes_per_recording"),
    [
        # What waits to be collected varies by a fifth of a megabyte.
        pytest.param(500, 4_000, 120, id="thousands"),
        pytest.param(200, 20_000, 50, id="tens of thousands", marks=pytest.mark.minutes),
    ],
)
def test_memory_does_not_grow_with_recordings(tiny, tmp_path, few, many, bytes_per_recording):
    most_bytes_held(tiny, tmp_path, 32)
    growth = most_bytes_held(tiny, tmp_path, many) - most_bytes_held(tiny, tmp_path, few)
    # A recording has 200 bytes, its line of the result 400.
    assert growth / (many - few) < bytes_per_recording
