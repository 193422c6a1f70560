"""Least, median, mean and most on one axis."""

from __future__ import annotations

from locsnn_compile.report.content import Span
from locsnn_compile.report.pictures.svg import percent, words_of

_FIRST, _LENGTH = 1.0, 98.0
"""Percent: where zero lies, and how far the largest value lies from there."""


def span(drawn: Span) -> str:
    """Return an axis from 0 to the largest value: a band from least to most, the median a stroke, the mean a dot."""
    top = max(drawn.values)
    least, median, mean, most = (percent(_FIRST + _LENGTH * (value / top if top else 0.0)) for value in drawn.values)
    label = words_of(f"{drawn.title}: {', '.join(f'{fact.label} {fact.value}' for fact in drawn.facts)}; drawn from 0")
    return (
        f'<svg class="span" width="100%" height="34" role="img" aria-label="{label}">'
        f'<line class="axis" x1="{_FIRST:.0f}%" x2="{_FIRST + _LENGTH:.0f}%" y1="17" y2="17"/>'
        f'<line class="axis" x1="{_FIRST:.0f}%" x2="{_FIRST:.0f}%" y1="12" y2="22"/>'
        f'<line class="band" x1="{least}" x2="{most}" y1="17" y2="17"/>'
        f'<line class="end" x1="{least}" x2="{least}" y1="10" y2="24"/>'
        f'<line class="end" x1="{most}" x2="{most}" y1="10" y2="24"/>'
        f'<line class="median" x1="{median}" x2="{median}" y1="4" y2="30"/>'
        f'<circle class="mean" cx="{mean}" cy="17" r="5.5"/></svg>'
    )


def mark(kind: str) -> str:
    """Return the sign that ``span`` draws for ``least``, ``median``, ``mean`` or ``most``, to stand beside its name."""
    body = {
        "median": '<line class="median" x1="7" x2="7" y1="0" y2="14"/>',
        "mean": '<circle class="mean" cx="7" cy="7" r="4.5"/>',
    }.get(kind, '<line class="end" x1="7" x2="7" y1="2" y2="12"/>')
    return f'<svg class="mark" width="14" height="14" aria-hidden="true" focusable="false">{body}</svg>'
