"""report.html: one page that needs nothing else - no script, no font, no request - and says the verdict first."""

from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING

from locsnn_compile.report import content
from locsnn_compile.report.compose import compose
from locsnn_compile.report.format import plain, shortened
from locsnn_compile.report.pictures import drawings
from locsnn_compile.report.templates import filled
from locsnn_compile.report.words import ASSUMED, SIGNS

if TYPE_CHECKING:
    from locsnn_compile.verification.excerpt import Excerpt

_MANY_COLUMNS = 7
"""A table with more of them is set smaller."""
_FEW_COLUMNS = 4
"""A table with no more of them fits a phone."""
_LONGEST, _LONGEST_NAME, _LONGEST_NUMBER = 2000, 240, 28
"""Characters of a text, of a name at the head of a row, and of a cell that is not folded."""
_DRAWN = '<span class="hidden">drawn</span>'
MAX_ROWS = 200
"""A table with more of them is cut: a network may have any number of populations, and a program of cores."""


def render_html(document: content.Document, excerpt: "Excerpt | None" = None) -> str:
    """Return the page of a report; the same document and excerpt give the same bytes."""
    footer = "Per recording means the mean over the recordings of the check, unless a range is given."
    return render_page(compose(document, excerpt), "locsnn-compile report", footer)


def render_page(report: content.Report, kind: str, footer: str) -> str:
    """Return a page of this content; ``kind`` stands above its title, ``footer`` at its end."""
    return filled(
        __package__,
        "page.html",
        title=text(report.title),
        subtitle=text(report.subtitle),
        kind=text(kind),
        patterns=drawings.patterns(),
        verdicts=_verdicts(report),
        notices="".join(_notice(notice) for notice in report.notices),
        contents=_contents(report),
        sections="".join(_section(section) for section in report.sections),
        footer=text(footer),
    )


def render_summary(document: content.Document) -> str:
    """Return the three verdicts as a table for a notebook, without a style of its own."""
    report = compose(document)
    rows = "".join(
        f"<tr><th>{SIGNS[one.status]} {text(one.question)} {text(one.answer)}</th><td>{text(one.sentence)}</td></tr>"
        for one in report.verdicts
    )
    return f"<p><strong>{text(report.title)}</strong><br>{text(report.subtitle)}</p><table>{rows}</table>"


def text(value: str) -> str:
    """Return a string safe in text and in quoted attributes; one that is absurdly long, cut."""
    return escape(shortened(plain(value), _LONGEST))


def _verdicts(report: content.Report) -> str:
    summary = "".join(f"<p>{text(verdict.sentence)}</p>" for verdict in report.verdicts)
    cards = "".join(_verdict(verdict) for verdict in report.verdicts)
    return (
        f'<section aria-labelledby="verdict"><h2 class="hidden" id="verdict">Verdict</h2>'
        f'<div class="summary">{summary}</div>{_assumptions(report.assumptions)}'
        f'<div class="verdicts">{cards}</div></section>'
    )


def _verdict(verdict: content.Verdict) -> str:
    return (
        f'<div class="verdict"><h3>{text(verdict.question)}</h3>'
        f'<p class="status {verdict.status}"><i aria-hidden="true">{SIGNS[verdict.status]}</i>'
        f"<span>{text(verdict.answer)}</span></p>"
        f'<p class="figure">{text(verdict.figure)}</p><p class="figure-label">{text(verdict.figure_label)}</p>'
        f"{_facts(verdict.facts)}</div>"
    )


def _assumptions(sentences: tuple[str, ...]) -> str:
    if not sentences:
        return ""
    return f'<div class="notice" role="note"><strong>{text(ASSUMED)}</strong>{_list(map(text, sentences))}</div>'


def _notice(notice: content.Notice) -> str:
    return f'<div class="notice" role="note"><strong>{text(notice.title)}</strong> {text(notice.text)}</div>'


def _contents(report: content.Report) -> str:
    links = (f'<a href="#{section.key}">{text(section.title)}</a>' for section in report.sections)
    return f'<nav aria-label="Sections">{_list(links)}</nav>'


