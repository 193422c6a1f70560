"""Limits that a process inherits, and too little memory: a good file stays good, and the exit code is 2."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hw_model.errors import InputError
from hw_model.io import memory
from hw_model.io.files import parsing
from locsnn_compile.cli import shell

ROOT = Path(__file__).parents[2]
CAMERA = ROOT / "tests/data/camera.aedat4"
LIMITED = "memory: there is too little (1 MiB for this process). Raise the limit, as with ulimit -v, or give fewer recordings.\n"
UNLIMITED = "memory: there is too little (no room for 9 TB). Give fewer recordings, or free some.\n"

FAULTS = {
    "an array": (MemoryError("no room for 9 TB"), None, UNLIMITED),
    "an array, within a limit": (MemoryError("no room for 9 TB"), 1 << 20, LIMITED),
    "a process": (OSError(errno.ENOMEM, "Cannot allocate memory"), 1 << 20, LIMITED),
    "a library": (OSError("Could not load libllvmlite.so"), 1 << 20, LIMITED),
    "a module": (ImportError("failed to map segment from shared object"), 1 << 20, LIMITED),
    "a thread": (RuntimeError("can't start new thread"), 1 << 20, LIMITED),
    "a broken import": (SystemError("error return without exception set"), 1 << 20, LIMITED),
}


def guarded(run):
    return shell.guarded(shell.Parser("locsnn"), [], run)


@pytest.mark.parametrize(("fault", "limit", "line"), FAULTS.values(), ids=FAULTS)
def test_too_little_memory_is_one_line(fault, limit, line, monkeypatch, capsys):
    monkeypatch.setattr(memory, "memory_limit", lambda: limit)

    def run(args):
        raise fault

    assert guarded(run) == 2
    assert capsys.readouterr() == ("", line)


@pytest.mark.parametrize("fault", [ImportError("no module"), RuntimeError("a defect")])
def test_with_enough_memory_a_defect_is_shown_as_it_is(fault):
    def run(args):
        raise fault

    with pytest.raises(type(fault), match=str(fault)):
        guarded(run)


@pytest.mark.parametrize(("limit", "raised"), [(None, InputError), (1 << 20, MemoryError)])
def test_a_good_file_is_not_damaged_where_memory_runs_out(limit, raised, monkeypatch):
    monkeypatch.setattr(memory, "memory_limit", lambda: limit)
    with pytest.raises(raised), parsing("file 'x'", "it is damaged", fix="Write it again."):
        raise MemoryError


limits = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limits")


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
        done = subprocess.run(
            ["bash", "-c", command, sys.executable, path],
            env=os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.startswith(f"{path.name}")
        assert f"{recordings} recording" in done.stdout
