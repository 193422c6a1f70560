"""The reference pages hold every public name and command, and the help that they show is what commands print."""

from __future__ import annotations

import re
import sys

import pytest

import hw_model
import locsnn_compile
from tests.support.fences import ROOT

sys.path.insert(0, str(ROOT / "docs/extensions"))
from command_help import help_of, programs

PAGE = (ROOT / "docs/reference/command-line.md").read_text("utf-8")


@pytest.mark.parametrize(
    "package", [hw_model, locsnn_compile], ids=lambda package: package.__name__
)
def test_every_public_name_is_in_the_reference(package):
    page = (ROOT / "docs/reference/python.md").read_text("utf-8")
    # From the heading of the package to that of the next.
    section = page.split(f"\n## {package.__name__}\n")[1].split("\n## ")[0]
    shown = set(
        re.findall(r"^\.\. auto(?:class|exception|function):: (\w+)$", section, flags=re.MULTILINE)
    )
    # The errors are hw_model's; locsnn_compile exports them again, and its section only names them.
    reexported = (
        {"InputError", "LocsnnError", "TargetError"} if package is locsnn_compile else set()
    )
    assert shown == set(package.__all__) - reexported
    for name in reexported:
        assert f"`{name}`" in section


def test_every_command_is_in_the_reference():
    assert re.findall(r"^## (.*)$", PAGE, flags=re.MULTILINE) == programs()
    assert re.findall(r"^```\{command-help\} (.*)$", PAGE, flags=re.MULTILINE) == programs()


@pytest.mark.parametrize("program", programs())
def test_the_reference_shows_what_help_prints(program, capsys, monkeypatch):
    from locsnn_compile.cli.compile import main as compile_main
    from locsnn_compile.cli.main import main as locsnn_main

    monkeypatch.setenv("COLUMNS", "100")
    command, *names = program.split()
    with pytest.raises(SystemExit):
        {"locsnn-compile": compile_main, "locsnn": locsnn_main}[command]([*names, "--help"])
    assert help_of(program) == capsys.readouterr().out
