"""The summary on the terminal: the three verdicts, and a bar for every population."""

import re
import textwrap
from collections.abc import Callable
from dataclasses import replace

from rich.console import Console
from rich.text import Text

from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import Document, Report, Verdict
from locsnn_compile.report.format import plain, share, shortened
from locsnn_compile.report.words import ASSUMED, SIGNS, no_spikes

_STYLES = {"yes": "bold green", "nearly": "bold yellow", "no": "bold red", "unknown": "bold", "modelled": "bold"}
_BAR = 24
"""Characters of a full bar."""
_LONGEST = 60
"""Characters of a name; the rest is cut, here only."""
_LABEL = 18
"""Characters of a label with the room after it."""
_SHOWN_POPULATIONS = 8
_BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:[pnuµm]?[Js]|[kMG]?B|%)(?!\w))")
_HELD = "\u00a0"
"""Stands for a blank between a number and its unit while lines are folded, so that the two stay together."""
_ASCII = str.maketrans(
    {"✓": "+", "≈": "~", "✗": "x", "█": "#", "░": ".", "µ": "u", "−": "-", "–": "-", "…": "~", "→": "->"}  # noqa: RUF001
)


def render_terminal(document: Document, console: Console) -> None:
    """Print the summary of a build, with a bar for every population."""
    title = f"{_short(document['model']['name'])} on {_short(document['target'])}"
    render_summary(replace(compose(document), title=title), console, lambda: _populations(console, document))


def render_summary(report: Report, console: Console, below_first: Callable[[], None] = lambda: None) -> None:
    """Print title, verdicts and notices, and what is ``below_first`` of the verdicts.

    Plain text where the console is not a terminal, ASCII where its encoding has no more.
    """
    _line(console, report.title, style="bold")
    _line(console, _short(report.subtitle, 2 * _LONGEST), style="dim")
    for verdict in report.verdicts:
        console.print()
        _verdict(console, verdict)
        if verdict is report.verdicts[0]:
            below_first()
    if report.assumptions:
        console.print()
        _line(console, ASSUMED, style="yellow")
    for sentence in report.assumptions:
        _line(console, f"- {sentence}", style="yellow")
    for notice in report.notices:
        console.print()
        _line(console, f"! {notice.title} {notice.text}", style="yellow")


def _verdict(console: Console, verdict: Verdict) -> None:
    lead = f"{SIGNS[verdict.status]} {verdict.question} {verdict.answer}."
    _line(console, f"{lead} {verdict.sentence}", style=_STYLES[verdict.status], styled=len(lead))
    for fact in verdict.facts:
        _row(console, fact.label, fact.value)


def _populations(console: Console, document: Document) -> None:
    match = document["match"]
    found = match["by_population"]
    for name in list(found)[:_SHOWN_POPULATIONS]:
        value = found[name]["spike_agreement"]
        shown = no_spikes(match, name) if value is None else f"{_drawn(value)} {share(value)}"
        _row(console, _short(name, _LABEL - 1), shown)
    if len(found) > _SHOWN_POPULATIONS:
        _row(console, "...", f"and {len(found) - _SHOWN_POPULATIONS} more populations in the report")


def _drawn(value: float) -> str:
    """Return a bar that is full only for 1 and empty only for 0."""
    full = round(_BAR * value)
    if 0 < value < 1:
        full = min(max(full, 1), _BAR - 1)
    return "█" * full + "░" * (_BAR - full)


def _row(console: Console, label: str, value: str) -> None:
    _line(console, f"  {label:<{_LABEL - 1}} {value}", style="dim", styled=_LABEL, hanging=2 + _LABEL)


def _line(console: Console, line: str, style: str, *, styled: int | None = None, hanging: int = 2) -> None:
    """Print a line, folded to the console under a hanging indent; its first ``styled`` characters in ``style``."""
    folded = textwrap.fill(
        _BEFORE_UNIT.sub(_HELD, _readable(console, line)),
        width=max(console.width, 2 * hanging),
        subsequent_indent=" " * hanging,
        break_on_hyphens=False,
    )
    made = Text(folded.replace(_HELD, " "))
    made.stylize(style, 0, styled)
    console.print(made, soft_wrap=True)


def _short(name: str, longest: int = _LONGEST) -> str:
    return shortened(plain(name), longest)


def _readable(console: Console, line: str) -> str:
    """Return what the console can show: no control characters, and nothing that its encoding lacks."""
    line = plain(line)
    if console.options.ascii_only:
        return line.translate(_ASCII).encode("ascii", "replace").decode()
    return line
