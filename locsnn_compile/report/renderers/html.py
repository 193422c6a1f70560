"""Write report.html: one page with the verdicts first, and without scripts, fonts or requests.

Every kind of content has a function that returns its markup. All strings of a report come from outside, such as names
in a model file; :func:`text` and :func:`prose` escape them. ``style.css`` has the classes.
"""

import re
from collections.abc import Iterable, Sequence
from html import escape

from hw_model.texts.templates import filled
from locsnn_compile.report import content
from locsnn_compile.report.format import BEFORE_UNIT, plain, shortened
from locsnn_compile.report.pictures import drawings
from locsnn_compile.report.words import ASSUMED, SIGNS

_MANY_COLUMNS = 7
"""A table with more columns is set in smaller letters; chosen by hand."""
_FEW_COLUMNS = 4
"""A table with no more columns fits a phone; chosen by hand."""
_LONGEST = 2000
"""Most characters of a text; longer ones are cut, so that a hostile file cannot fill the page."""
_LONGEST_NAME = 240
"""Most characters of a name that heads a row."""
_LONGEST_NUMBER = 28
"""Most characters of a cell that is never wrapped; longer cells hold texts."""
_OPTION = re.compile(r"(?<!\S)--[a-z-]+")
"""An option of the command line in a sentence."""
_DRAWN = '<span class="hidden">drawn</span>'
"""The heading of a column of bars, for screen readers alone."""
MAX_ROWS = 200
"""Most rows of a table on the page: networks may have any number of populations, and programs of cores."""


def render_html(report: content.Report) -> str:
    """Return the page of a report; equal content gives equal bytes."""
    return filled(
        __package__,
        "page.html",
        title=text(report.title),
        subtitle=text(report.subtitle),
        kind=text(report.kind),
        footer=text(report.footer),
        patterns=drawings.patterns(),
        verdicts=verdicts_html(report),
        notices="".join(_notice(notice) for notice in report.notices),
        contents=_contents(report),
        sections="".join(section_html(section) for section in report.sections),
    )


def render_summary(report: content.Report) -> str:
    """Return the verdicts as a table for a Jupyter notebook, without a style of its own."""
    rows = "".join(_verdict_row(verdict) for verdict in report.verdicts)
    return (
        f"<p><strong>{text(report.title)}</strong><br>{text(report.subtitle)}</p>"
        f"<table>{rows}</table>"
    )


def _verdict_row(verdict: content.Verdict) -> str:
    sign = SIGNS[verdict.status]
    return (
        f"<tr><th>{sign} {text(verdict.question)} {text(verdict.answer)}</th>"
        f"<td>{text(verdict.sentence)}</td></tr>"
    )


def text(value: str) -> str:
    """Return a string that is safe in text and in quoted attributes; an absurdly long one is cut."""
    return escape(shortened(plain(value), _LONGEST))


def prose(value: str) -> str:
    """Return a string that is safe in text, in which lines break neither before a unit nor within an option."""
    with_units_joined = BEFORE_UNIT.sub("&nbsp;", text(value))
    return _OPTION.sub(r"<code>\g<0></code>", with_units_joined)


def verdicts_html(report: content.Report) -> str:
    """Return the top of the page: a row for each verdict, and the assumptions."""
    verdicts = "".join(_verdict(verdict) for verdict in report.verdicts)
    return (
        '<section aria-labelledby="verdict"><h2 class="hidden" id="verdict">Verdict</h2>'
        f'<div class="verdicts">{verdicts}</div>{_assumptions(report.assumptions)}</section>'
    )


def _assumptions(sentences: Sequence[str]) -> str:
    if not sentences:
        return ""
    return (
        f'<div class="notice" role="note"><strong>{ASSUMED}</strong>'
        f"<ul>{_items(sentences)}</ul></div>"
    )


def _verdict(verdict: content.Verdict) -> str:
    """Return a row: the question with its answer, the figure, and the sentence above the facts."""
    return (
        f'<div class="verdict"><div><h3>{text(verdict.question)}</h3>'
        f'<p class="status {verdict.status}"><i aria-hidden="true">{SIGNS[verdict.status]}</i>'
        f"<span>{text(verdict.answer)}</span></p></div>"
        f'<div><p class="figure">{text(verdict.figure)}</p>'
        f'<p class="figure-label">{text(verdict.figure_label)}</p></div>'
        f"<div><p>{prose(verdict.sentence)}</p>{_facts_behind(verdict)}</div></div>"
    )