def _list(items: Iterable[str]) -> str:
    """Return a list of items, which are markup already."""
    return f"<ul>{''.join(f'<li>{item}</li>' for item in items)}</ul>"


def _section(section: content.Section) -> str:
    blocks = "".join(_block(block) for block in section.blocks)
    return (
        f'<section class="section" aria-labelledby="{section.key}"><div><h2 id="{section.key}">{text(section.title)}'
        f'</h2><p class="lead">{text(section.lead)}</p></div><div class="blocks">{blocks}</div></section>'
    )


def _block(block: content.Block) -> str:
    match block:
        case str():
            return f"<p>{text(block)}</p>"
        case content.Facts():
            return f'<div class="facts">{_facts(block.facts)}</div>'
        case content.Bullets():
            return f'<div class="bullets"><h3>{text(block.title)}</h3>{_list(map(text, block.items))}</div>'
        case content.Table():
            return _table(block)
        case content.Stack():
            return _figure(block.label, drawings.stack(block))
        case content.Span():
            facts = ((drawings.mark(fact.label) + text(fact.label), fact.value) for fact in block.facts)
            return _figure(block.title, drawings.span(block), f'<dl class="stats">{_rows(facts)}</dl>')
        case content.Plot():
            curves = ((drawings.curve_mark(i), curve.label) for i, curve in enumerate(block.curves))
            return _figure(block.title, drawings.plot(block), f'<dl class="curves">{_rows(curves)}</dl>')
        case content.Raster():
            strokes = ((drawings.stroke_mark(one.kind), one.label) for one in block.strokes)
            return _figure(block.title, drawings.raster(block), f'<dl class="curves">{_rows(strokes)}</dl>')
        case content.Mesh():
            return _figure(block.title, drawings.mesh(block), f'<p class="said">{text(block.description)}</p>')


def _figure(title: str, drawn: str, below: str = "") -> str:
    return f"<figure><figcaption>{text(title)}</figcaption>{drawn}{below}</figure>"


def _facts(facts: tuple[content.Fact, ...]) -> str:
    return f"<dl>{_rows((text(fact.label), fact.value) for fact in facts)}</dl>"


def _rows(entries: Iterable[tuple[str, str]]) -> str:
    """Return rows of a list: each entry is a name, which is markup already, and its value."""
    return "".join(f"<div><dt>{name}</dt><dd>{text(value)}</dd></div>" for name, value in entries)


def _table(table: content.Table) -> str:
    """Return a table that scrolls inside its place where it is wider; by keyboard, too, where that may be."""
    last = len(table.rows) - 1
    shown = [*range(min(MAX_ROWS, last)), last] if table.rows else []
    kinds = _column_kinds(table)
    named = zip(table.columns, kinds, strict=True)
    heads = "".join(f'<th scope="col"{kind}>{text(name) or _DRAWN}</th>' for name, kind in named)
    body = "".join(_table_row(kinds, table.rows[i], table.total and i == last) for i in shown)
    look = ["plain"] if all(table.columns) else ["barred"]
    if len(table.columns) > _MANY_COLUMNS:
        look.append("wide")
    caption = text(table.caption)
    reached = f' tabindex="0" role="region" aria-label="{caption}"' if len(table.columns) > _FEW_COLUMNS else ""
    made = (
        f'<div class="scroll"{reached}><table class="{" ".join(look)}"><caption><span>{caption}</span></caption>'
        f"<thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table></div>"
    )
    if len(table.rows) <= content.MANY_ROWS and not table.folded:
        return made
    cut = "" if len(shown) == len(table.rows) else f", {len(shown)} of them shown here, all in report.json"
    return f"<details><summary>{caption} ({len(table.rows)} rows{cut})</summary>{made}</details>"


def _column_kinds(table: content.Table) -> list[str]:
    """Return the class of each column: drawn, of texts that are folded, or of numbers, which are not."""
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
    """Return a name that a narrow column breaks after its underscores and slashes."""
    return text(shortened(name, _LONGEST_NAME)).replace("_", "_<wbr>").replace("/", "/<wbr>")
