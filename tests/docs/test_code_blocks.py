"""Every fenced block of README and documentation in ``python`` or ``sh`` runs; other languages mark text.

The blocks of a page run in their order, in a folder that holds ``examples``. A block may have a word after its language:
``slow`` blocks run only with the slow tests, and ``ci`` blocks are not run here, because `.ci/run` does what they say. Fast
tests call the project's own commands within this process. Slow tests run, in a shell, all blocks of a page that has a slow
block. A block in ``console`` shows a command and what it prints, which is compared.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.compile import parser as compile_parser
from locsnn_compile.cli.main import main as locsnn_main
from locsnn_compile.cli.main import parser as locsnn_parser
from tests.support.fences import PAGES, ROOT, Fence, fences, name
from tests.support.real_recordings import REAL, on_real_recordings

BLOCKS = [fence for page in PAGES for fence in fences(page)]
RUN = [fence for fence in BLOCKS if fence.language in ("python", "sh") and "ci" not in fence.words]
"""The blocks that are run, by fast or by slow tests."""
COMMANDS = {"locsnn-compile": compile_main, "locsnn": locsnn_main}
PARSERS = {"locsnn-compile": compile_parser, "locsnn": locsnn_parser}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Make a folder that holds the examples the current one; the commands of this environment are found first."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    return tmp_path


def run_blocks(blocks: list[Fence], run_shell: Callable[[Fence], None]) -> None:
    """Run blocks one after the other, those in Python in one namespace."""
    namespace = {"__name__": "__main__"}
    for block in blocks:
        if block.language == "python":
            # Empty lines above it, so that an error names the line of the page.
            source = "\n" * (block.line - 1) + block.code
            exec(compile(source, name(block.page), "exec"), namespace)
        else:
            run_shell(block)


def in_shell(block: Fence) -> None:
    """Run a block in a shell that stops at the first command that fails."""
    command = ["bash", "-euo", "pipefail", "-c", block.code]
    process = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, (
        f"{block}\n{block.code}\n{process.stdout[-2000:]}{process.stderr[-2000:]}"
    )


def in_process(block: Fence) -> None:
    """Call the commands of a block in this process, which saves the start of Python; else run it in a shell.

    That is possible if all commands are the project's own and none needs the shell, for a pipe or a variable.
    """
    lines = [shlex.split(line, comments=True) for line in block.code.splitlines()]
    are_ours = all(line and line[0] in COMMANDS for line in lines)
    if not are_ours or re.search(r"[|>&;$*\\]", block.code):
        return in_shell(block)
    for program, *arguments in lines:
        assert COMMANDS[program](arguments) == 0, f"{block}\n{program} {shlex.join(arguments)}"


def of_page(page: Path, *, slow: bool) -> list[Fence]:
    """Return the blocks of a page that are run, with or without the slow ones."""
    return [fence for fence in RUN if fence.page == page and (slow or "slow" not in fence.words)]


@pytest.mark.parametrize("page", [page for page in PAGES if of_page(page, slow=False)], ids=name)
def test_the_code_of_a_page_runs(page, folder):
    run_blocks(of_page(page, slow=False), in_process)


@pytest.mark.minutes
@pytest.mark.parametrize(
    "page", sorted({block.page for block in RUN if "slow" in block.words}), ids=name
)
def test_all_code_of_a_page_runs_in_a_shell(page, folder):
    run_blocks(of_page(page, slow=True), in_shell)


@pytest.mark.parametrize("fence", BLOCKS, ids=str)
def test_a_block_names_a_known_language_and_known_words(fence):
    """Otherwise a misspelt block would silently not be run."""
    if re.fullmatch(r"\{[a-z-]+\}", fence.language):
        return  # a directive of the documentation's builder
    allowed = {"python": {"slow"}, "sh": {"slow", "ci"}, "console": set(), "text": set()}
    assert fence.language in allowed
    assert set(fence.words) <= allowed[fence.language]


@pytest.mark.parametrize(
    "fence", [block for block in RUN if block.words and block.language == "sh"], ids=str
)
def test_slow_commands_are_parsed(fence):
    """Fast tests do not run them, but find a misspelt option."""
    for line in fence.code.replace("\\\n", " ").splitlines():
        program, *arguments = shlex.split(line, comments=True) or [""]
        if program in PARSERS:
            PARSERS[program]().parse_args(arguments)


@pytest.mark.parametrize("fence", [fence for fence in BLOCKS if "ci" in fence.words], ids=str)
def test_blocks_of_ci_hold_only_targets_of_make_that_ci_runs(fence):
    targets = re.findall(r"^make ([a-z-]+)", fence.code, flags=re.MULTILINE)
    assert len(targets) == len(fence.code.splitlines())
    scripts = (ROOT / ".ci/run").read_text() + (ROOT / "Makefile").read_text()
    for target in targets:
        assert re.search(rf"(make|\$\(MAKE\)) {target}$", scripts, flags=re.MULTILINE), target


@pytest.mark.minutes
@on_real_recordings
@pytest.mark.parametrize(
    "fence", [fence for fence in BLOCKS if fence.language == "console"], ids=str
)
def test_a_session_prints_what_the_page_shows(fence, folder):
    """The first line is the command, and the lines below are its output, with the archive of the real recordings."""
    (folder / "Ev-Objects.zip").symlink_to(REAL / "Ev-Objects.zip")
    command, shown = fence.code.removeprefix("$ ").split("\n", maxsplit=1)
    process = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert re.fullmatch(pattern_of(shown), process.stdout, re.DOTALL), process.stdout


def pattern_of(shown: str) -> str:
    """Return a regular expression for the output that a page shows: a line ``...`` stands for any lines."""
    return re.escape(shown).replace(re.escape("...\n"), "(.*\n)??")


@pytest.mark.parametrize(
    ("printed", "is_shown"),
    [
        pytest.param("a\nb\nc\n", True, id="one line left out"),
        pytest.param("a\nb\nb\n\nc\n", True, id="several lines left out"),
        pytest.param("a\nb\n", False, id="the end is missing"),
        pytest.param("a\nb\nc\nd\n", False, id="more at the end"),
        pytest.param("a\nbc\n", False, id="a part of a line"),
    ],
)
def test_three_dots_of_a_session_stand_for_whole_lines(printed, is_shown):
    assert bool(re.fullmatch(pattern_of("a\n...\nc\n"), printed, re.DOTALL)) is is_shown
