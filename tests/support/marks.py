"""Which cases of a table every run of the tests takes."""

from collections.abc import Iterable, Mapping
from typing import Any

import pytest


def first_quick(cases: Iterable[Any], many: int = 1) -> list[Any]:
    """Return the cases of a table, all but the first ``many`` of them marked slow."""
    return [case if at < many else slow(case) for at, case in enumerate(cases)]


def sampled(faults: Mapping[str, tuple[Any, ...]], every: int = 4) -> list[Any]:
    """Return planted faults, by their names, as cases: one in ``every`` is slow, the others are for ``make mutants``."""
    marks = pytest.mark.minutes, pytest.mark.mutants
    return [
        pytest.param(*its, id=name, marks=marks[at % every > 0])
        for at, (name, its) in enumerate(faults.items())
    ]


def slow(case: Any) -> Any:
    """Return a case, one value or a tuple of several, marked slow."""
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.minutes)
