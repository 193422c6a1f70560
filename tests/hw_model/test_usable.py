"""Without a supported numba, programs run on the plain engine with one warning, and sessions are refused in one line.

Each case runs in a process with a stand-in for numba.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from hw_model.engine import usable

ROOT = Path(__file__).parents[2]
PLAYS = """\
import numpy as np, hw_model as hw
builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
x = builder.add_input("x", 1)
y = builder.add_compartments("y", 1, decay_u=4096, decay_v=4096, threshold=1)
builder.connect(x, y, np.full((1, 1), 2))
builder.read_out(y)
program = builder.build()
for _ in range(2):
    print(hw.simulate(program, np.ones((3, 1), dtype=np.uint8)).spikes["y"].ravel().tolist())
try:
    hw.Session(program)
except hw.InputError as error:
    print(error)
"""
PLAYED = "[0, 1, 1]\n"
"""By hand: the spikes of rows 0 and 1 act at steps 1 and 2, each with 2 * 64 against a threshold of 1 * 64."""
NO_PART = """\
from numba.core.caching import Cache
del Cache._load_overload
"""


def plays(folder, numba=None, sitecustomize="", **environment):
    """Simulate a program in a process, and return its stdout and stderr."""
    if numba is not None:
        (folder / "numba").mkdir()
        (folder / "numba/__init__.py").write_text(numba)
    (folder / "sitecustomize.py").write_text(sitecustomize)
    process = subprocess.run(
        [sys.executable, "-c", PLAYS],
        env=os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"} | environment,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert process.returncode == 0, process.stderr
    return process.stdout, process.stderr


def config(version):
    """Return the source of a numba that has nothing but a version."""
    return f"import types\n__version__ = {version!r}\nconfig = types.SimpleNamespace(DISABLE_JIT=0)"


# The stand-in, the reason in the warning, and the way out.
REFUSED = {
    "too old, which crashes": (
        {"numba": config("0.61.2")},
        "numba 0.61.2 is not >=0.62,<0.69",
        "Install numba >=0.62,<0.69.",
    ),
    "newer than any that was tried": (
        {"numba": config("0.69.0rc1")},
        "numba 0.69.0rc1 is not >=0.62,<0.69",
        "Install numba >=0.62,<0.69.",
    ),
    "a numpy that numba does not know": (
        {"numba": "raise ImportError('Numba needs NumPy 2.4 or less. Got NumPy 2.9.')"},
        "numba cannot be imported: Numba needs NumPy 2.4 or less. Got NumPy 2.9",
        "Install numba >=0.62,<0.69.",
    ),
    "without a part that is used": (
        {"sitecustomize": NO_PART},
        "numba {version} has no numba.core.caching.Cache._load_overload",
        "Install numba >=0.62,<0.69.",
    ),
    "not to compile": ({"NUMBA_DISABLE_JIT": "1"}, "NUMBA_DISABLE_JIT is set", "Unset it."),
}


@pytest.mark.slow
@pytest.mark.parametrize(("stand_in", "reason", "fix"), REFUSED.values(), ids=REFUSED)
def test_without_a_supported_numba_the_plain_engine_runs_and_warns_once(
    stand_in, reason, fix, tmp_path
):
    import numba

    reason = reason.format(version=numba.__version__)
    line = "engine 'fast': the plain one plays instead, about a hundred times slower"
    refused = f"compiled loops: they are needed here ({reason}). {fix}\n"
    assert plays(tmp_path, **stand_in) == (PLAYED * 2 + refused, f"{line} ({reason}). {fix}\n")


@pytest.mark.minutes
def test_a_supported_numba_is_used(tmp_path):
    assert plays(tmp_path) == (PLAYED * 2, "")


def test_the_project_requires_the_supported_releases_of_numba():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert f"numba{usable.supported()}" in project["dependencies"]
