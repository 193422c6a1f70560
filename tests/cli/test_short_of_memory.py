"""Limits on memory and processor time, inherited from the shell (``ulimit``), and too little memory.

A good file is never called damaged because of them, and the exit code is 2.
"""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hw_model.engine import usable
from hw_model.errors import InputError
from hw_model.io import memory
from hw_model.io.files import parsing
from locsnn_compile.cli import shell
from locsnn_compile.data import event_formats

resource = pytest.importorskip("resource", reason="Windows has no such limits")
ROOT = Path(__file__).parents[2]
MODEL = ROOT / "examples/models/objects-hybrid.pt"
CAMERA = ROOT / "tests/data/camera.aedat4"
LIMITED = "memory: there is too little (1 MiB for this process). Raise the limit, as with ulimit -v, or give fewer recordings.\n"
OUT_OF_TIME = "processor time: there is too little (2 s for this process). Raise the limit, as with ulimit -t, or give fewer recordings.\n"
UNLIMITED = "memory: there is too little (no room for 9 TB). Give fewer recordings, or free some.\n"

# By id: an error of a command, the limit on memory in bytes (None: no limit), and the line on standard error.
FAULTS = {
    "an array": (MemoryError("no room for 9 TB"), None, UNLIMITED),
    "an array, within a limit": (MemoryError("no room for 9 TB"), 1 << 20, LIMITED),
    "a process": (OSError(errno.ENOMEM, "Cannot allocate memory"), 1 << 20, LIMITED),
    "a library": (OSError("Could not load libllvmlite.so"), 1 << 20, LIMITED),
    "a module": (ImportError("failed to map segment from shared object"), 1 << 20, LIMITED),
    "a thread": (RuntimeError("can't start new thread"), 1 << 20, LIMITED),
    "a broken import": (SystemError("error return without exception set"), 1 << 20, LIMITED),
}


def run_as_command(run):
    """Run a function as a command is run, which turns errors into a line and an exit code."""
    return shell.run_guarded(shell.Parser("locsnn"), [], run)


@pytest.mark.parametrize(("fault", "limit", "line"), FAULTS.values(), ids=FAULTS)
def test_too_little_memory_is_one_line(fault, limit, line, monkeypatch, capsys):
    monkeypatch.setattr(memory, "memory_limit", lambda: limit)

    def run(args):
        raise fault

    assert run_as_command(run) == 2
    assert capsys.readouterr() == ("", line)


@pytest.mark.parametrize("fault", [ImportError("no module"), RuntimeError("a defect")])
def test_with_enough_memory_a_defect_is_shown_as_it_is(fault):
    def run(args):
        raise fault

    with pytest.raises(type(fault), match=str(fault)):
        run_as_command(run)


@pytest.mark.parametrize(("limit", "raised"), [(None, InputError), (1 << 20, MemoryError)])
def test_a_good_file_is_not_damaged_where_memory_runs_out(limit, raised, monkeypatch):
    monkeypatch.setattr(memory, "memory_limit", lambda: limit)
    with pytest.raises(raised), parsing("file 'x'", "it is damaged", fix="Write it again."):
        raise MemoryError


@pytest.mark.parametrize(
    "message", ["a.so: failed to map segment from shared object", "b.so: cannot allocate memory"]
)
def test_a_library_that_finds_no_room_is_too_little_memory_with_much_left(message, monkeypatch):
    """The largest, torch's, wants more than all others together."""
    assert not memory.lacks_memory(ImportError(message))
    monkeypatch.setattr(memory, "memory_limit", lambda: 1 << 50)
    assert memory.lacks_memory(ImportError(message))
    assert not memory.lacks_memory(ImportError("no module"))


limits = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limits")


