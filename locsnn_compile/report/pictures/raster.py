"""Spikes as strokes: a row a neuron, time to the right.

A spike of both sides is a stroke as high as its row. One of the reference alone is a thick stroke in the upper half of
its row, one of the chip alone in the lower half. So the sides are told apart by place and width, not by colour.
"""

from __future__ import annotations

from locsnn_compile.report.content import Raster, Strokes
from locsnn_compile.report.pictures.svg import AXIS_HEIGHT, framed, horizontal_axis, percent, stretched, words_of

_TOP = 14
"""Pixels above the rows, for the flag."""
_KINDS = {"equal": (1, 6), "reference": (0, 4), "chip": (4, 4), "event": (1, 6)}
"""Where a stroke begins in its row of 8 units, and its length."""
_ROW = 8
_HIGH, _LOW = 300, 6
"""Pixels of a picture at the most, and of a row at the most."""


def raster(drawn: Raster) -> str:
    """Return the strokes over their axis; a dashed line and a ring at what is flagged."""
    pixels = min(float(_LOW + 2), max(1.0, _HIGH / max(1, drawn.rows)))
    height = round(pixels * drawn.rows)
    strokes = "".join(_strokes(one) for one in drawn.strokes)
    view_box = f"-.5 0 {drawn.columns} {_ROW * drawn.rows}"
    parts = [
        f'<rect class="ground" x="0%" y="{_TOP}" width="100%" height="{height}"/>',
        stretched(_TOP, height, view_box, strokes),
    ]
    if drawn.flag is not None:
        column, row = drawn.flag
        place = (column + 0.5) / drawn.columns
        x, y = percent(100 * place), _TOP + (row + 0.5) * pixels
        anchor = "start" if place < 0.5 else "end"
        parts.append(f'<line class="marked" x1="{x}" x2="{x}" y1="4" y2="{_TOP + height}"/>')
        parts.append(f'<circle class="ring" cx="{x}" cy="{y:.1f}" r="7"/>')
        side = 6 if anchor == "start" else -6
        parts.append(
            f'<text class="tick" text-anchor="{anchor}" x="{x}" dx="{side}" y="10">{words_of(drawn.flag_label)}</text>'
        )
    parts.append(horizontal_axis(_TOP + height, drawn.x_ticks, drawn.x_label))
    return framed("raster", _TOP + height + AXIS_HEIGHT, drawn.title, drawn.description, "".join(parts))


def stroke_mark(kind: str) -> str:
    """Return a stroke in its row, to stand beside its label."""
    start, length = _KINDS[kind]
    line = f'<path class="stroke {kind}" d="M7 {3 + start}v{length}"/>'
    rule = '<path class="grid" d="M0 2.5h14M0 11.5h14"/>'
    return f'<svg class="mark" width="14" height="14" aria-hidden="true" focusable="false">{rule}{line}</svg>'


def _strokes(one: Strokes) -> str:
    start, length = _KINDS[one.kind]
    path = "".join(f"M{column} {_ROW * row + start}v{length}" for column, row in one.points)
    return f'<path class="stroke {one.kind}" vector-effect="non-scaling-stroke" d="{path}"/>' if path else ""
