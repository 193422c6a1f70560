"""Mark cases of a parametrised test as slow, so that quick runs take only some of them."""

from collections.abc import Iterable, Mapping
from typing import Any

import pytest


def first_quick(cases: Iterable[Any], many: int = 1) -> list[Any]:
    """Return the cases, all except the first ``many`` of them marked slow."""
    cases = list(cases)
    return [*cases[:many], *(slow(case) for case in cases[many:])]


def sampled(faults: Mapping[str, tuple[Any, ...]], every: int = 4) -> list[Any]:
    """Return planted faults as cases with their names as ids.

    One in ``every`` is a slow test; the others run only with ``make mutants``.
    """
    cases = []
    for number, (name, arguments) in enumerate(faults.items()):
        mark = pytest.mark.minutes if number % every == 0 else pytest.mark.mutants
        cases.append(pytest.param(*arguments, id=name, marks=mark))
    return cases


def slow(case: Any) -> Any:
    """Return a case, one value or a tuple of several, marked slow."""
    arguments = case if isinstance(case, tuple) else (case,)
    return pytest.param(*arguments, marks=pytest.mark.minutes)
