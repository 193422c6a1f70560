"""Options and fixtures of the benchmarks: ``pytest tests/benchmarks -m bench [--quick] [--results FOLDER]``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]

Record = Callable[[str, Any], None]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--quick", action="store_true", help="few rounds and small sizes: does it run, not how fast"
    )
    parser.addoption(
        "--results", type=Path, default=ROOT / "build/bench", help="folder for what is measured"
    )


@pytest.fixture(scope="session")
def quick(pytestconfig: pytest.Config) -> bool:
    """Whether to run each benchmark only briefly."""
    return bool(pytestconfig.getoption("--quick"))


@pytest.fixture(scope="session")
def record(pytestconfig: pytest.Config) -> Record:
    """Return a function that writes measured figures to a file of a name, from which ``write_page.py`` makes the pages."""
    folder: Path = pytestconfig.getoption("--results")
    folder.mkdir(parents=True, exist_ok=True)

    def write(name: str, figures: Any) -> None:
        (folder / f"{name}.json").write_text(json.dumps(figures, indent=1) + "\n")

    return write
