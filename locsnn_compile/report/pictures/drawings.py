"""Drawings of the page as inline SVG: bars, plots, rasters and meshes.

Horizontal lengths are percentages, so a drawing fills its width; vertical lengths are pixels. Drawings can be read
without colour: parts differ in pattern, dash, place or shape, and each drawing has a description in words.

A spike on both sides is a stroke as high as its row. A spike only in the reference is a thick stroke in the upper half
of its row, and one only on the chip in the lower half, so place and width tell the sides apart.
"""

from html import escape
from itertools import accumulate, product

from locsnn_compile.report.content import Bar, Mesh, MeshCore, Plot, Raster, Span, Stack, Strokes
from locsnn_compile.report.format import plain

AXIS_HEIGHT = 38
"""Pixels of the horizontal axis below a picture: its ticks, their texts and its label."""
_PATTERNS = 6
"""Patterns that parts are filled with, in turn; :func:`patterns` defines them."""
_FIRST, _LAST = 1.0, 99.0
"""Places in percent where the axis of a span begins, at zero, and ends."""
_SPAN_AXIS, _TICK_HEIGHT = 29, 21
"""Pixels from the top of a span to its axis, and of the ticks of an axis with their texts."""
_PLOT_TOP, _PLOT_HEIGHT = 16, 150
"""Pixels above the curves, and of the curves."""
_RASTER_TOP = 14
"""Pixels above the rows, for the flag."""
_KINDS = {"equal": (1, 6), "reference": (0, 4), "chip": (4, 4), "event": (1, 6)}
"""Start of a stroke in its row of 8 units, and its length."""
_ROW = 8
_PICTURE_HEIGHT = 300
"""Pixels that the rows of a picture share; with more than 300 rows it is higher, because a row has a pixel at least."""
_HIGHEST_ROW = 8
"""Most pixels of a row, of which 2 are the gap below it."""
_LOWEST_ROW = 1
"""Fewest pixels of a row."""
_CORE, _GAP = 26, 5
"""Vertical pixels of a core, and between tiles."""


def patterns() -> str:
    """Return the definitions that the other drawings refer to, needed once per page."""
    fills = (
        '<rect width="8" height="8" class="ink"/>',
        '<rect width="8" height="8" class="tint"/>'
        '<path d="M-2 10L10 -2M-2 2L2 -2M6 10L10 6" class="line"/>',
        '<rect width="8" height="8" class="paper"/>'
        '<circle cx="2" cy="2" r="1.3" class="ink"/><circle cx="6" cy="6" r="1.3" class="ink"/>',
        '<rect width="8" height="8" class="tint"/><path d="M0 2H8M0 6H8" class="line"/>',
        '<rect width="8" height="8" class="paper"/>'
        '<path d="M-2 -2L10 10M-2 10L10 -2" class="line"/>',
        '<rect width="8" height="8" class="paper"/><path d="M2 0V8M6 0V8" class="line"/>',
    )
    defined = "".join(
        f'<pattern id="p{i}" width="8" height="8" patternUnits="userSpaceOnUse">{fill}</pattern>'
        for i, fill in enumerate(fills)
    )
    return (
        '<svg class="defs" width="0" height="0" aria-hidden="true" focusable="false">'
        f"<defs>{defined}</defs></svg>"
    )


def bar(cell: Bar) -> str:
    """Return a track filled up to the cell's share, or by what it lacks."""
    filling = Bar(cell.drawn, cell.label, cell.pattern)
    kind = "bar" if cell.full_at is None else "bar lack"
    return _track(kind, 10, cell.label, _part(0.0, filling, 10))


def stack(drawn: Stack) -> str:
    """Return one bar cut into its shares, each with its own pattern."""
    starts = accumulate((part.share or 0.0 for part in drawn.shares), initial=0.0)
    parts = "".join(
        _part(start, part, 28) for start, part in zip(starts, drawn.shares, strict=False)
    )
    label = f"{drawn.label}: {'; '.join(part.label for part in drawn.shares) or 'nothing'}"
    return _track("stack", 28, label, parts)


