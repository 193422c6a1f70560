"""No two modules of the tests have the same name.

Pytest puts the folders of all tests on one import path. Of two modules of the same name, both would
get the first.
"""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

TESTS = Path(__file__).parents[1]


def taken_twice(files: Iterable[Path]) -> list[str]:
    """Return the names that several modules have. Every folder may have a conftest and an ``__init__``."""
    names = Counter(file.stem for file in files if file.stem not in ("conftest", "__init__"))
    return [name for name, count in names.items() if count > 1]


def test_no_two_modules_share_a_name():
    assert taken_twice(TESTS.rglob("*.py")) == []


def test_a_name_taken_twice_is_found():
    files = (
        "energy/tables.py",
        "results/tables.py",
        "rtl/conftest.py",
        "data/conftest.py",
        "data/text.py",
    )
    assert taken_twice(map(Path, files)) == ["tables"]