@pytest.mark.slow
@limits
@pytest.mark.parametrize("limit", ["ulimit -v 4000000", "ulimit -t 4", "ulimit -v 1500000 -t 4"])
def test_files_are_read_within_inherited_limits(limit, tmp_path):
    """Children of the process lower their limits; they cannot raise what they inherit."""
    h5py = pytest.importorskip("h5py")
    pytest.importorskip("aedat")
    with h5py.File(tmp_path / "few.h5", "w") as file:
        file["spikes"] = np.ones((2, 3, 20), dtype=np.uint8)
    for path, recordings in ((tmp_path / "few.h5", 2), (CAMERA, 1)):
        command = f'{limit}; exec "$0" -m locsnn_compile events "$1"'
        process = subprocess.run(
            ["bash", "-c", command, sys.executable, path],
            env=os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert (process.returncode, process.stderr) == (0, "")
        assert process.stdout.startswith(f"{path.name}")
        assert f"{recordings} recording" in process.stdout


def within(limit, *command):
    """Run a command within a limit of the shell; return its exit code, output and errors."""
    process = subprocess.run(
        ["bash", "-c", f'{limit}; exec "$0" -m locsnn_compile "$@"', sys.executable, *command],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    return process.returncode, process.stdout, process.stderr


@limits
@pytest.mark.parametrize(
    ("limit", "command", "line"),
    [
        ("-v 102400", ("events", CAMERA), "memory: there is too little (100 MiB for this process against 192 MiB). Raise the limit, as with ulimit -v."),
        ("-v 460800", ("compile", MODEL), "memory: there is too little (450 MiB for this process against 768 MiB). Raise the limit, as with ulimit -v."),
        ("-t 1", ("events", CAMERA), "processor time: there is too little (1 s for this process against 2 s). Raise the limit, as with ulimit -t."),
    ],
    ids=["reading", "playing", "time"],
)  # fmt: skip
def test_a_limit_that_would_end_a_library_is_refused_before_it_is_loaded(limit, command, line):
    """numpy's OpenBLAS ends the process, scipy's tries again without end, and the system kills without a word."""
    assert within(f"ulimit {limit}", *command) == (2, "", f"{line}\n")


def test_loops_are_not_loaded_where_a_limit_leaves_no_room_for_them(monkeypatch):
    monkeypatch.setattr(memory, "memory_limit", lambda: 700 << 20)
    monkeypatch.setattr(memory, "_address_space_bytes", lambda: 310 << 20)
    usable.why_not_compiled.cache_clear()
    with pytest.raises(InputError) as caught:
        usable.why_not_compiled()
    line = "memory: there is too little (700 MiB for this process against 710 MiB). Raise the limit, as with ulimit -v."
    assert str(caught.value) == line


BUSY = {
    "Python": "while True: pass",
    "code in C, which hears of no signal": "import hashlib; hashlib.pbkdf2_hmac('md5', b'', b'', 1 << 30)",
}


@pytest.mark.slow
@limits
@pytest.mark.parametrize("busy", BUSY.values(), ids=BUSY)
def test_a_command_whose_processor_time_ends_says_so(busy):
    script = (
        "import sys; from locsnn_compile.cli import shell\n"
        f"def run(args):\n    {busy}\n"
        "sys.exit(shell.run_guarded(shell.Parser('locsnn'), [], run))"
    )
    process = subprocess.run(
        ["bash", "-c", 'ulimit -t 2; exec "$0" -c "$1"', sys.executable, script],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (process.returncode, process.stdout, process.stderr) == (2, "", OUT_OF_TIME)


@limits
def test_the_processor_time_of_a_process_is_as_before_after_a_command(monkeypatch):
    inherited = (1 << 20, 1 << 20)
    monkeypatch.setattr(resource, "getrlimit", lambda kind: inherited)
    limits_set = []
    monkeypatch.setattr(resource, "setrlimit", lambda kind, limits: limits_set.append(limits))
    assert run_as_command(lambda args: 0) == 0
    assert limits_set == [((1 << 20) - 1, 1 << 20), inherited]
    assert signal.getsignal(signal.SIGXCPU) is signal.SIG_DFL


@pytest.mark.slow
@limits
@pytest.mark.parametrize(
    ("own", "inherited", "answer"), [(5, [1], b"\2"), (1, [], b"\0")], ids=["inherited", "its own"]
)
def test_a_file_is_not_damaged_where_the_inherited_time_ends(own, inherited, answer, monkeypatch):
    h5py = pytest.importorskip("h5py")
    from locsnn_compile.data.hdf5 import probe, read

    def busy(*given):
        while True:
            pass

    monkeypatch.setattr(probe, "CPU_SECONDS", own)
    monkeypatch.setattr(
        probe, "inherited_limits", lambda kind: inherited * (kind == resource.RLIMIT_CPU)
    )
    monkeypatch.setattr(h5py, "File", busy)
    assert bytes([probe.outcome(b"")]) == answer

    prober = SimpleNamespace(send_bytes=lambda data: None, recv_bytes=lambda: answer)
    monkeypatch.setattr(read, "start_prober", lambda owner: prober)
    monkeypatch.setattr(read, "answers", {})
    monkeypatch.setattr(read, "processor_seconds", lambda: 2)
    if inherited:
        with pytest.raises(InputError) as caught:
            read.library_survives(b"")
        assert f"{caught.value}\n" == OUT_OF_TIME
    else:
        assert not read.library_survives(b"")


@pytest.mark.parametrize("code", [-9, -24])
def test_a_camera_file_is_not_damaged_where_the_inherited_time_ends(code, monkeypatch):
    monkeypatch.setattr(event_formats, "processor_seconds", lambda: 2)
    with pytest.raises(InputError) as caught:
        event_formats.check_child_was_free(code)
    assert f"{caught.value}\n" == OUT_OF_TIME
    for seconds in (None, 10):
        monkeypatch.setattr(event_formats, "processor_seconds", lambda many=seconds: many)
        event_formats.check_child_was_free(code)
