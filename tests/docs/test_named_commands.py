"""Commands that pages name but do not run, in lines and in blocks of text: their names and options exist."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Iterator

import pytest

from tests.support.fences import PAGES, ROOT, name

sys.path.insert(0, str(ROOT / "docs/extensions"))
from command_help import parsers

OF_SCRIPTS = {
    "--time-scale-factor",
    "--speed",
    "--only",
    "--dataset",
    "--names",
    "--data",
    "--repeats",
}
"""Options of the scripts in ``tests``, which pages name as well."""
OPTIONS = {
    program: {option for action in parser._actions for option in action.option_strings}
    for program, parser in parsers().items()
}


def commands(text: str) -> Iterator[str]:
    """Return every line of code or of a code span that starts with one of our programs."""
    for code in re.findall(r"`{1,3}(?:text|sh|console)?\n?([^`]+)`", text):
        for line in code.replace("\\\n", " ").splitlines():
            if re.match(r"(\$ )?locsnn(-compile)? ", line):
                yield line.removeprefix("$ ")


def unknown(line: str) -> list[str]:
    """Return the command of a line, if there is none of that name, or its options that do not exist."""
    words = shlex.split(line, comments=True)
    program = next((called for n in (3, 2, 1) if (called := " ".join(words[:n])) in OPTIONS), "")
    if program in ("", "locsnn") and len(words) > 1 and not words[1].startswith("-"):
        return [" ".join(words[:2])]
    given = (
        word.partition("=")[0].strip("[],.") for word in words if re.match(r"\[?--[a-z]", word)
    )
    return [option for option in given if option not in OPTIONS[program]]


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_what_a_page_names_exists(page):
    text = page.read_text("utf-8")
    assert [(line, found) for line in commands(text) if (found := unknown(line))] == []
    alone = (
        set(re.findall(r"`(--[a-z][a-z-]*)", text)) - set().union(*OPTIONS.values()) - OF_SCRIPTS
    )
    assert sorted(alone) == []


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("locsnn-compile a.pt --weight-bits 4", []),
        ("locsnn-compile a.pt --weigth-bits 4", ["--weigth-bits"]),
        ("locsnn rtl place DIR", ["locsnn rtl"]),
        ("locsnn rtl sim DIR --events FILE --fast", ["--fast"]),
        ("locsnn paly DIR", ["locsnn paly"]),
        ("locsnn run DIR [--stop proven]", []),
    ],
)
def test_what_does_not_exist_is_found(line, found):
    assert unknown(line) == found
