"""The examples that ``--help`` shows: every program has one, and it works as it stands."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.fences import ROOT

sys.path.insert(0, str(ROOT / "docs/extensions"))
from command_help import parsers, programs

LIGHT = ("locsnn events", "locsnn targets", "locsnn completion")
"""Programs whose examples take a moment; the others run with the slow tests."""


def examples(program: str) -> list[str]:
    """Return the lines of a help text below ``example:``."""
    shown = re.search(
        r"^examples?:\n((?:  \S.*\n)+)", parsers()[program].format_help(), flags=re.MULTILINE
    )
    return shown[1].splitlines() if shown else []


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a copy of the examples, in which commands may write."""
    folder = tmp_path_factory.mktemp("examples")
    shutil.copytree(ROOT / "examples", folder / "examples")
    return folder


@pytest.fixture(scope="module")
def builds(folder):
    """The builds that examples speak of."""
    run(folder, *examples("locsnn-compile"))
    shutil.copytree(folder / "build/objects-hybrid", folder / "build/objects-hybrid-4bit")


def run(folder, *lines):
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for line in lines:
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", line],
            cwd=folder,
            env={**os.environ, "PATH": path},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{line}\n{done.stderr}"


@pytest.mark.parametrize("program", [program for program in programs() if program != "locsnn"])
def test_help_shows_examples_that_the_parser_takes(program):
    lines = examples(program)
    assert lines
    for line in lines:
        words, called = shlex.split(line.split(" > ")[0]), len(program.split())
        assert " ".join(words[:called]) == program
        parsers()[program].parse_args(words[called:])


@pytest.mark.parametrize("program", LIGHT)
def test_examples_that_take_a_moment_work(program, folder):
    run(folder, *examples(program))


@pytest.mark.minutes
@pytest.mark.parametrize(
    "program", [p for p in programs() if p not in (*LIGHT, "locsnn", "locsnn-compile")]
)
def test_examples_work(program, folder, builds):
    run(folder, *examples(program))
