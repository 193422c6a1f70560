"""report.html: one page that needs nothing else - no script, no font, no request - and says the verdict first."""

from __future__ import annotations

from html import escape

from locsnn_compile.report import figures
from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import (
    MANY_ROWS,
    Bar,
    Block,
    Bullets,
    Document,
    Fact,
    Facts,
    Notice,
    Paragraph,
    Plot,
    Report,
    Section,
    Span,
    Stack,
    Table,
    Verdict,
)
from locsnn_compile.report.format import plain
from locsnn_compile.report.html_style import STYLE

_SIGNS = {"yes": "✓", "nearly": "≈", "no": "✗", "unknown": "?", "modelled": "~"}
_MANY_COLUMNS = 7
"""A table with more of them is set smaller."""


def render_html(document: Document) -> str:
    """Return the page of a report; the same document gives the same bytes."""
    report = compose(document)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{text(report.title)} - locsnn-compile report</title>
<style>{STYLE}</style>
</head>
<body>
<a class="skip" href="#main">Skip to the verdict</a>
{figures.patterns()}
<div class="page">
<header>
<p class="eyebrow">locsnn-compile report</p>
<h1>{text(report.title)}</h1>
<p class="subtitle">{text(report.subtitle)}</p>
</header>
<main id="main">
{_verdicts(report)}
{"".join(_notice(notice) for notice in report.notices)}
{_contents(report)}
{"".join(_section(section) for section in report.sections)}
</main>
<footer><p>Per recording means the mean over the recordings of the check, unless a range is given.</p></footer>
</div>
</body>
</html>
"""


def text(value: str) -> str:
    """Return a string safe in text and in quoted attributes."""
    return escape(plain(value))


def _verdicts(report: Report) -> str:
    summary = "".join(f"<p>{text(verdict.sentence)}</p>" for verdict in report.verdicts)
    cards = "".join(_verdict(verdict) for verdict in report.verdicts)
    return (
        f'<section aria-labelledby="verdict"><h2 class="hidden" id="verdict">Verdict</h2>'
        f'<div class="summary">{summary}</div><div class="verdicts">{cards}</div></section>'
    )


def _verdict(verdict: Verdict) -> str:
    return (
        f'<div class="verdict"><h3>{text(verdict.question)}</h3>'
        f'<p class="status {verdict.status}"><i aria-hidden="true">{_SIGNS[verdict.status]}</i>'
        f"<span>{text(verdict.answer)}</span></p>"
        f'<p class="figure">{text(verdict.figure)}</p><p class="figure-label">{text(verdict.figure_label)}</p>'
        f"{_facts(verdict.facts)}</div>"
    )


def _notice(notice: Notice) -> str:
    return f'<div class="notice" role="note"><strong>{text(notice.title)}</strong> {text(notice.text)}</div>'


def _contents(report: Report) -> str:
    links = "".join(f'<li><a href="#{section.key}">{text(section.title)}</a></li>' for section in report.sections)
    return f'<nav aria-label="Sections"><ul>{links}</ul></nav>'


def _section(section: Section) -> str:
    blocks = "".join(_block(block) for block in section.blocks)
    return (
        f'<section class="section" aria-labelledby="{section.key}"><div><h2 id="{section.key}">{text(section.title)}'
        f'</h2><p class="lead">{text(section.lead)}</p></div><div class="blocks">{blocks}</div></section>'
    )


def _block(block: Block) -> str:
    match block:
        case Paragraph():
            return f"<p>{text(block.text)}</p>"
        case Facts():
            return f'<div class="facts">{_facts(block.facts)}</div>'
        case Bullets():
            return _bullets(block)
        case Table():
            return _table(block)
        case Stack():
            return f"<figure><figcaption>{text(block.label)}</figcaption>{figures.stack(block)}</figure>"
        case Span():
            return _span(block)
        case Plot():
            return _plot(block)


def _facts(facts: tuple[Fact, ...]) -> str:
    rows = "".join(f"<div><dt>{text(fact.label)}</dt><dd>{text(fact.value)}</dd></div>" for fact in facts)
    return f"<dl>{rows}</dl>"


def _bullets(block: Bullets) -> str:
    items = "".join(f"<li>{text(item)}</li>" for item in block.items)
    return f'<div class="bullets"><h3>{text(block.title)}</h3><ul>{items}</ul></div>'


def _span(block: Span) -> str:
    facts = "".join(
        f"<div><dt>{figures.mark(fact.label)}{text(fact.label)}</dt><dd>{text(fact.value)}</dd></div>"
        for fact in (block.least, block.median, block.mean, block.most)
    )
    return (
        f"<figure><figcaption>{text(block.title)}</figcaption>{figures.span(block)}"
        f'<dl class="stats">{facts}</dl></figure>'
    )


def _plot(block: Plot) -> str:
    curves = "".join(
        f"<div><dt>{figures.curve_mark(i)}</dt><dd>{text(curve.label)}</dd></div>"
        for i, curve in enumerate(block.curves)
    )
    return (
        f"<figure><figcaption>{text(block.title)}</figcaption>{figures.plot(block)}"
        f'<dl class="curves">{curves}</dl></figure>'
    )


def _table(table: Table) -> str:
    """Return a table. Its roles are spelled out because the narrow layout takes the display types away."""
    heads = "".join(_head(name) for name in table.columns)
    kinds = [] if all(table.columns) else ["barred"]
    if len(table.columns) > _MANY_COLUMNS:
        kinds.append("wide")
    last = len(table.rows) - 1
    body = "".join(_row(table.columns, row, table.total and i == last) for i, row in enumerate(table.rows))
    made = (
        f'<table role="table" class="{" ".join(kinds) or "plain"}"><caption>{text(table.caption)}</caption>'
        f'<thead role="rowgroup"><tr role="row">{heads}</tr></thead><tbody role="rowgroup">{body}</tbody></table>'
    )
    if len(table.rows) <= MANY_ROWS:
        return made
    return f"<details><summary>{text(table.caption)} ({len(table.rows)} rows)</summary>{made}</details>"


def _head(name: str) -> str:
    if name:
        return f'<th scope="col" role="columnheader">{text(name)}</th>'
    return '<th scope="col" role="columnheader" class="drawn"><span class="hidden">drawn</span></th>'


def _row(columns: tuple[str, ...], row: tuple[str | Bar, ...], total: bool) -> str:
    name, *cells = row
    head = name.label if isinstance(name, Bar) else name
    made = "".join(_cell(column, cell) for column, cell in zip(columns[1:], cells, strict=True))
    kind = ' class="total"' if total else ""
    return f'<tr role="row"{kind}><th scope="row" role="rowheader">{text(head)}</th>{made}</tr>'


def _cell(column: str, cell: str | Bar) -> str:
    if isinstance(cell, Bar):
        return f'<td role="cell" class="drawn">{figures.bar(cell)}</td>'
    if not column:
        return '<td role="cell" class="drawn"></td>'
    return f'<td role="cell" data-label="{text(column)}">{text(cell)}</td>'
