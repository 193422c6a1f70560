"""Write report.md: the report as Markdown, which code hosts show as a page; only report.html has drawings."""

import re
from collections.abc import Sequence

from locsnn_compile.report import content
from locsnn_compile.report.format import plain
from locsnn_compile.report.words import ASSUMED

_SPECIAL = re.compile(r"[\\`*\[\]|~#$]|(?<![^\W_])_|_(?![^\W_])")
"""Characters that Markdown may read as markup anywhere in a line; an underscore between letters is text."""


def render_markdown(report: content.Report) -> str:
    """Return the report as Markdown; equal content gives equal bytes."""
    notices = "".join(_notice(notice) for notice in report.notices)
    sections = "".join(section_markdown(section) for section in report.sections)
    page = f"""\
# {text(report.title)}

{text(report.subtitle)}

{verdicts_markdown(report)}{_assumptions(report.assumptions)}{notices}{sections}"""
    return page.rstrip("\n") + "\n"


def text(value: str) -> str:
    """Return a string that Markdown, the HTML in it and its tables show unchanged."""
    escaped = _SPECIAL.sub(lambda special: f"\\{special.group()}", plain(value))
    # The ampersand first, as the other replacements add some.
    return escaped.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def verdicts_markdown(report: content.Report) -> str:
    """Return the top of the page: a paragraph and its facts for each verdict."""
    return "".join(_verdict(verdict) for verdict in report.verdicts)


def _verdict(verdict: content.Verdict) -> str:
    return f"""\
**{text(verdict.question)} {text(verdict.answer)}.** {text(verdict.sentence)}

{_facts(verdict.facts)}
"""


def _assumptions(sentences: Sequence[str]) -> str:
    if not sentences:
        return ""
    return f"""\
**{ASSUMED}**

{_items(sentences)}
"""


def _notice(notice: content.Notice) -> str:
    return f"> **{text(notice.title)}** {text(notice.text)}\n\n"


def section_markdown(section: content.Section) -> str:
    """Return a section as Markdown."""
    blocks = "".join(_block(block) for block in section.blocks)
    return f"""\
## {text(section.title)}

{text(section.lead)}

{blocks}"""


def _block(block: content.Block) -> str:
    """Return a block as text: for a drawing its description, or nothing where a table has the same figures."""
    match block:
        case str():
            return f"{text(block)}\n\n"
        case content.Facts():
            return f"{_facts(block.facts)}\n"
        case content.Bullets():
            return f"{text(block.title)}:\n\n{_items(block.items)}\n"
        case content.Table():
            return f"{_table(block)}\n\n"
        case content.Span():
            return f"{text(block.title)}:\n\n{_facts(block.facts)}\n"
        case content.Mesh():
            return f"{text(block.title)}: {text(block.description)}.\n\n"
        case content.Folded():
            return "".join(_block(folded) for folded in block.blocks)
        case content.Stack() | content.Plot() | content.Raster():
            return ""


def _facts(facts: Sequence[content.Fact]) -> str:
    return "".join(f"- {text(fact.label)}: {text(fact.value)}\n" for fact in facts)


def _items(sentences: Sequence[str]) -> str:
    return "".join(f"- {text(sentence)}\n" for sentence in sentences)


def _table(table: content.Table) -> str:
    """Return a table without its columns of bars, under its caption."""
    # Columns of bars have no name.
    shown_columns = [i for i, name in enumerate(table.columns) if name]
    # Names to the left, numbers to the right.
    alignments = ["---", *["---:"] * (len(shown_columns) - 1)]
    lines = [
        line([text(table.columns[i]) for i in shown_columns]),
        line(alignments),
    ]
    for row in table.rows:
        lines.append(line([_cell(row[i]) for i in shown_columns]))
    return f"**{text(table.caption)}**\n\n" + "\n".join(lines)


def _cell(cell: content.Cell) -> str:
    """Return a cell as text; a bar is replaced by its label."""
    if isinstance(cell, content.Bar):
        return text(cell.label)
    return text(cell)


def line(cells: Sequence[str]) -> str:
    """Return a row of a table."""
    return f"| {' | '.join(cells)} |"
