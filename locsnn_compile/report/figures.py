"""Drawings of the page, as inline SVG. Lengths are percentages, so a drawing is as wide as its place.

No drawing needs colour to be understood: parts differ in their pattern, and each drawing says itself in its label.
"""

from __future__ import annotations

from html import escape

from locsnn_compile.report.content import Bar, Plot, Span, Stack
from locsnn_compile.report.format import plain

_PATTERNS = (
    '<rect width="8" height="8" class="ink"/>',
    '<rect width="8" height="8" class="tint"/><path d="M-2 10L10 -2M-2 2L2 -2M6 10L10 6" class="line"/>',
    '<rect width="8" height="8" class="paper"/><circle cx="2" cy="2" r="1.3" class="ink"/>'
    '<circle cx="6" cy="6" r="1.3" class="ink"/>',
    '<rect width="8" height="8" class="tint"/><path d="M0 2H8M0 6H8" class="line"/>',
    '<rect width="8" height="8" class="paper"/><path d="M-2 -2L10 10M-2 10L10 -2" class="line"/>',
    '<rect width="8" height="8" class="paper"/><path d="M2 0V8M6 0V8" class="line"/>',
)
_PLOT_TOP, _PLOT_HEIGHT = 16, 150
"""Pixels above the curves of a plot, and of the curves."""
_FIRST, _LENGTH = 1.0, 98.0
"""Percent: where zero lies in a span drawing, and how far its largest value lies from there."""


def patterns() -> str:
    """Return the definitions that the other drawings refer to; once a page."""
    made = "".join(
        f'<pattern id="p{i}" width="8" height="8" patternUnits="userSpaceOnUse">{body}</pattern>'
        for i, body in enumerate(_PATTERNS)
    )
    return f'<svg class="defs" width="0" height="0" aria-hidden="true" focusable="false"><defs>{made}</defs></svg>'


def bar(cell: Bar) -> str:
    """Return a track filled to the cell's share."""
    return (
        f'<svg class="bar" width="100%" height="10" role="img" aria-label="{_label(cell.label)}">'
        f'<rect class="track" width="100%" height="10"/>{_part(0.0, cell.share, cell.pattern, 10)}</svg>'
    )


def stack(drawn: Stack) -> str:
    """Return one bar cut into its shares, each with its own pattern."""
    parts, start = [], 0.0
    for part in drawn.shares:
        parts.append(_part(start, part.share, part.pattern, 28))
        start += part.share
    label = _label(f"{drawn.label}: {'; '.join(part.label for part in drawn.shares) or 'nothing'}")
    return (
        f'<svg class="stack" width="100%" height="28" role="img" aria-label="{label}">'
        f'<rect class="track" width="100%" height="28"/>{"".join(parts)}</svg>'
    )


def span(drawn: Span) -> str:
    """Return an axis from 0 to the largest value: a band from least to most, the median a stroke, the mean a dot."""
    facts = (drawn.least, drawn.median, drawn.mean, drawn.most)
    top = max(drawn.values)
    least, median, mean, most = (_percent(_FIRST + _LENGTH * (value / top if top else 0.0)) for value in drawn.values)
    label = _label(f"{drawn.title}: {', '.join(f'{fact.label} {fact.value}' for fact in facts)}; drawn from 0")
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


def plot(drawn: Plot) -> str:
    """Return curves over a grid: each with its own dash, labels of the vertical axis above its lines.

    The curves are drawn in a square of 100 by 100 that is stretched to its place; their strokes are not.
    """
    parts = []
    for at, label in drawn.y_ticks:
        y = _PLOT_TOP + (1.0 - at) * _PLOT_HEIGHT
        parts.append(f'<line class="grid" x1="0%" x2="100%" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text class="tick" x="0%" y="{y - 3:.1f}">{_label(label)}</text>')
    bottom = _PLOT_TOP + _PLOT_HEIGHT
    for at, label in drawn.x_ticks:
        anchor = "start" if at <= 0 else "end" if at >= 1 else "middle"
        x = _percent(100 * at)
        parts.append(f'<line class="axis" x1="{x}" x2="{x}" y1="{bottom}" y2="{bottom + 4}"/>')
        parts.append(f'<text class="tick" text-anchor="{anchor}" x="{x}" y="{bottom + 17}">{_label(label)}</text>')
    parts.append(f'<text class="tick" text-anchor="middle" x="50%" y="{bottom + 33}">{_label(drawn.x_label)}</text>')
    curves = "".join(_curve(i, curve.points) for i, curve in enumerate(drawn.curves))
    parts.append(
        f'<svg x="0%" y="{_PLOT_TOP}" width="100%" height="{_PLOT_HEIGHT}" viewBox="0 0 100 100" '
        f'preserveAspectRatio="none" aria-hidden="true">{curves}</svg>'
    )
    label = _label(f"{drawn.title}: {'; '.join(curve.label for curve in drawn.curves)}")
    return (
        f'<svg class="plot" width="100%" height="{bottom + 38}" role="img" aria-label="{label}">{"".join(parts)}</svg>'
    )


def curve_mark(index: int) -> str:
    """Return a piece of the curve of a plot, to stand beside its label."""
    line = f'<line class="curve c{index}" x1="0" x2="26" y1="7" y2="7"/>'
    return f'<svg class="mark" width="26" height="14" aria-hidden="true" focusable="false">{line}</svg>'


def _curve(index: int, points: tuple[tuple[float, float], ...]) -> str:
    path = " ".join(f"{100 * x:.4g},{100 * (1 - y):.4g}" for x, y in points)
    return f'<polyline class="curve c{index}" vector-effect="non-scaling-stroke" points="{path}"/>' if points else ""


def mark(kind: str) -> str:
    """Return the sign that ``span`` draws for ``least``, ``median``, ``mean`` or ``most``, to stand beside its name."""
    body = {
        "median": '<line class="median" x1="7" x2="7" y1="0" y2="14"/>',
        "mean": '<circle class="mean" cx="7" cy="7" r="4.5"/>',
    }.get(kind, '<line class="end" x1="7" x2="7" y1="2" y2="12"/>')
    return f'<svg class="mark" width="14" height="14" aria-hidden="true" focusable="false">{body}</svg>'


def _part(start: float, share: float, pattern: int, height: int) -> str:
    if share <= 0:
        return ""
    fill = f"url(#p{pattern % len(_PATTERNS)})"
    return (
        f'<rect class="part" x="{_percent(100 * start)}" width="{_percent(100 * min(share, 1.0))}" '
        f'height="{height}" fill="{fill}"/>'
    )


def _percent(value: float) -> str:
    return f"{value:.2f}%"


def _label(text: str) -> str:
    return escape(plain(text))
