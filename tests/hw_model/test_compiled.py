"""What is kept of compiled loops is thrown away when any loop they hold has changed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

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
    holds = re.compile(r"^@(compiled|inner|absorbed|inlined|intrinsic)", re.MULTILINE)
    found = {name_of(path) for path in PACKAGE.rglob("*.py") if holds.search(path.read_text())}
    constants = {"engine/compiled", "engine/layout", "arithmetic/fixed_point"}
    assert found | constants == set(hw_model.engine.compiled.FILES_OF_LOOPS)


def test_a_change_in_another_file_is_seen(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "hw_model", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "user.py").write_text(USER)
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def run() -> int:
        command = [sys.executable, "-c", "import numpy, user; print(user.wrapped(numpy.int32(2**24 + 5)))"]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=100)
        assert done.returncode == 0, done.stderr
        return int(done.stdout)

    assert run() == 5
    source = tmp_path / "hw_model/engine/lane_arithmetic.py"
    source.write_text(source.read_text().replace("fit(((x & (2 * half - 1)) ^ half) - half, x)", "x"))
    assert run() == 2**24 + 5