def _facts_behind(verdict: content.Verdict) -> str:
    """Return the facts of a verdict, folded under their labels; nothing without facts."""
    if not verdict.facts:
        return ""
    labels = ", ".join(text(fact.label) for fact in verdict.facts)
    return f"<details><summary>{labels}</summary><dl>{_facts(verdict.facts)}</dl></details>"


def _notice(notice: content.Notice) -> str:
    return (
        f'<div class="notice" role="note"><strong>{text(notice.title)}</strong>'
        f" {prose(notice.text)}</div>"
    )


def _contents(report: content.Report) -> str:
    links = "".join(link_html(section) for section in report.sections)
    return f'<nav aria-label="Sections"><ul>{links}</ul></nav>'


def link_html(section: content.Section) -> str:
    """Return the link to a section among the contents."""
    return f'<li><a href="#{text(section.key)}">{text(section.title)}</a></li>'


def section_html(section: content.Section) -> str:
    """Return a section as HTML."""
    if section.folded:
        return _folded_section(section)
    key = text(section.key)
    blocks = "".join(_block(block) for block in section.blocks)
    return (
        f'<section class="section" aria-labelledby="{key}">'
        f'<div><h2 id="{key}">{text(section.title)}</h2>'
        f'<p class="lead">{text(section.lead)}</p></div>'
        f'<div class="blocks">{blocks}</div></section>'
    )


def _folded_section(section: content.Section) -> str:
    """Return a section of which only the heading is shown until a reader opens it."""
    key = text(section.key)
    blocks = "".join(_block(block) for block in section.blocks)
    return (
        f'<section class="section folded" aria-labelledby="{key}"><details>'
        f'<summary><h2 id="{key}">{text(section.title)}</h2></summary>'
        f'<p class="lead">{text(section.lead)}</p><div class="blocks">{blocks}</div>'
        "</details></section>"
    )


def _block(block: content.Block) -> str:  # noqa: C901 - a case for each kind of block
    match block:
        case str():
            return f"<p>{prose(block)}</p>"
        case content.Facts():
            return f'<div class="facts"><dl>{_facts(block.facts)}</dl></div>'
        case content.Bullets():
            return (
                f'<div class="bullets"><h3>{text(block.title)}</h3>'
                f"<ul>{_items(block.items)}</ul></div>"
            )
        case content.Table():
            return _table(block)
        case content.Stack():
            return _figure(block.label, drawings.stack(block))
        case content.Span():
            return _figure(block.title, drawings.span(block) + _span_legend(block))
        case content.Plot():
            return _figure(block.title, drawings.plot(block) + _plot_legend(block))
        case content.Raster():
            return _figure(block.title, drawings.raster(block) + _raster_legend(block))
        case content.Mesh():
            description = f'<p class="said">{text(block.description)}</p>'
            return _figure(block.title, drawings.mesh(block) + description)
        case content.Folded():
            inside = "".join(_block(inner) for inner in block.blocks)
            return (
                f'<details class="more"><summary>{text(block.title)}</summary>'
                f'<div class="blocks">{inside}</div></details>'
            )


def _facts(facts: Sequence[content.Fact]) -> str:
    return "".join(
        f"<div><dt>{text(fact.label)}</dt><dd>{prose(fact.value)}</dd></div>" for fact in facts
    )


def _items(sentences: Sequence[str]) -> str:
    return "".join(f"<li>{prose(sentence)}</li>" for sentence in sentences)


def _figure(title: str, inside: str) -> str:
    return f"<figure><figcaption>{text(title)}</figcaption>{inside}</figure>"


def _span_legend(span: content.Span) -> str:
    """Return the least, median, mean and most in figures, each with the mark that it has in the drawing."""
    entries = "".join(
        f"<div><dt>{drawings.span_mark(fact.label)}{text(fact.label)}</dt>"
        f"<dd>{text(fact.value)}</dd></div>"
        for fact in span.facts
    )
    return f'<dl class="stats">{entries}</dl>'


