"""report.md: the report as text that code hosts show as a page; only report.html has drawings."""

import re
from collections.abc import Sequence

from hw_model.texts.pieces import Pieces
from locsnn_compile.report import content
from locsnn_compile.report.format import plain
from locsnn_compile.report.words import ASSUMED

_SPECIAL = re.compile(r"[\\`*\[\]|~#$]|(?<![^\W_])_|_(?![^\W_])")
"""Characters that Markdown may read as markup anywhere in a line; an underscore inside a word is text."""


def render_markdown(report: content.Report) -> str:
    """Return the report as Markdown; equal content gives equal bytes."""
    return _PIECES.piece("report", report).rstrip("\n") + "\n"


def text(value: str) -> str:
    """Return a string that Markdown, the HTML in it and its tables show unchanged."""
    escaped = _SPECIAL.sub(lambda found: f"\\{found.group()}", plain(value))
    return escaped.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _table(table: content.Table) -> str:
    """Return the table without its drawn columns, below its caption."""
    kept = [i for i, name in enumerate(table.columns) if name]
    rows = [[_cell(row[i]) for i in kept] for row in table.rows]
    lines = [
        line([text(table.columns[i]) for i in kept]),
        line(["---", *("---:" for _ in kept[1:])]),
    ]
    lines += [line(row) for row in rows]
    return f"**{text(table.caption)}**\n\n" + "\n".join(lines)


def _cell(cell: str | content.Bar) -> str:
    return text(cell.label if isinstance(cell, content.Bar) else cell)


def line(cells: Sequence[str]) -> str:
    """Return a row of a table."""
    return f"| {' | '.join(cells)} |"


_PIECES = Pieces(__package__, "pieces.md", text, given={"assumed": ASSUMED}, table=_table)
