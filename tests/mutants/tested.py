"""The modules in which faults are planted, and the tests that ought to tell them: ``modules.yaml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import yaml
from faults import ROOT, Fault, faults_of

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Tested:
    """A module and its tests, by file or by file and function; the likeliest to tell a fault come first.

    - ``loops``: it holds compiled loops, which are interpreted while it is faulty
    - ``compiled``: its tests compile the faulty module
    """

    module: str
    tests: tuple[str, ...]
    loops: bool = False
    compiled: bool = False

    @property
    def faults(self) -> list[Fault]:
        """All faults of the module."""
        return faults_of(self.module)


@cache
def modules() -> dict[str, Tested]:
    """Return what is tested, by module."""
    table = yaml.safe_load((HERE / "modules.yaml").read_text())
    found = {}
    for module, row in table["modules"].items():
        tests = list(row.get("tests", ()))
        if row.get("engine_tests"):
            tests += table["engine_tests"]
        found[module] = Tested(
            module,
            tuple(tests),
            loops=row.get("loops", False),
            compiled=row.get("compiled", False),
        )
    return found


@cache
def reasons() -> dict[str, str]:
    """Return why faults change nothing that anyone could see, by their names: ``changes-nothing.yaml``."""
    rows = yaml.safe_load((HERE / "changes-nothing.yaml").read_text())
    return dict(rows or {})


@cache
def file_of(test: str, root: Path = ROOT) -> Path:
    """Return the file of tests of that name."""
    found = sorted((root / "tests").rglob(test.split("::")[0]))
    if len(found) != 1:
        raise ValueError(f"{test}: {len(found)} files of that name, not one")
    return found[0]
