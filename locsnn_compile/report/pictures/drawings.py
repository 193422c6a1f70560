"""Drawings of the page as inline SVG: bars, plots, rasters and meshes.

Horizontal lengths are percentages, so a drawing fills its width; vertical lengths are pixels. Drawings can be read
without colour: parts differ in pattern, dash, place or shape, and each drawing has a description in words.

A spike on both sides is a stroke as high as its row. A spike only in the reference is a thick stroke in the upper half
of its row, and one only on the chip in the lower half, so place and width tell the sides apart.
"""

from html import escape
from itertools import accumulate, product
from typing import Any

from hw_model.texts.pieces import Pieces
from locsnn_compile.report.content import Bar, Mesh, Plot, Raster, Span, Stack
from locsnn_compile.report.format import plain

AXIS_HEIGHT = 38
"""Pixels of the horizontal axis below a picture: its ticks, their texts and its label."""
_PATTERNS = 6
"""Patterns that parts are filled with, in turn."""
_FIRST, _LAST = 1.0, 99.0
"""Places in percent where the axis of a span begins, at zero, and ends, at the largest value."""
_PLOT_TOP, _PLOT_HEIGHT = 16, 150
"""Pixels above the curves, and of the curves."""
_RASTER_TOP = 14
"""Pixels above the rows, for the flag."""
_KINDS = {"equal": (1, 6), "reference": (0, 4), "chip": (4, 4), "event": (1, 6)}
"""Start of a stroke in its row of 8 units, and its length."""
_ROW = 8
_HIGH, _LOW = 300, 6
"""Most pixels of a picture, and of a row."""
_CORE, _GAP = 26, 5
"""Vertical pixels of a core, and between tiles."""


def percent(value: float) -> str:
    """Return a horizontal place or length."""
    return f"{value:.2f}%"


_PIECES = Pieces(
    __package__, "drawings.svg", lambda text: escape(plain(text)), folded=True, percent=percent
)


def patterns() -> str:
    """Return the definitions that the other drawings refer to, needed once per page."""
    return _PIECES.piece("patterns", None)


def bar(cell: Bar) -> str:
    """Return a track filled up to the cell's share."""
    return _PIECES.piece("track", cell, kind="bar", height=10, parts=_part(0.0, cell, 10))


def stack(drawn: Stack) -> str:
    """Return one bar cut into its shares, each with its own pattern."""
    starts = accumulate((part.share or 0.0 for part in drawn.shares), initial=0.0)
    parts = [
        made
        for start, part in zip(starts, drawn.shares, strict=False)
        for made in _part(start, part, 28)
    ]
    label = f"{drawn.label}: {'; '.join(part.label for part in drawn.shares) or 'nothing'}"
    return _PIECES.piece("track", None, kind="stack", height=28, label=label, parts=parts)


def _part(start: float, part: Bar, height: int) -> list[dict[str, Any]]:
    """Return a share of a track, filled with a pattern; nothing for no share or a share of 0."""
    if not part.share:
        return []
    width, pattern = 100 * min(part.share, 1.0), part.pattern % _PATTERNS
    return [{"start": 100 * start, "width": width, "height": height, "pattern": pattern}]


def span(drawn: Span) -> str:
    """Return an axis from 0, with a band from least to most, a stroke at the median, and a dot at the mean."""
    top = max(drawn.values)
    shares = (value / top if top else 0.0 for value in drawn.values)
    least, median, mean, most = (_FIRST + (_LAST - _FIRST) * share for share in shares)
    label = f"{drawn.title}: {', '.join(f'{fact.label} {fact.value}' for fact in drawn.facts)}; drawn from 0"
    return _PIECES.piece(
        "span", None, label=label, least=least, median=median, mean=mean, most=most
    )


def mark(kind: str) -> str:
    """Return the sign of ``least``, ``median``, ``mean`` or ``most`` in a ``span``, to stand next to its name."""
    return _PIECES.piece(f"mark {kind if kind in ('mean', 'median') else 'end'}", None)


