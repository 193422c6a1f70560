"""Modules of the tests have names of their own: pytest puts all their folders on one path, and the first one wins."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

TESTS = Path(__file__).parents[1]


def taken_twice(files: Iterable[Path]) -> list[str]:
    """Return names that several modules have; every folder may have a conftest."""
    names = Counter(file.stem for file in files if file.stem not in ("conftest", "__init__"))
    return [name for name, many in names.items() if many > 1]


def test_no_two_modules_share_a_name():
    assert taken_twice(TESTS.rglob("*.py")) == []


def test_a_name_taken_twice_is_told():
    files = (
        "energy/tables.py",
        "results/tables.py",
        "rtl/conftest.py",
        "data/conftest.py",
        "data/text.py",
    )
    assert taken_twice(map(Path, files)) == ["tables"]
