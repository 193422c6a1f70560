"""Commands that pages name but do not run have names and options that exist.

They stand in code spans and in blocks of text, which `test_code_blocks.py` does not run.
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Iterator

import pytest

from tests.support.fences import PAGES, ROOT, name

sys.path.insert(0, str(ROOT / "docs/extensions"))
from command_help import parsers

OPTIONS_OF_SCRIPTS = {
    "--time-scale-factor",
    "--speed",
    "--only",
    "--dataset",
    "--names",
    "--data",
    "--repeats",
    "--state",
}
"""Options of the scripts in ``tests`` and ``docs/research``, which pages name too."""
OPTIONS = {
    program: {option for action in parser._actions for option in action.option_strings}
    for program, parser in parsers().items()
}


def commands(text: str) -> Iterator[str]:
    """Yield every line of a code block or a code span that starts with one of the project's programs."""
    for code in re.findall(r"`{1,3}(?:text|sh|console)?\n?([^`]+)`", text):
        for line in code.replace("\\\n", " ").splitlines():
            if re.match(r"(\$ )?locsnn(-compile)? ", line):
                yield line.removeprefix("$ ")


def unknown(line: str) -> list[str]:
    """Return what a line names that does not exist: its command, or else its options."""
    words = shlex.split(line, comments=True)
    # The longest name of a program that the line begins with: `locsnn rtl sim` before `locsnn`.
    beginnings = (" ".join(words[:count]) for count in (3, 2, 1))
    program = next((beginning for beginning in beginnings if beginning in OPTIONS), "")
    if program in ("", "locsnn") and len(words) > 1 and not words[1].startswith("-"):
        return [" ".join(words[:2])]
    # Brackets show that an option may be left out; a comma or full stop belongs to the sentence.
    options = (
        word.partition("=")[0].strip("[],.") for word in words if re.match(r"\[?--[a-z]", word)
    )
    return [option for option in options if option not in OPTIONS[program]]


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_commands_and_options_that_a_page_names_exist(page):
    text = page.read_text("utf-8")
    unknown_by_line = {line: unknown(line) for line in commands(text)}
    assert {line: names for line, names in unknown_by_line.items() if names} == {}
    options_without_command = set(re.findall(r"`(--[a-z][a-z-]*)", text))
    known_options = OPTIONS_OF_SCRIPTS.union(*OPTIONS.values())
    assert sorted(options_without_command - known_options) == []


@pytest.mark.parametrize(
    ("line", "unknown_names"),
    [
        ("locsnn-compile a.pt --weight-bits 4", []),
        ("locsnn-compile a.pt --weigth-bits 4", ["--weigth-bits"]),
        ("locsnn rtl place DIR", ["locsnn rtl"]),
        ("locsnn rtl sim DIR --events FILE --fast", ["--fast"]),
        ("locsnn paly DIR", ["locsnn paly"]),
        ("locsnn run DIR [--stop proven]", []),
    ],
)
def test_unknown_commands_and_options_are_found(line, unknown_names):
    assert unknown(line) == unknown_names