def _track(kind: str, height: int, label: str, parts: str) -> str:
    return (
        f'<svg class="{kind}" width="100%" height="{height}" role="img"'
        f' aria-label="{_text(label)}">'
        f'<rect class="track" width="100%" height="{height}"/>{parts}</svg>'
    )


def _part(start: float, part: Bar, height: int) -> str:
    """Return a share of a track, filled with a pattern; nothing for no share or a share of 0."""
    if not part.share:
        return ""
    x = _percent(100 * start)
    width = _percent(100 * min(part.share, 1.0))
    pattern = part.pattern % _PATTERNS
    return f'<rect class="part" x="{x}" width="{width}" height="{height}" fill="url(#p{pattern})"/>'


def span(drawn: Span) -> str:
    """Return an axis from 0, with a band from least to most, a stroke at the median, and a dot at the mean."""
    places = (_span_place(drawn.axis.place(value)) for value in drawn.values)
    least, median, mean, most = (_percent(place) for place in places)
    ticks = "".join(
        _axis_tick(_span_place(place) / 100, text, _SPAN_AXIS) for place, text in drawn.axis.places
    )
    facts = ", ".join(f"{fact.label} {fact.value}" for fact in drawn.facts)
    label = _text(f"{drawn.title}: {facts}; drawn from 0")
    return (
        f'<svg class="span" width="100%" height="{_SPAN_AXIS + _TICK_HEIGHT}" role="img"'
        f' aria-label="{label}">'
        f'<line class="axis" x1="1%" x2="99%" y1="{_SPAN_AXIS}" y2="{_SPAN_AXIS}"/>{ticks}'
        f'<line class="band" x1="{least}" x2="{most}" y1="14" y2="14"/>'
        f'<line class="end" x1="{least}" x2="{least}" y1="7" y2="21"/>'
        f'<line class="end" x1="{most}" x2="{most}" y1="7" y2="21"/>'
        f'<line class="median" x1="{median}" x2="{median}" y1="1" y2="27"/>'
        f'<circle class="mean" cx="{mean}" cy="14" r="5.5"/></svg>'
    )


def _span_place(share: float) -> float:
    """Return where a share of the axis of a span lies, in percent of its width."""
    return _FIRST + (_LAST - _FIRST) * share


def span_mark(kind: str) -> str:
    """Return the sign of ``least``, ``median``, ``mean`` or ``most`` in a ``span``, to stand next to its name."""
    if kind == "mean":
        return _mark(14, '<circle class="mean" cx="7" cy="7" r="4.5"/>')
    if kind == "median":
        return _mark(14, '<line class="median" x1="7" x2="7" y1="0" y2="14"/>')
    return _mark(14, '<line class="end" x1="7" x2="7" y1="2" y2="12"/>')


def curve_mark(index: int) -> str:
    """Return a sample of a curve, to stand next to its label."""
    return _mark(26, f'<line class="curve c{index}" x1="0" x2="26" y1="7" y2="7"/>')


def stroke_mark(kind: str) -> str:
    """Return a stroke in its row, to stand next to its label."""
    start, length = _KINDS[kind]
    return _mark(
        14,
        '<path class="grid" d="M0 2.5h14M0 11.5h14"/>'
        f'<path class="stroke {kind}" d="M7 {3 + start}v{length}"/>',
    )


def _mark(width: int, inside: str) -> str:
    return (
        f'<svg class="mark" width="{width}" height="14" aria-hidden="true" focusable="false">'
        f"{inside}</svg>"
    )


