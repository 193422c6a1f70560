"""Generated faults change the program, and the tables that `make mutants` reads name tests and faults that exist."""

from __future__ import annotations

import ast
import os
import subprocess
import sys

import pytest
import run_mutants
from faults import Fault, faults_of
from tested import file_of, modules, reasons

TEXT = '''
"""A module."""
LIMIT: int = 4

def within(x, low=0):
    """Tell whether x is within."""
    if not x:
        raise ValueError(f"{x + 1} is not {low - 1}")
    total = max(x, low) + LIMIT
    total += 1
    log(total)
    return low <= total and total << 2 != -low if x > 3 else None
'''
FAULTS = {
    "module: 4 -> 5",
    "within: 0 -> 1",
    "within: not x -> x",
    "within: max(x, low) + LIMIT -> max(x, low) - LIMIT",
    "within: max(x, low) -> min(x, low)",
    "within: total += 1 -> pass",
    "within: 1 -> 2",
    "within: log(total) -> pass",
    "within: low <= total and total << 2 != -low if x > 3 else None -> low <= total and total << 2 != -low",
    "within: low <= total and total << 2 != -low -> total << 2 != -low",
    "within: low <= total and total << 2 != -low -> low <= total",
    "within: low <= total -> low < total",
    "within: total << 2 != -low -> total << 2 == -low",
    "within: total << 2 -> total >> 2",
    "within: 2 -> 3",
    "within: -low -> low",
    "within: x > 3 -> x >= 3",
    "within: 3 -> 4",
}
"""All faults of the module above: messages, annotations and docstrings have none."""


@pytest.fixture
def small(tmp_path):
    """A folder with a module of a few lines."""
    (tmp_path / "small.py").write_text(TEXT)
    return tmp_path


def test_all_faults_of_a_small_module_are_found(small):
    assert {fault.name.removeprefix("small ") for fault in faults_of("small", small)} == FAULTS


def test_a_fault_changes_its_place_alone(small):
    fault = Fault("small", "within", "2", "3", 0)
    assert fault.applied(small) == TEXT.replace("<< 2", "<< (3)")


def test_equal_expressions_are_distinguished_by_number(tmp_path):
    (tmp_path / "small.py").write_text("def twice(x):\n    return x + 1, x + 1\n")
    places = [f for f in faults_of("small", tmp_path) if f.new == "x - 1"]
    assert [fault.name for fault in places] == [
        "small twice: x + 1 -> x - 1",
        "small twice: x + 1 -> x - 1 (2)",
    ]
    assert places[1].applied(tmp_path) == "def twice(x):\n    return x + 1, (x - 1)\n"


def test_a_fault_that_a_module_does_not_have_is_refused(small):
    with pytest.raises(KeyError):
        Fault("small", "within", "x > 4", "x >= 4", 0).applied(small)


@pytest.mark.slow
@pytest.mark.parametrize("module", modules())
def test_every_fault_changes_the_program(module):
    faults = modules()[module].faults
    assert faults
    sound = ast.dump(ast.parse(faults[0].path().read_text()))
    # Only the sample that `make mutants` plants, since all of them take long.
    planted = [fault for fault in faults if fault.is_in(run_mutants.SHARE)]
    same = [f.name for f in planted if ast.dump(ast.parse(f.applied())) == sound]
    assert same == []


def test_a_sample_has_its_size_and_lies_within_a_larger_one():
    faults = [fault for tested in modules().values() for fault in tested.faults]
    drawn = [fault for fault in faults if fault.is_in(run_mutants.SHARE)]
    # The share is 0.15; a hash of names meets it only roughly.
    assert 0.12 < len(drawn) / len(faults) < 0.18
    assert all(fault.is_in(2 * run_mutants.SHARE) for fault in drawn)


def test_the_tests_that_modules_yaml_names_exist():
    """An entry is the name of a file, or of a file and a function."""
    entries = {test for tested in modules().values() for test in tested.tests}
    missing = []
    for entry in entries:
        function = entry.partition("[")[0].partition("::")[2].rpartition("::")[2]
        if f"def {function}" not in file_of(entry).read_text():
            missing.append(entry)
    assert missing == []


def test_reasons_belong_to_faults_that_exist():
    names = {fault.name for tested in modules().values() for fault in tested.faults}
    assert sorted(set(reasons()) - names) == []


def test_compiled_loops_play_a_program_as_plain_python():
    """In a process of its own, since the plugin replaces functions for good."""
    folders = (run_mutants.ROOT, run_mutants.HERE)
    options = ["-q", "-n0", "-p", "no:cacheprovider", "-p", "interpreted"]
    tests = [str(file_of("test_semantics.py")), "-k", "acts_at_step and fast"]
    process = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *tests],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, folders))},
        cwd=run_mutants.ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stdout + process.stderr


def test_a_fault_that_no_test_detects_any_more_is_a_failure(small, monkeypatch):
    fault = Fault("small", "within", "2", "3", 0)
    monkeypatch.setattr(run_mutants, "TABLE", small / "results.csv")
    run_mutants.write_table({fault: (run_mutants.TOLD, "test_small.py::test_within")})
    assert run_mutants.lost_since({fault: (run_mutants.NOT_TOLD, "")}) == [fault.name]
    assert run_mutants.lost_since({fault: (run_mutants.TOLD, "test_small.py::test_other")}) == []
