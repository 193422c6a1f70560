"""Texts in named pieces: each piece is used, and each that is asked for exists."""

import importlib
import re
from pathlib import Path

import pytest

from hw_model.texts.templates import sections

ROOT = Path(__file__).parents[2]
FILES = {
    "locsnn_compile.report.renderers": ["pieces.html", "pieces.md"],
}
CASES = [(package, file) for package, files in FILES.items() for file in files]


def unused_and_missing(text, pieces, code):
    """Return pieces that nothing names, and pieces that the text asks for and lacks; those of types begin in capitals."""
    asked = set(re.findall(r":(?:each|some|piece) ([\w-]+)", text))
    unused = {
        name
        for name in pieces - asked
        if not (
            name[0].isupper()
            or name == "str"
            or f'"{name}"' in code
            or f'"{name.split()[0]} ' in code
        )
    }
    return unused, asked - pieces


@pytest.mark.parametrize(
    ("package", "file"), CASES, ids=[f"{package}/{file}" for package, file in CASES]
)
def test_every_piece_is_used_and_exists(package, file):
    folder = Path(importlib.import_module(package).__path__[0])
    code = "\n".join(path.read_text("utf-8") for path in folder.glob("*.py"))
    pieces = set(sections(package, file, assumed=""))
    assert unused_and_missing((folder / file).read_text("utf-8"), pieces, code) == (set(), set())


def test_what_is_left_over_or_missing_is_found():
    text = "[page]\n{rows:each row}{end:piece end}\n[row]\n{self}\n[old]\n"
    assert unused_and_missing(text, {"page", "row", "old"}, 'piece("page")') == ({"old"}, {"end"})


def test_no_file_of_pieces_is_left_out():
    found = {
        path.relative_to(ROOT).as_posix()
        for package in ("hw_model", "locsnn_compile")
        for path in (ROOT / package).rglob("*")
        if path.suffix in {".svg", ".html", ".md", ".xml", ".dot", ".graphml", ".txt"}
        and re.search(r"^\[\w+\]$", path.read_text("utf-8"), re.MULTILINE)
    }
    listed = {f"{package.replace('.', '/')}/{file}" for package, file in CASES}
    assert found - {"locsnn_compile/cli/options.txt"} == listed