def plot(drawn: Plot) -> str:
    """Return curves over a grid, each with its own dash; labels of the vertical axis stand above its lines.

    Curves are drawn in a square of 100 by 100 that is stretched to its place, but their strokes are not stretched.
    """
    bottom = _PLOT_TOP + _PLOT_HEIGHT
    ticks = [(_PLOT_TOP + (1.0 - at) * _PLOT_HEIGHT, label) for at, label in drawn.y.places]
    grid = "".join(
        f'<line class="grid" x1="0%" x2="100%" y1="{y:.1f}" y2="{y:.1f}"/>' for y, _ in ticks
    )
    labels = "".join(
        f'<text class="tick" x="0%" y="{y - 3:.1f}">{_text(label)}</text>' for y, label in ticks
    )
    marked = ""
    if drawn.marked is not None:
        marked = _marked_line(100 * drawn.x.place(drawn.marked), _PLOT_TOP, bottom)
    curves = "".join(_curve(i, drawn.placed(curve)) for i, curve in enumerate(drawn.curves))
    description = "; ".join(curve.label for curve in drawn.curves)
    return (
        f'<svg class="plot" width="100%" height="{bottom + AXIS_HEIGHT}" role="img">'
        f"<title>{_text(drawn.title)}</title><desc>{_text(description)}</desc>"
        f"{grid}{marked}{_axis(bottom, drawn)}"
        f'<svg x="0%" y="{_PLOT_TOP}" width="100%" height="{_PLOT_HEIGHT}"'
        ' viewBox="0 0 100 100" preserveAspectRatio="none" aria-hidden="true">'
        f"{curves}</svg>{labels}</svg>"
    )


def _curve(index: int, points: list[tuple[float, float]]) -> str:
    """Return a line through points, 0..1 from the lower left corner; nothing without points."""
    if not points:
        return ""
    path = " ".join(f"{100 * x:.4g},{100 * (1 - y):.4g}" for x, y in points)
    return f'<polyline class="curve c{index}" vector-effect="non-scaling-stroke" points="{path}"/>'


def _marked_line(x: float, top: int, bottom: int) -> str:
    """Return a dashed upright line at a place in percent."""
    return f'<line class="marked" x1="{_percent(x)}" x2="{_percent(x)}" y1="{top}" y2="{bottom}"/>'


def raster(drawn: Raster) -> str:
    """Return the strokes over their axis, with a dashed line and a ring at the flag."""
    row_height = _row_height(drawn.rows)
    height = round(row_height * drawn.rows)
    bottom = _RASTER_TOP + height
    strokes = "".join(_strokes(strokes) for strokes in drawn.strokes)
    return (
        f'<svg class="raster" width="100%" height="{bottom + AXIS_HEIGHT}" role="img">'
        f"<title>{_text(drawn.title)}</title><desc>{_text(drawn.description)}</desc>"
        f'<rect class="ground" x="0%" y="{_RASTER_TOP}" width="100%" height="{height}"/>'
        f'<svg x="0%" y="{_RASTER_TOP}" width="100%" height="{height}"'
        f' viewBox="-.5 0 {drawn.columns} {_ROW * drawn.rows}" preserveAspectRatio="none"'
        f' aria-hidden="true">{strokes}</svg>'
        f"{_flag(drawn, row_height, bottom)}{_axis(bottom, drawn)}</svg>"
    )


def _row_height(rows: int) -> float:
    """Return the pixels of each of ``rows`` rows."""
    shared = _PICTURE_HEIGHT / max(1, rows)
    return min(max(shared, float(_LOWEST_ROW)), float(_HIGHEST_ROW))


def _strokes(strokes: Strokes) -> str:
    """Return all strokes of a kind as one path; nothing without strokes."""
    start, length = _KINDS[strokes.kind]
    path = "".join(f"M{column} {_ROW * row + start}v{length}" for column, row in strokes.points)
    if not path:
        return ""
    return f'<path class="stroke {strokes.kind}" vector-effect="non-scaling-stroke" d="{path}"/>'


