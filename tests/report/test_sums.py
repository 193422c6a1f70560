"""The files that commands write do not depend on the version of Python.

Since Python 3.12, ``sum`` of floats compensates for errors of rounding, so it may give other last digits than before.
Both ways to add are written out here, and commands run with each of them in place of ``sum``.
"""

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
    """Add values one after the other."""
    total = start
    for value in values:
        total = total + value
    return total


def sum_of_python_3_12(values, /, start=0):
    """Add floats by Neumaier's algorithm, as CPython does from 3.12 on, and all other values plainly."""
    total = start
    compensation = 0.0
    for value in values:
        if type(total) is float and type(value) is float:
            rounded = total + value
            if abs(total) >= abs(value):
                compensation += (total - rounded) + value
            else:
                compensation += (value - rounded) + total
            total = rounded
        else:
            total = total + value
    if compensation and math.isfinite(compensation):
        return total + compensation
    return total


def test_the_two_sums_differ_and_are_those_of_python():
    tenths = [0.1] * 10
    assert sum_of_python_3_11(tenths) == 0.9999999999999999
    assert sum_of_python_3_12(tenths) == 1.0
    assert sum(tenths) in (0.9999999999999999, 1.0)
    assert sum_of_python_3_12([[1], [2]], []) == [1, 2]


MODEL = ROOT / "examples/models/objects-hybrid-loihi.pt"
EMITTED = ("--emit", "sanafe", "trace", "csv", "viewer")
COMMANDS = {
    "compile": ["compile", MODEL, "--events", "touches.npz", "-o", "out", *EMITTED],
    "compile for cells": [
        "compile", MODEL, "--events", "touches.npz", "-o", "out",
        "--target", "locsnn-130nm", "--strategy", "dendrite", "--emit", "rtl",
    ],
    "run": ["run", "build", "--events", "touches.npz", "--stop", "proven"],
}  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working directory, with two of the shipped recordings in touches.npz and a program in build."""
    monkeypatch.chdir(tmp_path)
    with np.load(ROOT / "examples/recordings/touches.npz") as stored:
        np.savez("touches.npz", spikes=stored["spikes"][:2], step_seconds=stored["step_seconds"])
    compiled = lc.compile(lc.load(MODEL), events="touches.npz", diagnosis=False)
    compiled.program.save("build")
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_files_and_output_are_the_same_whichever_way_python_adds(
    command, folder, monkeypatch, capsys
):
    results = []
    for sum_of_python in (sum_of_python_3_11, sum_of_python_3_12):
        with monkeypatch.context() as patched:
            patched.setattr(builtins, "sum", sum_of_python)
            assert main([*map(str, command)]) == 0
        files = {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in folder.rglob("*")
            if path.is_file()
        }
        results.append((files, capsys.readouterr().out))
        shutil.rmtree("out", ignore_errors=True)
    assert results[0] == results[1]
