"""The summary on the terminal: the verdicts, and a bar for every population."""

import re
import textwrap
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
"""Characters of a full bar, where there is room."""
_AFTER_BAR = 9
"""Characters kept for what stands to the right of a bar."""
_LONGEST = 60
"""Characters of a name; the rest is cut, but only here."""
_LABEL, _WIDEST_LABEL = 18, 24
"""Characters of a label and of the space after it: at least, and at most."""
_SHOWN_POPULATIONS = 8
_HELD = "\u00a0"
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


def render_terminal(report: Report, console: Console) -> None:
    """Print title, verdicts and notices, with a bar for every population below the first verdict.

    The text is plain if the console is not a terminal, and ASCII if its encoding has nothing else.
    """
    _line(console, _short(report.title, 2 * _LONGEST + 4), style="bold")
    _line(console, _short(report.subtitle, 2 * _LONGEST), style="dim")
    longest = max(
        (len(fact.label) for verdict in report.verdicts for fact in verdict.facts), default=0
    )
    width = min(max(_LABEL, longest + 1), _WIDEST_LABEL)
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
    lead = f"{SIGNS[verdict.status]} {verdict.question} {verdict.answer}."
    _line(console, f"{lead} {verdict.sentence}", style=_STYLES[verdict.status], styled=len(lead))
    for fact in verdict.facts:
        _row(console, fact.label, fact.value, width)


def _populations(console: Console, report: Report, width: int) -> None:
    """Print the first columns of the table of agreement by population, if the report has one, without its last row.

    Populations without spikes whose names differ in a last number are one line.
    """
    blocks = (
        block
        for section in report.sections
        if section.key == "agreement"
        for block in section.blocks
    )
    rows = next((block.rows[:-1] for block in blocks if isinstance(block, Table)), ())
    lines = [list(alike) for _, alike in groupby(rows, _same_line)]
    length = min(max(console.width - 2 - width - _AFTER_BAR, 2), _BAR)
    for alike in lines[:_SHOWN_POPULATIONS]:
        name, bar, equal, *_ = alike[0]
        drawn = (
            f"{_drawn(bar.share, length)} "
            if isinstance(bar, Bar) and bar.share is not None
            else ""
        )
        many = f"{len(alike)} populations, " if len(alike) > 1 else ""
        label = f"{str(name).rstrip(digits)}*" if many else str(name)
        _row(console, _ending(label, width - 1), f"{many}{drawn}{equal}", width)
    left = sum(map(len, lines[_SHOWN_POPULATIONS:]))
    if left:
        _row(console, "...", f"and {plural(left, 'more population')} in the report", width)


def _same_line(row: tuple[str | Bar, ...]) -> tuple[str | Bar, ...]:
    """Return what rows have in common that are one line."""
    name, bar, equal, *_ = row
    return (
        (name,)
        if isinstance(bar, Bar) and bar.share is not None
        else (str(name).rstrip(digits), equal)
    )


def _drawn(value: float, length: int) -> str:
    """Return a bar of ``length`` characters that is full only for 1 and empty only for 0."""
    full = round(length * value)
    if 0 < value < 1:
        full = min(max(full, 1), length - 1)
    return "█" * full + "░" * (length - full)


def _row(console: Console, label: str, value: str, width: int) -> None:
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
    """Print a line, wrapped to the console with a hanging indent; its first ``styled`` characters in ``style``."""
    folded = textwrap.fill(
        BEFORE_UNIT.sub(_HELD, _readable(console, line)),
        width=max(console.width, 2 * hanging),
        subsequent_indent=" " * hanging,
        break_on_hyphens=False,
    )
    # A word that is wider than the line may be cut behind a blank that held it to its unit.
    styled_text = Text(_BLANKS_AT_ENDS.sub("", folded.replace(_HELD, " ")))
    letters = len(
        "".join(_readable(console, line[:styled]).split())
    )  # wrapping changes only the space around them
    styled_text.stylize(style, 0, re.match(rf"(?:\s*\S){{{letters}}}", styled_text.plain).end())  # type: ignore[union-attr]
    console.print(styled_text, soft_wrap=True)


def _ending(name: str, longest: int) -> str:
    """Return the end of a long name, which tells the populations of a committee apart."""
    name = plain(name)
    return name if len(name) <= longest else f"…{name[1 - longest :]}"


def _short(name: str, longest: int) -> str:
    return shortened(plain(name), longest)


def _readable(console: Console, line: str) -> str:
    """Return the line without control characters, and without those that the encoding of the console lacks."""
    line = plain(line)
    if console.options.ascii_only:
        return line.translate(_ASCII).encode("ascii", "replace").decode()
    return line