def _flag(drawn: Raster, row_height: float, bottom: int) -> str:
    """Return a dashed line, a ring and a label at the flag of a raster; nothing without a flag."""
    if drawn.flag is None:
        return ""
    column, row = drawn.flag
    place = (column + 0.5) / drawn.columns
    x = _percent(100 * place)
    y = _RASTER_TOP + (row + 0.5) * row_height
    anchor, shift = ("start", 6) if place < 0.5 else ("end", -6)
    return (
        f"{_marked_line(100 * place, 4, bottom)}"
        f'<circle class="ring" cx="{x}" cy="{y:.1f}" r="7"/>'
        f'<text class="tick" text-anchor="{anchor}" x="{x}" dx="{shift}" y="10">'
        f"{_text(drawn.flag_label)}</text>"
    )


def _axis(bottom: int, drawn: Plot | Raster) -> str:
    """Return the ticks of a horizontal axis with their texts, and the label below them."""
    ticks = "".join(_axis_tick(place, label, bottom) for place, label in drawn.x.places)
    return (
        f'{ticks}<text class="tick" text-anchor="middle" x="50%" y="{bottom + 33}">'
        f"{_text(drawn.x_label)}</text>"
    )


def _axis_tick(place: float, label: str, bottom: int) -> str:
    """Return a tick at a place of 0..1; at both ends its text stays within the picture."""
    x = _percent(100 * place)
    anchor = "middle"
    if place < 0.03:
        anchor = "start"
    elif place > 0.97:
        anchor = "end"
    return (
        f'<line class="axis" x1="{x}" x2="{x}" y1="{bottom}" y2="{bottom + 4}"/>'
        f'<text class="tick" text-anchor="{anchor}" x="{x}" y="{bottom + 17}">{_text(label)}</text>'
    )


def mesh(drawn: Mesh) -> str:
    """Return tiles with their cores; the number in a core is its use in percent."""
    tile_width = 100 / drawn.columns
    gap = tile_width * 0.08
    core_width = (tile_width - gap) / drawn.tile_columns
    cores_height = _CORE * drawn.tile_rows
    tile_height = cores_height + _GAP
    tiles = "".join(
        _rectangle(
            "tile",
            column * tile_width + gap / 2,
            row * tile_height,
            tile_width - gap,
            cores_height,
        )
        for row, column in product(range(drawn.rows), range(drawn.columns))
    )
    cores = ""
    for core in drawn.cores:
        tile_column, column_in_tile = divmod(core.column, drawn.tile_columns)
        tile_row, row_in_tile = divmod(core.row, drawn.tile_rows)
        left = tile_column * tile_width + gap / 2 + column_in_tile * core_width
        top = tile_row * tile_height + row_in_tile * _CORE
        cores += _core(core, left, top, core_width)
    return (
        f'<svg class="mesh" width="100%" height="{drawn.rows * tile_height}" role="img">'
        f"<title>{_text(drawn.title)}</title><desc>{_text(drawn.description)}</desc>"
        f"{tiles}{cores}</svg>"
    )


def _core(core: MeshCore, left: float, top: float, width: float) -> str:
    """Return a core, filled from below to its share, with its text."""
    filled = max(2.0, core.share * _CORE)
    return (
        f"{_rectangle('core', left, top, width, _CORE)}"
        f"{_rectangle('fill', left, top + _CORE - filled, width, filled)}"
        f'<text class="value" text-anchor="middle" x="{_percent(left + width / 2)}"'
        f' y="{top + 17:g}">{_text(core.text)}</text>'
    )


def _rectangle(kind: str, left: float, top: float, width: float, height: float) -> str:
    """Return a rectangle: across in percent, down in pixels."""
    return (
        f'<rect class="{kind}" x="{_percent(left)}" y="{top:g}"'
        f' width="{_percent(width)}" height="{height:g}"/>'
    )


def _percent(value: float) -> str:
    """Return a horizontal place or length."""
    return f"{value:.2f}%"


def _text(text: str) -> str:
    """Return a string that is safe in text and in quoted attributes."""
    return escape(plain(text))
