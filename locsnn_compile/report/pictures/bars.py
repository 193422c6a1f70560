"""Bars: in a cell, cut into the shares of a whole, and a spread on one axis; and the patterns that tell parts apart."""

from __future__ import annotations

from locsnn_compile.report.content import Bar, Span, Stack
from locsnn_compile.report.pictures.svg import percent, words_of

_PATTERNS = (
    '<rect width="8" height="8" class="ink"/>',
    '<rect width="8" height="8" class="tint"/><path d="M-2 10L10 -2M-2 2L2 -2M6 10L10 6" class="line"/>',
    '<rect width="8" height="8" class="paper"/><circle cx="2" cy="2" r="1.3" class="ink"/>'
    '<circle cx="6" cy="6" r="1.3" class="ink"/>',
    '<rect width="8" height="8" class="tint"/><path d="M0 2H8M0 6H8" class="line"/>',
    '<rect width="8" height="8" class="paper"/><path d="M-2 -2L10 10M-2 10L10 -2" class="line"/>',
    '<rect width="8" height="8" class="paper"/><path d="M2 0V8M6 0V8" class="line"/>',
)
_FIRST, _LENGTH = 1.0, 98.0
"""Percent: where zero lies, and how far the largest value lies from there."""


def patterns() -> str:
    """Return the definitions that the other drawings refer to; once a page."""
    made = "".join(
        f'<pattern id="p{i}" width="8" height="8" patternUnits="userSpaceOnUse">{body}</pattern>'
        for i, body in enumerate(_PATTERNS)
    )
    return f'<svg class="defs" width="0" height="0" aria-hidden="true" focusable="false"><defs>{made}</defs></svg>'


def _fill(pattern: int) -> str:
    """Return how a shape refers to a pattern; there are few, so they come again."""
    return f"url(#p{pattern % len(_PATTERNS)})"


def bar(cell: Bar) -> str:
    """Return a track filled to the cell's share."""
    return (
        f'<svg class="bar" width="100%" height="10" role="img" aria-label="{words_of(cell.label)}">'
        f'<rect class="track" width="100%" height="10"/>{_part(0.0, cell.share, cell.pattern, 10)}</svg>'
    )


def stack(drawn: Stack) -> str:
    """Return one bar cut into its shares, each with its own pattern."""
    parts, start = [], 0.0
    for part in drawn.shares:
        parts.append(_part(start, part.share, part.pattern, 28))
        start += part.share
    label = words_of(f"{drawn.label}: {'; '.join(part.label for part in drawn.shares) or 'nothing'}")
    return (
        f'<svg class="stack" width="100%" height="28" role="img" aria-label="{label}">'
        f'<rect class="track" width="100%" height="28"/>{"".join(parts)}</svg>'
    )


def _part(start: float, share: float, pattern: int, height: int) -> str:
    if share <= 0:
        return ""
    return (
        f'<rect class="part" x="{percent(100 * start)}" width="{percent(100 * min(share, 1.0))}" '
        f'height="{height}" fill="{_fill(pattern)}"/>'
    )


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
