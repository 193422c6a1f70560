"""Read ``modules.yaml``: the modules in which faults are planted, and the tests that should detect them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import yaml
from faults import ROOT, Fault, faults_of

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Tested:
    """A module and its tests, each a file or a file and a function. Those likeliest to detect a fault come first.

    - ``loops``: the module holds compiled loops, which run as plain Python while it has a fault
    - ``compiled``: its tests compile the module with its fault
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
    """Return the entries of ``modules.yaml``, by module."""
    table = yaml.safe_load((HERE / "modules.yaml").read_text())
    by_module = {}
    for module, row in table["modules"].items():
        tests = list(row.get("tests", ()))
        if row.get("engine_tests"):
            tests += table["engine_tests"]
        by_module[module] = Tested(
            module,
            tuple(tests),
            loops=row.get("loops", False),
            compiled=row.get("compiled", False),
        )
    return by_module


@cache
def reasons() -> dict[str, str]:
    """Return the faults that change no result, by name, each with the reason why: ``changes-nothing.yaml``."""
    rows = yaml.safe_load((HERE / "changes-nothing.yaml").read_text())
    return dict(rows or {})


@cache
def file_of(test: str, root: Path = ROOT) -> Path:
    """Return the file of an entry. No two files of tests have the same name, so entries need no folder."""
    files = sorted((root / "tests").rglob(test.split("::")[0]))
    if len(files) != 1:
        raise ValueError(f"{test}: {len(files)} files of that name, not one")
    return files[0]