def plot(drawn: Plot) -> str:
    """Return curves over a grid, each with its own dash; labels of the vertical axis stand above its lines.

    Curves are drawn in a square of 100 by 100 that is stretched to its place, but their strokes are not stretched.
    """
    bottom = _PLOT_TOP + _PLOT_HEIGHT
    places = ((_PLOT_TOP + (1.0 - at) * _PLOT_HEIGHT, label) for at, label in drawn.y.places)
    lines = [
        " ".join(f"{100 * x:.4g},{100 * (1 - y):.4g}" for x, y in drawn.placed(curve))
        for curve in drawn.curves
    ]
    marked = None if drawn.marked is None else 100 * drawn.x.place(drawn.marked)
    return _PIECES.piece(
        "plot",
        drawn,
        height=bottom + AXIS_HEIGHT,
        description="; ".join(curve.label for curve in drawn.curves),
        top=_PLOT_TOP,
        high=_PLOT_HEIGHT,
        ticks=[{"y": y, "above": y - 3, "label": label} for y, label in places],
        marks=[] if marked is None else [{"x": marked, "top": _PLOT_TOP, "bottom": bottom}],
        axis=_axis(bottom, drawn),
        lines=[{"index": i, "path": path} for i, path in enumerate(lines) if path],
    )


def curve_mark(index: int) -> str:
    """Return a sample of a curve, to stand next to its label."""
    return _PIECES.piece("mark curve", index)


def raster(drawn: Raster) -> str:
    """Return the strokes over their axis, with a dashed line and a ring at the flag."""
    pixels = min(float(_LOW + 2), max(1.0, _HIGH / max(1, drawn.rows)))
    height = round(pixels * drawn.rows)
    bottom = _RASTER_TOP + height
    paths, flags = [], []
    for one in drawn.strokes:
        start, length = _KINDS[one.kind]
        path = "".join(f"M{column} {_ROW * row + start}v{length}" for column, row in one.points)
        paths += [{"kind": one.kind, "path": path}] if path else []
    if drawn.flag is not None:
        column, row = drawn.flag
        place, y = (column + 0.5) / drawn.columns, _RASTER_TOP + (row + 0.5) * pixels
        anchor, shift = ("start", 6) if place < 0.5 else ("end", -6)
        flag = {
            "x": 100 * place,
            "y": y,
            "bottom": bottom,
            "anchor": anchor,
            "shift": shift,
            "label": drawn.flag_label,
        }
        flags.append(flag)
    return _PIECES.piece(
        "raster",
        drawn,
        height=bottom + AXIS_HEIGHT,
        top=_RASTER_TOP,
        high=height,
        units=_ROW * drawn.rows,
        paths=paths,
        flags=flags,
        axis=_axis(bottom, drawn),
    )


def stroke_mark(kind: str) -> str:
    """Return a stroke in its row, to stand next to its label."""
    start, length = _KINDS[kind]
    return _PIECES.piece("mark stroke", kind, start=3 + start, length=length)


def mesh(drawn: Mesh) -> str:
    """Return tiles with their cores; the number in a core is its use in percent."""
    wide = 100 / drawn.columns
    gap = wide * 0.08
    core_wide = (wide - gap) / drawn.tile_columns
    tile_high = _CORE * drawn.tile_rows + _GAP
    tiles = [
        _rectangle(
            "tile", column * wide + gap / 2, row * tile_high, wide - gap, _CORE * drawn.tile_rows
        )
        for row, column in product(range(drawn.rows), range(drawn.columns))
    ]
    cores = []
    for core in drawn.cores:
        tile_column, within_column = divmod(core.column, drawn.tile_columns)
        tile_row, within_row = divmod(core.row, drawn.tile_rows)
        left = tile_column * wide + gap / 2 + within_column * core_wide
        top = tile_row * tile_high + within_row * _CORE
        filled = max(2.0, core.share * _CORE)
        outline = _rectangle("core", left, top, core_wide, _CORE)
        parts = [outline, _rectangle("fill", left, top + _CORE - filled, core_wide, filled)]
        cores.append(
            {
                "parts": parts,
                "middle": left + core_wide / 2,
                "baseline": top + 17,
                "text": core.text,
            }
        )
    return _PIECES.piece("mesh", drawn, height=drawn.rows * tile_high, tiles=tiles, drawn=cores)


def _rectangle(kind: str, left: float, top: float, width: float, height: float) -> dict[str, Any]:
    return {"kind": kind, "left": left, "top": top, "width": width, "height": height}


def _axis(bottom: int, drawn: Plot | Raster) -> str:
    """Return the ticks of a horizontal axis with their texts, and the label below them."""
    down = {"top": bottom, "end": bottom + 4, "below": bottom + 17}
    ticks = []
    for at, text in drawn.x.places:
        anchor = "start" if at < 0.03 else "end" if at > 0.97 else "middle"
        ticks.append({"x": 100 * at, "anchor": anchor, "label": text, **down})
    return _PIECES.piece("axis", None, ticks=ticks, below=bottom + 33, label=drawn.x_label)
