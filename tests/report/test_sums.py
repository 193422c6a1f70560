"""Files do not depend on how the version of Python adds: since 3.12, sum() carries what floats lose."""

from __future__ import annotations

import builtins
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.cli.main import main

ROOT = Path(__file__).parents[2]


def sum_of_python_3_11(values, /, start=0):
    """Add one after the other."""
    total = start
    for value in values:
        total = total + value
    return total


def sum_of_python_3_12(values, /, start=0):
    """Add floats with what each addition has lost (Neumaier), as CPython does from 3.12 on, and all else plainly."""
    total, lost = start, 0.0
    for value in values:
        if type(total) is float and type(value) is float:
            together = total + value
            if abs(total) >= abs(value):
                lost += (total - together) + value
            else:
                lost += (value - together) + total
            total = together
        else:
            total = total + value
    return total + lost if lost and math.isfinite(lost) else total


def test_the_two_sums_differ_and_are_those_of_python():
    tenths = [0.1] * 10
    assert sum_of_python_3_11(tenths) == 0.9999999999999999
    assert sum_of_python_3_12(tenths) == 1.0
    assert sum(tenths) in (0.9999999999999999, 1.0)
    assert sum_of_python_3_12([[1], [2]], []) == [1, 2]


LOIHI = ROOT / "examples/models/objects-hybrid-loihi.pt"
EMITTED = ("--emit", "sanafe", "trace", "csv", "viewer")
COMMANDS = {
    "compile": ["compile", LOIHI, "--events", "touches.npz", "-o", "out", *EMITTED],
    "compile for cells": [
        "compile", LOIHI, "--events", "touches.npz", "-o", "out",
        "--target", "locsnn-130nm", "--strategy", "dendrite", "--emit", "rtl",
    ],
    "run": ["run", "build", "--events", "touches.npz", "--stop", "proven"],
}  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working directory, with two of the recordings that ship and a build."""
    monkeypatch.chdir(tmp_path)
    with np.load(ROOT / "examples/recordings/touches.npz") as stored:
        np.savez("touches.npz", spikes=stored["spikes"][:2], step_seconds=stored["step_seconds"])
    compiled = lc.compile(lc.load(LOIHI), events="touches.npz", diagnosis=False)
    compiled.program.save("build")
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_files_and_output_are_the_same_whichever_way_python_adds(
    command, folder, monkeypatch, capsys
):
    results = []
    for way in (sum_of_python_3_11, sum_of_python_3_12):
        with monkeypatch.context() as patched:
            patched.setattr(builtins, "sum", way)
            assert main([*map(str, command)]) == 0
        files = {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in folder.rglob("*")
            if path.is_file()
        }
        results.append((files, capsys.readouterr().out))
        shutil.rmtree("out", ignore_errors=True)
    assert results[0] == results[1]
