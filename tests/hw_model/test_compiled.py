"""What is kept of compiled loops is thrown away when any loop they hold has changed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import hw_model.engine.compiled

PACKAGE = Path(hw_model.__file__).parent
USER = """\
from hw_model.engine.compiled import compiled
from hw_model.engine.lane_arithmetic import wrap

@compiled
def wrapped(x):
    return wrap(x, 1 << 23)
"""


def name_of(path):
    return path.relative_to(PACKAGE).with_suffix("").as_posix()


def test_all_files_with_loops_are_named():
    holds = re.compile(r"^@(compiled|inner|absorbed|intrinsic|kernel)|intrinsic", re.MULTILINE)
    found = {name_of(path) for path in PACKAGE.rglob("*.py") if holds.search(path.read_text())}
    constants = {"engine/compiled", "engine/layout", "arithmetic/fixed_point"}
    assert found | constants == set(hw_model.engine.compiled.FILES_OF_LOOPS)


def run(folder, *, limits="true", **environment):
    """Run a loop of a copy of the package in a process, and return what it gives."""
    if not (folder / "user.py").exists():
        shutil.copytree(PACKAGE, folder / "hw_model", ignore=shutil.ignore_patterns("__pycache__"))
        (folder / "user.py").write_text(USER)
    python = f"{sys.executable} -c 'import numpy, user; print(user.wrapped(numpy.int32(2**24 + 5)))'"
    given = {key: value for key, value in os.environ.items() if key not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    given |= {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"} | environment
    done = subprocess.run(
        ["bash", "-c", f"{limits}; {python}"], cwd=folder, env=given, capture_output=True, text=True, timeout=100
    )
    assert (done.returncode, done.stderr) == (0, "")
    return int(done.stdout)


def kept_in(folder):
    """Return the folders below one that hold compiled code."""
    return {path.parent.relative_to(folder).parts[0] for path in folder.rglob("*.nbi")}


def test_a_change_in_another_file_is_seen(tmp_path):
    cache = str(tmp_path / "cache")
    assert run(tmp_path, NUMBA_CACHE_DIR=cache) == 5
    source = tmp_path / "hw_model/engine/lane_arithmetic.py"
    source.write_text(source.read_text().replace("fit(((x & (2 * half - 1)) ^ half) - half, x)", "x"))
    assert run(tmp_path, NUMBA_CACHE_DIR=cache) == 2**24 + 5


def no_folder_of_its_own(folder):
    """Let nothing be written next to the functions, not even by root."""
    folder.mkdir()
    (folder / "__pycache__").write_text("a file")


@pytest.mark.parametrize(
    ("writable", "place"),
    [
        (("named", "own", "home"), "named"),
        (("own", "home"), "__pycache__"),
        (("home",), "home"),
        ((), None),
    ],
    ids=["the named folder", "next to the function", "the user's", "nowhere"],
)
def test_code_is_kept_in_the_first_folder_that_can_be_written(tmp_path, writable, place):
    package = tmp_path / "package"
    if "own" not in writable:
        no_folder_of_its_own(package)
    package.mkdir(exist_ok=True)
    home = package / "home" if "home" in writable else "/proc/self/home"
    named = package / "named" if "named" in writable else "/proc/self/named"
    for _ in range(2):
        assert run(package, HOME=str(home), NUMBA_CACHE_DIR=str(named)) == 5
    assert kept_in(package) == ({place} if place else set())


def test_where_there_is_no_room_for_code_it_is_used_and_not_kept(tmp_path):
    """No file may be larger than nothing."""
    assert run(tmp_path, limits="ulimit -f 0", NUMBA_CACHE_DIR=str(tmp_path / "cache")) == 5
    assert not any(path.stat().st_size for path in (tmp_path / "cache").rglob("*.nb?"))
