"""The table of mutants fits the code: it is run by `make mutants` alone, and must not rot until then."""

from __future__ import annotations

from collections import Counter
from itertools import groupby

import pytest
from mutants import Mutant, file_of, mutants

EVERY = mutants()
BY_MODULE = {
    name: list(part)
    for name, part in groupby(sorted(EVERY, key=lambda m: m.module), key=lambda m: m.module)
}
FIX = "Correct its row in tests/mutants/table, or take it out where what it was a fault of is gone."


@pytest.mark.parametrize("module", BY_MODULE)
def test_every_mutant_is_one_place_of_its_scope_and_another_program(module):
    wrong = []
    for mutant in BY_MODULE[module]:
        try:
            mutant.applied()
        except (ValueError, SyntaxError, OSError) as error:
            wrong.append(f"{error}. {FIX}")
    assert not wrong


def test_there_are_many_and_no_two_are_the_same():
    assert len(EVERY) >= 200
    assert [
        name for name, times in Counter(mutant.name for mutant in EVERY).items() if times > 1
    ] == []


def test_their_tests_are_there():
    """By their file, and by the name of the function where one is named."""
    every = {test for mutant in EVERY for test in mutant.tests}
    named = {test: test.partition("[")[0].partition("::")[2].rpartition("::")[2] for test in every}
    assert [
        test
        for test, name in named.items()
        if name and f"def {name}(" not in file_of(test).read_text()
    ] == []
    assert all(file_of(test).is_file() for test in every)


def test_a_mutant_that_does_not_fit_is_told():
    place = ("hw_model.arithmetic.fixed_point", "clip")
    for old, new, what in (
        ("no such text", "", "found 0 times, not once"),
        ("x", "y", "times, not once"),
        ("return np", "return  np", "is the same program"),
    ):
        with pytest.raises(ValueError, match=what):
            Mutant(*place, old, new, ()).applied()
    with pytest.raises(ValueError, match="gone: 0 functions or classes of that name, not one"):
        Mutant(place[0], "gone", "x", "y", ()).applied()
    with pytest.raises(SyntaxError):
        Mutant(*place, "return np", "return (np", ()).applied()
