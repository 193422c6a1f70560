"""report.md: the report as text that a code host shows as a page; drawings are left to report.html."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from locsnn_compile.report import content
from locsnn_compile.report.compose import compose
from locsnn_compile.report.format import plain
from locsnn_compile.report.words import ASSUMED

if TYPE_CHECKING:
    from locsnn_compile.verification.excerpt import Excerpt

_SPECIAL = re.compile(r"[\\`*\[\]|~#$]|(?<![^\W_])_|_(?![^\W_])")
"""What Markdown may read as markup anywhere in a line; an underscore inside a word is text."""


def render_markdown(document: content.Document, excerpt: "Excerpt | None" = None) -> str:
    """Return the report as Markdown; the same document and excerpt give the same bytes."""
    report = compose(document, excerpt)
    parts = [f"# {text(report.title)}", text(report.subtitle)]
    parts += [_verdict(verdict) for verdict in report.verdicts]
    if report.assumptions:
        parts.append("\n".join((f"**{text(ASSUMED)}**\n", *(f"- {text(one)}" for one in report.assumptions))))
    parts += [f"> **{text(notice.title)}** {text(notice.text)}" for notice in report.notices]
    for section in report.sections:
        parts += [f"## {text(section.title)}", text(section.lead)]
        parts += [made for block in section.blocks if (made := _block(block))]
    return "\n\n".join(parts) + "\n"


def text(value: str) -> str:
    """Return a string that Markdown and the HTML inside it show as it is, in tables too."""
    escaped = _SPECIAL.sub(lambda found: f"\\{found.group()}", plain(value))
    return escaped.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _verdict(verdict: content.Verdict) -> str:
    head = f"**{text(verdict.question)} {text(verdict.answer)}.** {text(verdict.sentence)}"
    return f"{head}\n\n{_facts(verdict.facts)}"


def _block(block: content.Block) -> str:
    match block:
        case str():
            return text(block)
        case content.Facts():
            return _facts(block.facts)
        case content.Bullets():
            return f"{text(block.title)}:\n\n" + "\n".join(f"- {text(item)}" for item in block.items)
        case content.Table():
            return _table(block)
        case content.Span():
            return f"{text(block.title)}:\n\n{_facts(block.facts)}"
        case content.Mesh():
            return text(f"{block.title}: {block.description}.")
        case content.Stack() | content.Plot() | content.Raster():
            return ""  # a table of the section has the same figures


def _facts(facts: tuple[content.Fact, ...]) -> str:
    return "\n".join(f"- {text(fact.label)}: {text(fact.value)}" for fact in facts)


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
