"""Ctrl-C ends a command at once, compiled code included, and leaves nothing half written.

Real processes get a real signal while they are in a loop of compiled code.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
from hw_model.io.files import replace_file
from locsnn_compile.cli import interrupt, shell
from locsnn_compile.cli.main import main

MODEL = Path(__file__).parents[2] / "examples/models/objects-hybrid.pt"
BIN = Path(sys.executable).parent


@pytest.fixture(scope="module")
def endless(tmp_path_factory):
    """A program that spikes everywhere in every step: a recording takes many seconds of compiled code."""
    folder = tmp_path_factory.mktemp("endless")
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    builder.add_input("touch", 1)
    hidden = builder.add_compartments(
        "h", 600, decay_u=4096, decay_v=4096, threshold=0, bias=524160
    )
    builder.connect(
        hidden, hidden, 2 * np.random.default_rng(0).integers(-1, 2, (600, 600)), delay=1
    )
    builder.read_out(hidden)
    builder.build().save(folder)
    # Compile the loops, if need be, before a command is interrupted in them: one recording is played in the
    # main thread, several in other threads.
    for recordings in (1, 2):
        np.save(folder / "short.npy", np.zeros((recordings, 1, 2), dtype=np.uint8))
        assert main(["run", str(folder), "--events", str(folder / "short.npy")]) == 0
    np.save(folder / "one.npy", np.zeros((1, 1, 1_000_000), dtype=np.uint8))
    np.save(folder / "two.npy", np.zeros((2, 1, 1_000_000), dtype=np.uint8))
    return folder


LOADING = 2.5
"""Seconds of the processor that a command takes for its imports once the compiler is loaded, at most."""


def processor_seconds(process):
    """Return the processor time of a process: fields 14 and 15 of /proc/PID/stat, in ticks."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    user, system = (int(field) for field in fields[11:13])
    return (user + system) / os.sysconf("SC_CLK_TCK")


def interrupted(arguments, folder):
    """Start a command, send SIGINT once it computes, and return exit code, output, and seconds from there.

    It computes for as long as it pleases; what it loads before takes less than :data:`LOADING` after the compiler.
    """
    process = subprocess.Popen(
        [BIN / arguments[0], *map(str, arguments[1:])],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    with_compiler: float | None = None
    while process.poll() is None:
        if with_compiler is None and "llvmlite" in Path(f"/proc/{process.pid}/maps").read_text():
            with_compiler = processor_seconds(process)
        if with_compiler is not None and processor_seconds(process) - with_compiler > LOADING:
            break
        time.sleep(0.02)
    assert process.poll() is None, process.communicate()
    start = time.monotonic()
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=60)
    return process.returncode, stdout, stderr, time.monotonic() - start


on_linux = pytest.mark.skipif(
    not Path("/proc/self/maps").exists(), reason="what a process does is read from /proc"
)


@pytest.mark.slow
@on_linux
@pytest.mark.parametrize(
    "recordings", ["one.npy", "two.npy"], ids=["in the main thread", "in other threads"]
)
def test_ctrl_c_ends_compiled_code_at_once(endless, recordings):
    code, stdout, stderr, seconds = interrupted(
        ("locsnn", "run", endless, "--events", endless / recordings), endless
    )
    assert (code, stdout, stderr) == (130, "", "Interrupted.\n")
    assert seconds < 5


@pytest.mark.slow
@on_linux
def test_ctrl_c_leaves_no_build(tmp_path):
    r = np.random.default_rng(0)
    np.save(tmp_path / "many.npy", (r.random((3000, 78, 250)) < 0.05).astype(np.uint8))
    before = sorted(path.name for path in tmp_path.iterdir())
    code, stdout, stderr, seconds = interrupted(
        ("locsnn-compile", MODEL, "--events", "many.npy", "-o", "out"), tmp_path
    )
    assert (code, stdout) == (130, "")
    assert stderr in ("Interrupted.\n", "Interrupted; nothing was written.\n")
    assert seconds < 5
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def without_a_watch(reading_end, command_ended):
    """Take the signal, and do not end the process of the tests a second later."""
    with reading_end:
        reading_end.recv(64)


def run_as_command(run, capsys):
    """Run something as a command; return its exit code and its errors."""
    code = shell.run_guarded(shell.Parser("locsnn"), [], run)
    return code, capsys.readouterr().err


@pytest.mark.parametrize("raised", [ImportError("numpy failed"), SystemError("no exception set")])
def test_ctrl_c_that_a_library_turns_into_another_error_is_an_interrupt(
    raised, capsys, monkeypatch
):
    """As numba's and numpy's modules do while they are imported."""
    monkeypatch.setattr(interrupt, "watch", without_a_watch)

    def run(args):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise raised from None

    assert run_as_command(run, capsys) == (130, "Interrupted; nothing was written.\n")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize(
    ("names", "line"),
    [
        (["a.pt"], "Interrupted; a.pt had been written.\n"),
        (["a.pt", "a.csv"], "Interrupted; a.csv and a.pt had been written.\n"),
        (["1", "2", "3", "4"], "Interrupted; 4 files had been written.\n"),
    ],
)
def test_ctrl_c_tells_what_was_written_before(names, line, tmp_path, capsys):

    def run(args):
        for name in names:
            replace_file(tmp_path / name, b"", "file")
        raise KeyboardInterrupt

    assert run_as_command(run, capsys) == (130, line)
