"""The help text of every program shows at least one example, and the examples work as printed."""

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

FAST = ("locsnn events", "locsnn targets", "locsnn completion")
"""Programs whose examples take a moment; the examples of all others run with the slow tests."""


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
    """Make the two builds that the examples of other programs name."""
    run(folder, *examples("locsnn-compile"))
    # The example of `locsnn diff` compares it with a build of 4 bits; a copy takes its place.
    shutil.copytree(folder / "build/objects-hybrid", folder / "build/objects-hybrid-4bit")


def run(folder, *lines):
    """Run command lines in a folder, each in a shell of its own; all must succeed."""
    # The commands of this environment are found first.
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for line in lines:
        process = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", line],
            cwd=folder,
            env={**os.environ, "PATH": path},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        assert process.returncode == 0, f"{line}\n{process.stderr}"


@pytest.mark.parametrize("program", [program for program in programs() if program != "locsnn"])
def test_help_shows_examples_that_the_parser_takes(program):
    lines = examples(program)
    assert lines
    for line in lines:
        command, _, _ = line.partition(" > ")
        words = shlex.split(command)
        words_of_name = len(program.split())
        assert " ".join(words[:words_of_name]) == program
        parsers()[program].parse_args(words[words_of_name:])


@pytest.mark.parametrize("program", FAST)
def test_examples_that_take_a_moment_work(program, folder):
    run(folder, *examples(program))


@pytest.mark.minutes
@pytest.mark.parametrize(
    "program", [p for p in programs() if p not in (*FAST, "locsnn", "locsnn-compile")]
)
def test_examples_work(program, folder, builds):
    run(folder, *examples(program))
