"""Which cases of a table every run of the tests takes."""

from collections.abc import Iterable
from typing import Any

import pytest


def first_quick(cases: Iterable[Any], many: int = 1) -> list[Any]:
    """Return the cases of a table, all but the first ``many`` of them marked slow."""
    return [case if at < many else slow(case) for at, case in enumerate(cases)]


def slow(case: Any) -> Any:
    """Return a case, one value or a tuple of several, marked slow."""
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)
