"""report.md: the report as text that a code host shows as a page; drawings are left to report.html."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from locsnn_compile.report import content
from locsnn_compile.report.compose import compose
from locsnn_compile.report.format import plain
from locsnn_compile.report.words import ASSUMED
from locsnn_compile.texts.pieces import Pieces

if TYPE_CHECKING:
    from locsnn_compile.verification.excerpt import Excerpt

_SPECIAL = re.compile(r"[\\`*\[\]|~#$]|(?<![^\W_])_|_(?![^\W_])")
"""What Markdown may read as markup anywhere in a line; an underscore inside a word is text."""


def render_markdown(document: content.Document, excerpt: "Excerpt | None" = None) -> str:
    """Return the report as Markdown; the same document and excerpt give the same bytes."""
    return _PIECES.piece("report", compose(document, excerpt)).rstrip("\n") + "\n"


def text(value: str) -> str:
    """Return a string that Markdown and the HTML inside it show as it is, in tables too."""
    escaped = _SPECIAL.sub(lambda found: f"\\{found.group()}", plain(value))
    return escaped.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _table(table: content.Table) -> str:
    """Return the table without its drawn columns, the caption above it."""
    kept = [i for i, name in enumerate(table.columns) if name]
    rows = [[_cell(row[i]) for i in kept] for row in table.rows]
    lines = [line([text(table.columns[i]) for i in kept]), line(["---", *("---:" for _ in kept[1:])])]
    lines += [line(row) for row in rows]
    return f"**{text(table.caption)}**\n\n" + "\n".join(lines)


def _cell(cell: str | content.Bar) -> str:
    return text(cell.label if isinstance(cell, content.Bar) else cell)


def line(cells: Sequence[str]) -> str:
    """Return a row of a table."""
    return f"| {' | '.join(cells)} |"


_PIECES = Pieces(__package__, "pieces.md", text, given={"assumed": ASSUMED}, table=_table)
