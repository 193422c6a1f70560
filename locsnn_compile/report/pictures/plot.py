"""Curves over common axes."""

from __future__ import annotations

from locsnn_compile.report.content import Plot
from locsnn_compile.report.pictures.svg import AXIS_HEIGHT, framed, horizontal_axis, percent, stretched, words_of

_TOP, _HEIGHT = 16, 150
"""Pixels above the curves, and of the curves."""


def plot(drawn: Plot) -> str:
    """Return curves over a grid: each with its own dash, labels of the vertical axis above its lines.

    The curves are drawn in a square of 100 by 100 that is stretched to its place; their strokes are not.
    """
    parts, labels = [], []
    for at, label in drawn.y_ticks:
        y = _TOP + (1.0 - at) * _HEIGHT
        parts.append(f'<line class="grid" x1="0%" x2="100%" y1="{y:.1f}" y2="{y:.1f}"/>')
        labels.append(f'<text class="tick" x="0%" y="{y - 3:.1f}">{words_of(label)}</text>')
    if drawn.marked is not None:
        x = percent(100 * drawn.marked)
        parts.append(f'<line class="marked" x1="{x}" x2="{x}" y1="{_TOP}" y2="{_TOP + _HEIGHT}"/>')
    parts.append(horizontal_axis(_TOP + _HEIGHT, drawn.x_ticks, drawn.x_label))
    curves = "".join(_curve(i, curve.points) for i, curve in enumerate(drawn.curves))
    parts.append(stretched(_TOP, _HEIGHT, "0 0 100 100", curves))
    parts += labels
    description = "; ".join(curve.label for curve in drawn.curves)
    return framed("plot", _TOP + _HEIGHT + AXIS_HEIGHT, drawn.title, description, "".join(parts))


def curve_mark(index: int) -> str:
    """Return a piece of the curve of a plot, to stand beside its label."""
    line = f'<line class="curve c{index}" x1="0" x2="26" y1="7" y2="7"/>'
    return f'<svg class="mark" width="26" height="14" aria-hidden="true" focusable="false">{line}</svg>'


def _curve(index: int, points: tuple[tuple[float, float], ...]) -> str:
    path = " ".join(f"{100 * x:.4g},{100 * (1 - y):.4g}" for x, y in points)
    return f'<polyline class="curve c{index}" vector-effect="non-scaling-stroke" points="{path}"/>' if points else ""
