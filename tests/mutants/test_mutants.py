"""Faults that are generated are other programs, and what `make mutants` reads is there."""

from __future__ import annotations

import ast

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
"""Messages, annotations and docstrings have none."""


@pytest.fixture
def small(tmp_path):
    (tmp_path / "small.py").write_text(TEXT)
    return tmp_path


def test_the_faults_of_a_small_module(small):
    assert {fault.name.removeprefix("small ") for fault in faults_of("small", small)} == FAULTS


def test_a_fault_changes_its_place_alone(small):
    fault = Fault("small", "within", "2", "3", 0)
    assert fault.applied(small) == TEXT.replace("<< 2", "<< (3)")


def test_equal_places_are_told_apart(tmp_path):
    (tmp_path / "small.py").write_text("def twice(x):\n    return x + 1, x + 1\n")
    places = [f for f in faults_of("small", tmp_path) if f.new == "x - 1"]
    assert [fault.name for fault in places] == [
        "small twice: x + 1 -> x - 1",
        "small twice: x + 1 -> x - 1 (2)",
    ]
    assert places[1].applied(tmp_path) == "def twice(x):\n    return x + 1, (x - 1)\n"


def test_a_fault_that_a_module_does_not_have_is_told(small):
    with pytest.raises(KeyError):
        Fault("small", "within", "x > 4", "x >= 4", 0).applied(small)


@pytest.mark.slow
@pytest.mark.parametrize("module", modules())
def test_every_fault_is_another_program(module):
    faults = modules()[module].faults
    assert faults
    sound = ast.dump(ast.parse(faults[0].path().read_text()))
    # All of them take long: those that `make mutants` plants.
    planted = [fault for fault in faults if fault.is_in(run_mutants.SHARE)]
    same = [f.name for f in planted if ast.dump(ast.parse(f.applied())) == sound]
    assert same == []


def test_a_share_of_all_is_drawn_always_alike():
    faults = [fault for tested in modules().values() for fault in tested.faults]
    drawn = [fault for fault in faults if fault.is_in(run_mutants.SHARE)]
    assert 0.12 < len(drawn) / len(faults) < 0.18
    assert all(fault.is_in(2 * run_mutants.SHARE) for fault in drawn)


def test_their_tests_are_there():
    """By their file, and by the name of the function where one is named."""
    every = {test for tested in modules().values() for test in tested.tests}
    gone = []
    for test in every:
        function = test.partition("[")[0].partition("::")[2].rpartition("::")[2]
        if f"def {function}" not in file_of(test).read_text():
            gone.append(test)
    assert gone == []


def test_reasons_are_of_faults_that_there_are():
    names = {fault.name for tested in modules().values() for fault in tested.faults}
    assert sorted(set(reasons()) - names) == []


def test_a_fault_that_is_told_no_longer_is_a_failure(small, monkeypatch):
    fault = Fault("small", "within", "2", "3", 0)
    monkeypatch.setattr(run_mutants, "TABLE", small / "results.csv")
    run_mutants.write_table({fault: (run_mutants.TOLD, "test_small.py::test_within")})
    assert run_mutants.lost_since({fault: (run_mutants.NOT_TOLD, "")}) == [fault.name]
    assert run_mutants.lost_since({fault: (run_mutants.TOLD, "test_small.py::test_other")}) == []