def _plot_legend(plot: content.Plot) -> str:
    return _legend(
        (drawings.curve_mark(index), curve.label) for index, curve in enumerate(plot.curves)
    )


def _raster_legend(raster: content.Raster) -> str:
    return _legend(
        (drawings.stroke_mark(strokes.kind), strokes.label) for strokes in raster.strokes
    )


def _legend(entries: Iterable[tuple[str, str]]) -> str:
    """Return a legend of entries (drawn mark, label)."""
    rows = "".join(f"<div><dt>{mark}</dt><dd>{text(label)}</dd></div>" for mark, label in entries)
    return f'<dl class="curves">{rows}</dl>'


def _table(table: content.Table) -> str:
    """Return a table; a table of many rows is folded, and cut to :data:`MAX_ROWS` and the last row.

    The last row stays because it may be the total.
    """
    row_count = len(table.rows)
    rows_shown: Sequence[int] = range(row_count)
    cut = ""
    if row_count > MAX_ROWS + 1:
        rows_shown = [*range(MAX_ROWS), row_count - 1]
        cut = f", {len(rows_shown)} of them shown here, all in report.json"
    markup = _table_of_rows(table, rows_shown)
    if row_count <= content.MANY_ROWS and not table.folded:
        return markup
    return (
        '<details class="long">'
        f"<summary>{text(table.caption)} ({row_count} rows{cut})</summary>"
        f"{markup}</details>"
    )


def _table_of_rows(table: content.Table, rows_shown: Sequence[int]) -> str:
    """Return some rows of a table, by their indices, in a box that scrolls if the table is wider."""
    kinds = _column_kinds(table)
    heads = "".join(
        _column_head(name, kind) for name, kind in zip(table.columns, kinds, strict=True)
    )
    last = len(table.rows) - 1
    rows = ""
    for i in rows_shown:
        rows += _table_row(kinds, table.rows[i], is_total=table.total and i == last)
    look = "plain" if all(table.columns) else "barred"
    if len(table.columns) > _MANY_COLUMNS:
        look += " wide"
    focus = ""
    if len(table.columns) > _FEW_COLUMNS:
        # Can be focused, so that it can be scrolled by keyboard as well.
        focus = f' tabindex="0" role="region" aria-label="{text(table.caption)}"'
    return (
        f'<div class="scroll"{focus}><table class="{look}">'
        f"<caption><span>{text(table.caption)}</span></caption>"
        f"<thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table></div>"
    )


def _column_head(name: str, kind: str) -> str:
    """Return the heading of a column; ``kind`` is its attribute, as :func:`_column_kinds` gives it."""
    head = text(name).replace(" %", "&nbsp;%") or _DRAWN
    return f'<th scope="col"{kind}>{head}</th>'


def _column_kinds(table: content.Table) -> list[str]:
    """Return the class attribute of each column: drawn, of texts, which wrap, or none for numbers, which do not."""
    kinds = []
    for i, name in enumerate(table.columns):
        cells = (row[i] for row in table.rows[:MAX_ROWS])
        has_texts = any(isinstance(cell, str) and len(cell) > _LONGEST_NUMBER for cell in cells)
        # The first column names the rows, and has a style of its own.
        if has_texts and i > 0:
            kinds.append(' class="words"')
        elif name:
            kinds.append("")
        else:
            kinds.append(' class="drawn"')
    return kinds


def _table_row(kinds: list[str], row: tuple[content.Cell, ...], *, is_total: bool) -> str:
    """Return a row, whose first cell is its heading; ``kinds`` are the attributes of the columns."""
    first, *others = row
    heading = first.label if isinstance(first, content.Bar) else first
    cells = "".join(_cell(kind, cell) for kind, cell in zip(kinds[1:], others, strict=True))
    attribute = ' class="total"' if is_total else ""
    return f'<tr{attribute}><th scope="row">{_breakable(heading)}</th>{cells}</tr>'


def _cell(kind: str, cell: content.Cell) -> str:
    inside = drawings.bar(cell) if isinstance(cell, content.Bar) else text(cell)
    return f"<td{kind}>{inside}</td>"


def _breakable(name: str) -> str:
    """Return a name that may break after underscores and slashes in a narrow column."""
    return text(shortened(name, _LONGEST_NAME)).replace("_", "_<wbr>").replace("/", "/<wbr>")
