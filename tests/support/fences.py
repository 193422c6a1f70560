"""The pages of the documentation, and the fenced code blocks and links in them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "examples").rglob("*.md")),
]


@dataclass(frozen=True)
class Fence:
    """A fenced code block.

    ``line`` is the number of its first line of code; ``words`` are those that follow the language on the fence.
    """

    page: Path
    line: int
    language: str
    words: tuple[str, ...]
    code: str

    def __str__(self):
        return f"{name(self.page)}:{self.line}"


def name(page: Path) -> str:
    """Return a page's path from the root of the project."""
    return page.relative_to(ROOT).as_posix()


def fences(page: Path) -> list[Fence]:
    """Return the fenced blocks of a page, in order."""
    blocks: list[Fence] = []
    lines: list[str] = []
    opening: re.Match[str] | None = None
    for number, line in enumerate(page.read_text("utf-8").splitlines(), start=1):
        if opening is None:
            opening = re.match(r"(?P<mark>`{3,}|~{3,})(?P<info>.*)$", line)
            lines = []
        elif line.rstrip() == opening["mark"]:
            language, *words = opening["info"].split() or [""]
            first_line = number - len(lines)
            code = "\n".join(lines) + "\n"
            blocks.append(Fence(page, first_line, language, tuple(words), code))
            opening = None
        else:
            lines.append(line)
    assert opening is None, f"{name(page)} ends within a fence"
    return blocks


def without_fences(text: str) -> str:
    """Return the text of a page without its fenced blocks."""
    return re.sub(r"^(`{3,}).*?^\1\s*$", "", text, flags=re.DOTALL | re.MULTILINE)


def prose(page: Path) -> str:
    """Return a page without its fenced blocks and code spans, since brackets in code are not links."""
    text = without_fences(page.read_text("utf-8"))
    return re.sub(r"(`+)(?!`).+?(?<!`)\1(?!`)", "", text)


LINK = re.compile(r"\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)")


def links(page: Path) -> list[str]:
    """Return the targets of a page's links and pictures that are within the project."""
    return [target for target in LINK.findall(prose(page)) if not re.match(r"[a-z]+:", target)]
