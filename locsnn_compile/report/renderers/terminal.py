"""Print the summary of a report on the terminal: the verdicts with their facts, and a bar for every population."""

import re
import textwrap
from collections.abc import Sequence
from itertools import groupby
from string import digits

from rich.console import Console
from rich.text import Text

from locsnn_compile.report.content import Bar, Report, Table, Verdict
from locsnn_compile.report.format import BEFORE_UNIT, plain, plural, shortened
from locsnn_compile.report.words import ASSUMED, SIGNS

_STYLES = {
    "yes": "bold green",
    "nearly": "bold yellow",
    "no": "bold red",
    "unknown": "bold",
    "modelled": "bold",
}
_BAR = 24
"""Characters of a full bar, where the terminal is wide enough."""
_AFTER_BAR = 9
"""Characters to the right of a bar, for a blank and a share such as ``99.99 %``."""
_LONGEST = 60
"""Most characters of a name on the terminal; files have it in full."""
_NARROWEST_LABEL = 18
"""Fewest characters of the column of labels, with the space after them."""
_WIDEST_LABEL = 24
"""Most characters of the column of labels, with the space after them."""
_SHOWN_POPULATIONS = 8
"""Most populations with a line of their own, chosen by hand; the report has all."""
_NO_BREAK_SPACE = "\u00a0"
"""Replaces the blank between a number and its unit while lines are wrapped, to keep the two together."""
_BLANKS_AT_ENDS = re.compile(" +$", re.MULTILINE)
_ASCII = str.maketrans(
    {
        "✓": "+",
        "≈": "~",
        "✗": "x",
        "█": "#",
        "░": ".",
        "µ": "u",
        "\N{MINUS SIGN}": "-",
        "\N{EN DASH}": "-",
        "…": "~",
        "→": "->",
    }
)
"""Replacements for a terminal whose encoding is ASCII."""


def render_terminal(report: Report, console: Console) -> None:
    """Print title, verdicts and notices, with a bar for every population below the first verdict.

    The text is plain if the console is not a terminal, and ASCII if its encoding has nothing else.
    """
    # Two names with " on " between them.
    _line(console, _short(report.title, 2 * _LONGEST + 4), style="bold")
    _line(console, _short(report.subtitle, 2 * _LONGEST), style="dim")
    longest_label = max(
        (len(fact.label) for verdict in report.verdicts for fact in verdict.facts), default=0
    )
    width = min(max(_NARROWEST_LABEL, longest_label + 1), _WIDEST_LABEL)
    for verdict in report.verdicts:
        console.print()
        _verdict(console, verdict, width)
        if verdict is report.verdicts[0]:
            _populations(console, report, width)
    if report.assumptions:
        console.print()
        _line(console, ASSUMED, style="yellow")
    for sentence in report.assumptions:
        _line(console, f"- {sentence}", style="yellow")
    for notice in report.notices:
        console.print()
        _line(console, f"! {notice.title} {notice.text}", style="yellow")


def _verdict(console: Console, verdict: Verdict, width: int) -> None:
    """Print a verdict and its facts; ``width`` is that of the column of labels."""
    lead = f"{SIGNS[verdict.status]} {verdict.question} {verdict.answer}."
    _line(console, f"{lead} {verdict.sentence}", style=_STYLES[verdict.status], styled=len(lead))
    for fact in verdict.facts:
        _row(console, fact.label, fact.value, width)


def _populations(console: Console, report: Report, width: int) -> None:
    """Print the first columns of the table of agreement by population, if the report has one.

    Its last row, the sum, is left out. Populations without spikes whose names differ only in a last number share
    a line.
    """
    rows = _rows_by_population(report)
    lines = [list(rows_of_line) for _, rows_of_line in groupby(rows, _line_key)]
    bar_length = min(max(console.width - 2 - width - _AFTER_BAR, 2), _BAR)
    for rows_of_line in lines[:_SHOWN_POPULATIONS]:
        name, bar, equal, *_ = rows_of_line[0]
        label = str(name)
        value = str(equal)
        if isinstance(bar, Bar) and bar.share is not None:
            value = f"{_bar(bar.share, bar_length)} {value}"
        if len(rows_of_line) > 1:
            label = f"{label.rstrip(digits)}*"
            value = f"{len(rows_of_line)} populations, {value}"
        _row(console, _ending(label, width - 1), value, width)
    not_shown = sum(map(len, lines[_SHOWN_POPULATIONS:]))
    if not_shown:
        _row(console, "...", f"and {plural(not_shown, 'more population')} in the report", width)


def _rows_by_population(report: Report) -> Sequence[tuple[str | Bar, ...]]:
    """Return the rows of the first table of the section on agreement, without the sum; empty without a table."""
    for section in report.sections:
        if section.key == "agreement":
            for block in section.blocks:
                if isinstance(block, Table):
                    return block.rows[:-1]
    return ()


def _line_key(row: tuple[str | Bar, ...]) -> tuple[str | Bar, ...]:
    """Return a key that is equal for rows that share a line: their name without a last number, and their words."""
    name, bar, equal, *_ = row
    has_spikes = isinstance(bar, Bar) and bar.share is not None
    return (name,) if has_spikes else (str(name).rstrip(digits), equal)


def _bar(value: float, length: int) -> str:
    """Return a bar of ``length`` characters that is full only for 1 and empty only for 0."""
    full = round(length * value)
    if 0 < value < 1:
        full = min(max(full, 1), length - 1)
    return "█" * full + "░" * (length - full)


def _row(console: Console, label: str, value: str, width: int) -> None:
    """Print a label in a column of ``width`` characters, and a value that is wrapped next to it."""
    _line(
        console,
        f"  {_short(label, width - 1):<{width}}{value}",
        style="dim",
        styled=width,
        hanging=2 + width,
    )


def _line(
    console: Console, line: str, style: str, *, styled: int | None = None, hanging: int = 2
) -> None:
    """Print a line, wrapped to the console with a hanging indent.

    Its first ``styled`` characters, or all of it, are in ``style``. The line is wrapped here rather than by rich,
    which has no hanging indent.
    """
    wrapped = textwrap.fill(
        BEFORE_UNIT.sub(_NO_BREAK_SPACE, _readable(console, line)),
        width=max(console.width, 2 * hanging),
        subsequent_indent=" " * hanging,
        break_on_hyphens=False,
    )
    # A word that is wider than the line may be cut behind a blank that held it to its unit.
    styled_text = Text(_BLANKS_AT_ENDS.sub("", wrapped.replace(_NO_BREAK_SPACE, " ")))
    # Wrapping changes only the space between words, so the styled part ends at the same letter as before.
    letters = len("".join(_readable(console, line[:styled]).split()))
    styled_part = re.match(rf"(?:\s*\S){{{letters}}}", styled_text.plain)
    assert styled_part is not None
    styled_text.stylize(style, 0, styled_part.end())
    console.print(styled_text, soft_wrap=True)


def _ending(name: str, longest: int) -> str:
    """Return the end of a long name, which tells the populations of a committee apart."""
    name = plain(name)
    return name if len(name) <= longest else f"…{name[1 - longest :]}"


def _short(name: str, longest: int) -> str:
    return shortened(plain(name), longest)


def _readable(console: Console, line: str) -> str:
    """Return the line without control characters, and without characters that the encoding of the console lacks."""
    line = plain(line)
    if console.options.ascii_only:
        return line.translate(_ASCII).encode("ascii", "replace").decode()
    return line
