"""report.html: one page with the verdict first, and without scripts, fonts or requests."""

import re
from html import escape

from hw_model.texts.pieces import Pieces
from hw_model.texts.templates import filled
from locsnn_compile.report import content
from locsnn_compile.report.format import BEFORE_UNIT, plain, shortened
from locsnn_compile.report.pictures import drawings
from locsnn_compile.report.words import ASSUMED, SIGNS

_MANY_COLUMNS = 7
"""A table with more columns is set smaller."""
_FEW_COLUMNS = 4
"""A table with no more columns fits a phone."""
_LONGEST, _LONGEST_NAME, _LONGEST_NUMBER = 2000, 240, 28
"""Characters at most: of a text, of a name that heads a row, and of a cell that is never wrapped."""
_OPTION = re.compile(r"(?<!\S)--[a-z-]+")
_DRAWN = '<span class="hidden">drawn</span>'
MAX_ROWS = 200
"""A table with more rows is cut: networks may have any number of populations, and programs of cores."""


def render_html(report: content.Report) -> str:
    """Return the page of a report; equal content gives equal bytes."""
    texts = {name: text(getattr(report, name)) for name in ("title", "subtitle", "kind", "footer")}
    parts = {
        name: _PIECES.piece(name, report)
        for name in ("verdicts", "notices", "contents", "sections")
    }
    return filled(__package__, "page.html", patterns=drawings.patterns(), **texts, **parts)


def render_summary(report: content.Report) -> str:
    """Return the three verdicts as a table for a notebook, without a style of its own."""
    return _PIECES.piece("summary", report)


def text(value: str) -> str:
    """Return a string that is safe in text and in quoted attributes; an absurdly long one is cut."""
    return escape(shortened(plain(value), _LONGEST))


def prose(value: str) -> str:
    """Return a string that is safe in text, in which lines break neither before a unit nor within an option."""
    return _OPTION.sub(r"<code>\g<0></code>", BEFORE_UNIT.sub("&nbsp;", text(value)))


def _table(table: content.Table) -> str:
    """Return a table that scrolls within its box if it is wider, by keyboard as well if it may be that wide."""
    last = len(table.rows) - 1
    shown = [*range(min(MAX_ROWS, last)), last] if table.rows else []
    kinds = _column_kinds(table)
    named = zip(table.columns, kinds, strict=True)
    heads = "".join(
        f'<th scope="col"{kind}>{text(name).replace(" %", "&nbsp;%") or _DRAWN}</th>'
        for name, kind in named
    )
    body = "".join(_table_row(kinds, table.rows[i], table.total and i == last) for i in shown)
    look = "plain" if all(table.columns) else "barred"
    look += " wide" if len(table.columns) > _MANY_COLUMNS else ""
    reach = f' tabindex="0" role="region" aria-label="{text(table.caption)}"'
    reached = reach if len(table.columns) > _FEW_COLUMNS else ""
    made = _PIECES.piece("table", table, reached=reached, look=look, heads=heads, body=body)
    many = str(len(table.rows))
    if len(table.rows) <= content.MANY_ROWS and not table.folded:
        return made
    cut = (
        ""
        if len(shown) == len(table.rows)
        else f", {len(shown)} of them shown here, all in report.json"
    )
    return _PIECES.piece("details", table, all=many, cut=cut, made=made)


def _column_kinds(table: content.Table) -> list[str]:
    """Return the class of each column: drawn, of texts, which wrap, or of numbers, which do not."""
    kinds = []
    for i, name in enumerate(table.columns):
        cells = (row[i] for row in table.rows[:MAX_ROWS])
        texts = any(isinstance(cell, str) and len(cell) > _LONGEST_NUMBER for cell in cells)
        kinds.append(' class="words"' if texts and i else "" if name else ' class="drawn"')
    return kinds


def _table_row(kinds: list[str], row: tuple[str | content.Bar, ...], total: bool) -> str:
    name, *cells = row
    head = name.label if isinstance(name, content.Bar) else name
    made = "".join(_cell(kind, cell) for kind, cell in zip(kinds[1:], cells, strict=True))
    line = ' class="total"' if total else ""
    return f'<tr{line}><th scope="row">{_breakable(head)}</th>{made}</tr>'


def _cell(kind: str, cell: str | content.Bar) -> str:
    return f"<td{kind}>{drawings.bar(cell) if isinstance(cell, content.Bar) else text(cell)}</td>"


def _breakable(name: str) -> str:
    """Return a name that may break after underscores and slashes in a narrow column."""
    return text(shortened(name, _LONGEST_NAME)).replace("_", "_<wbr>").replace("/", "/<wbr>")


_DRAWINGS = ("stack", "span", "span_mark", "plot", "curve_mark", "raster", "stroke_mark", "mesh")
_SHOWN = {name: getattr(drawings, name) for name in _DRAWINGS}
_SHOWN |= {"sign": SIGNS.__getitem__, "prose": prose, "table": _table}
_PIECES = Pieces(
    __package__, "pieces.html", text, folded=True, given={"assumed": ASSUMED}, **_SHOWN
)
