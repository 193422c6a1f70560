"""Draw the pictures of report.html as inline SVG: bars, spans, plots, rasters and meshes.

Horizontal lengths are percentages, so a drawing fills the width of the page, whatever that is; vertical lengths are
pixels, all chosen by hand. Drawings can be read without colour: parts differ in pattern, dash, place or shape, and each
drawing has a description in words for screen readers.

In a raster, a spike on both sides is a stroke as high as its row. A spike only in the reference is a thick stroke in
the upper half of its row, and one only on the chip in the lower half, so place and width tell the sides apart.
"""

from html import escape
from itertools import accumulate, product

from locsnn_compile.report.content import Bar, Mesh, MeshCore, Plot, Raster, Span, Stack, Strokes
from locsnn_compile.report.format import plain

AXIS_HEIGHT = 38
"""Pixels of the horizontal axis below a picture: its ticks, their texts and its label."""
_PATTERNS = 6
"""Number of patterns that parts are filled with, in turn; :func:`patterns` defines them."""
_BAR_HEIGHT = 10
"""Height of a bar in a table, in pixels."""
_STACK_HEIGHT = 28
"""Height of a bar that is cut into shares, in pixels."""
_SPAN_START = 1.0
"""Where the axis of a span begins, at zero, in percent of its width; the rest is room for half a mark."""
_SPAN_END = 99.0
"""Where the axis of a span ends, in percent of its width."""
_SPAN_AXIS = 29
"""Pixels from the top of a span to its axis."""
_SPAN_MARKS = 14
"""Pixels from the top of a span to the middle of its marks."""
_TICK_HEIGHT = 21
"""Height of the ticks of an axis with their texts, in pixels."""
_PLOT_TOP = 16
"""Pixels above the curves of a plot, for the label of the highest line."""
_PLOT_HEIGHT = 150
"""Height of the curves of a plot, in pixels."""
_RASTER_TOP = 14
"""Pixels above the rows of a raster, for the flag."""
_ROW = 8
"""Units of a row of a raster, which is stretched to its pixels."""
_STROKES = {"equal": (1, 6), "reference": (0, 4), "chip": (4, 4), "event": (1, 6)}
"""Where a stroke of each kind begins in its row, and its length, in units of the row."""
_PICTURE_HEIGHT = 300
"""Pixels that the rows of a raster share; with more than 300 rows it is higher, because a row has a pixel at least."""
_HIGHEST_ROW = 8
"""Most pixels of a row of a raster."""
_LOWEST_ROW = 1
"""Fewest pixels of a row of a raster."""
_CORE_HEIGHT = 26
"""Height of a core of a mesh, in pixels."""
_TILE_GAP = 5
"""Pixels between a tile of a mesh and the next below."""
_TILE_GAP_SHARE = 0.08
"""Room between two tiles side by side, as a share of the width of a tile."""
_MARK_HEIGHT = 14
"""Height of a mark in a legend, in pixels."""


def patterns() -> str:
    """Return the definitions of the patterns ``p0``, ``p1``, ... that other drawings refer to, needed once per page."""
    # Full, rising stripes, dots, lying stripes, a lattice, standing stripes.
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
    definitions = "".join(
        f'<pattern id="p{i}" width="8" height="8" patternUnits="userSpaceOnUse">{fill}</pattern>'
        for i, fill in enumerate(fills)
    )
    return (
        '<svg class="defs" width="0" height="0" aria-hidden="true" focusable="false">'
        f"<defs>{definitions}</defs></svg>"
    )


def bar(cell: Bar) -> str:
    """Return a bar, filled up to the cell's share or, with ``full_at``, by what the share lacks of 1."""
    filling = Bar(cell.drawn, cell.label, cell.pattern)
    kind = "bar" if cell.full_at is None else "bar lack"
    return _track(kind, _BAR_HEIGHT, cell.label, _part(0.0, filling, _BAR_HEIGHT))


def stack(drawn: Stack) -> str:
    """Return one bar cut into its shares, each with its own pattern."""
    shares = [part.share or 0.0 for part in drawn.shares]
    starts = [0.0, *accumulate(shares)]
    # The last start is the end of the last part, so there is one more than parts.
    parts = "".join(
        _part(start, part, _STACK_HEIGHT) for start, part in zip(starts, drawn.shares, strict=False)
    )
    part_labels = "; ".join(part.label for part in drawn.shares) or "nothing"
    return _track("stack", _STACK_HEIGHT, f"{drawn.label}: {part_labels}", parts)


def _track(kind: str, height: int, label: str, parts: str) -> str:
    """Return an empty bar with parts on it; ``label`` is for screen readers."""
    return (
        f'<svg class="{kind}" width="100%" height="{height}" role="img"'
        f' aria-label="{_text(label)}">'
        f'<rect class="track" width="100%" height="{height}"/>{parts}</svg>'
    )


def _part(start: float, part: Bar, height: int) -> str:
    """Return a part of a bar from ``start`` (0..1) on, filled with its pattern; nothing without a share above 0."""
    if not part.share:
        return ""
    x = _percent(100 * start)
    # A share may exceed 1 where more is used than there is.
    width = _percent(100 * min(part.share, 1.0))
    pattern = part.pattern % _PATTERNS
    return f'<rect class="part" x="{x}" width="{width}" height="{height}" fill="url(#p{pattern})"/>'


def span(drawn: Span) -> str:
    """Return an axis from 0, with a band from least to most, a stroke at the median, and a dot at the mean."""
    places = [_span_percent(drawn.axis.place(value)) for value in drawn.values]
    least, median, mean, most = map(_percent, places)
    ticks = "".join(
        _axis_tick(_span_percent(place) / 100, text, _SPAN_AXIS)
        for place, text in drawn.axis.places
    )
    facts = ", ".join(f"{fact.label} {fact.value}" for fact in drawn.facts)
    label = _text(f"{drawn.title}: {facts}; drawn from 0")
    return (
        f'<svg class="span" width="100%" height="{_SPAN_AXIS + _TICK_HEIGHT}" role="img"'
        f' aria-label="{label}">'
        f'<line class="axis" x1="{_SPAN_START:g}%" x2="{_SPAN_END:g}%"'
        f' y1="{_SPAN_AXIS}" y2="{_SPAN_AXIS}"/>{ticks}'
        f'<line class="band" x1="{least}" x2="{most}" y1="{_SPAN_MARKS}" y2="{_SPAN_MARKS}"/>'
        f"{_span_line('end', least, 7)}"
        f"{_span_line('end', most, 7)}"
        f"{_span_line('median', median, 13)}"
        f'<circle class="mean" cx="{mean}" cy="{_SPAN_MARKS}" r="5.5"/></svg>'
    )


def _span_line(kind: str, x: str, half_height: int) -> str:
    """Return an upright line through the marks of a span; ``half_height`` is in pixels."""
    top = _SPAN_MARKS - half_height
    bottom = _SPAN_MARKS + half_height
    return f'<line class="{kind}" x1="{x}" x2="{x}" y1="{top}" y2="{bottom}"/>'


def _span_percent(share: float) -> float:
    """Return where a share (0..1) of the axis of a span lies, in percent of the width of the drawing."""
    return _SPAN_START + (_SPAN_END - _SPAN_START) * share


def span_mark(kind: str) -> str:
    """Return the mark of ``least``, ``median``, ``mean`` or ``most`` in a span, for its legend."""
    if kind == "mean":
        return _mark(14, '<circle class="mean" cx="7" cy="7" r="4.5"/>')
    if kind == "median":
        return _mark(14, '<line class="median" x1="7" x2="7" y1="0" y2="14"/>')
    return _mark(14, '<line class="end" x1="7" x2="7" y1="2" y2="12"/>')


def curve_mark(index: int) -> str:
    """Return a sample of a curve, for the legend of its plot; ``index`` is its number in the plot."""
    return _mark(26, f'<line class="curve c{index}" x1="0" x2="26" y1="7" y2="7"/>')


def stroke_mark(kind: str) -> str:
    """Return a stroke in its row, for the legend of a raster."""
    start, length = _STROKES[kind]
    # The row lies 3 pixels below the top of the mark, between two thin lines.
    return _mark(
        14,
        '<path class="grid" d="M0 2.5h14M0 11.5h14"/>'
        f'<path class="stroke {kind}" d="M7 {3 + start}v{length}"/>',
    )


def _mark(width: int, inside: str) -> str:
    """Return a small drawing of ``width`` pixels for a legend."""
    return (
        f'<svg class="mark" width="{width}" height="{_MARK_HEIGHT}"'
        ' aria-hidden="true" focusable="false">'
        f"{inside}</svg>"
    )


def plot(drawn: Plot) -> str:
    """Return curves over a grid, each with its own dash; labels of the vertical axis stand above its lines.

    Curves are drawn in a square of 100 by 100 units that is stretched to the width of the page. Percentages, as in the
    other drawings, are not possible in a polyline. The strokes are not stretched.
    """
    bottom = _PLOT_TOP + _PLOT_HEIGHT
    ticks = [(_PLOT_TOP + (1.0 - place) * _PLOT_HEIGHT, label) for place, label in drawn.y.places]
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
    """Return a line through points, given as shares (0..1) from the lower left corner; nothing without points."""
    if not points:
        return ""
    path = " ".join(f"{100 * x:.4g},{100 * (1 - y):.4g}" for x, y in points)
    return f'<polyline class="curve c{index}" vector-effect="non-scaling-stroke" points="{path}"/>'


def _marked_line(x: float, top: int, bottom: int) -> str:
    """Return a dashed upright line at ``x`` percent of the width."""
    return f'<line class="marked" x1="{_percent(x)}" x2="{_percent(x)}" y1="{top}" y2="{bottom}"/>'


def raster(drawn: Raster) -> str:
    """Return spikes as strokes over their axis, with a dashed line and a ring at the flag.

    Strokes are drawn in units, a column wide and :data:`_ROW` high each, and stretched to their place. A stroke
    stands at the whole number of its column, so the units begin at -0.5.
    """
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
    """Return the height of a row in pixels, in a raster of ``rows`` rows."""
    share_of_picture = _PICTURE_HEIGHT / max(1, rows)
    return min(max(share_of_picture, float(_LOWEST_ROW)), float(_HIGHEST_ROW))


def _strokes(strokes: Strokes) -> str:
    """Return all strokes of a kind as one path, which keeps the page small; nothing without strokes."""
    start, length = _STROKES[strokes.kind]
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
    # The label stands on the side of the line where there is more room.
    anchor, shift = ("start", 6) if place < 0.5 else ("end", -6)
    return (
        f"{_marked_line(100 * place, 4, bottom)}"
        f'<circle class="ring" cx="{x}" cy="{y:.1f}" r="7"/>'
        f'<text class="tick" text-anchor="{anchor}" x="{x}" dx="{shift}" y="10">'
        f"{_text(drawn.flag_label)}</text>"
    )


def _axis(bottom: int, drawn: Plot | Raster) -> str:
    """Return the ticks of a horizontal axis with their texts, and the name of the axis below them."""
    ticks = "".join(_axis_tick(place, label, bottom) for place, label in drawn.x.places)
    name_y = bottom + 33
    return (
        f'{ticks}<text class="tick" text-anchor="middle" x="50%" y="{name_y}">'
        f"{_text(drawn.x_label)}</text>"
    )


def _axis_tick(place: float, label: str, bottom: int) -> str:
    """Return a tick at ``place`` (0..1) of the width, with its text below; ``bottom`` is the axis's y in pixels."""
    x = _percent(100 * place)
    # A text within 3 % of an end would stick out of the picture if it were centred.
    anchor = "middle"
    if place < 0.03:
        anchor = "start"
    elif place > 0.97:
        anchor = "end"
    tick_end = bottom + 4
    text_y = bottom + 17
    return (
        f'<line class="axis" x1="{x}" x2="{x}" y1="{bottom}" y2="{tick_end}"/>'
        f'<text class="tick" text-anchor="{anchor}" x="{x}" y="{text_y}">{_text(label)}</text>'
    )


def mesh(drawn: Mesh) -> str:
    """Return tiles with their cores; the number in a core is its use in percent.

    Lengths across are in percent of the width, and lengths down in pixels.
    """
    tile_width = 100 / drawn.columns
    gap = tile_width * _TILE_GAP_SHARE
    core_width = (tile_width - gap) / drawn.tile_columns
    cores_height = _CORE_HEIGHT * drawn.tile_rows
    tile_height = cores_height + _TILE_GAP
    tiles = "".join(
        _rectangle(
            "tile",
            left=column * tile_width + gap / 2,
            top=row * tile_height,
            width=tile_width - gap,
            height=cores_height,
        )
        for row, column in product(range(drawn.rows), range(drawn.columns))
    )
    cores = ""
    for core in drawn.cores:
        tile_column, column_in_tile = divmod(core.column, drawn.tile_columns)
        tile_row, row_in_tile = divmod(core.row, drawn.tile_rows)
        left = tile_column * tile_width + gap / 2 + column_in_tile * core_width
        top = tile_row * tile_height + row_in_tile * _CORE_HEIGHT
        cores += _core(core, left, top, core_width)
    return (
        f'<svg class="mesh" width="100%" height="{drawn.rows * tile_height}" role="img">'
        f"<title>{_text(drawn.title)}</title><desc>{_text(drawn.description)}</desc>"
        f"{tiles}{cores}</svg>"
    )


def _core(core: MeshCore, left: float, top: float, width: float) -> str:
    """Return a core, filled from below to its share, with its text."""
    # At least 2 pixels, so that a core in use never looks free.
    filled_height = max(2.0, core.share * _CORE_HEIGHT)
    fill_top = top + _CORE_HEIGHT - filled_height
    text_y = top + 17
    return (
        f"{_rectangle('core', left, top, width, _CORE_HEIGHT)}"
        f"{_rectangle('fill', left, fill_top, width, filled_height)}"
        f'<text class="value" text-anchor="middle" x="{_percent(left + width / 2)}"'
        f' y="{text_y:g}">{_text(core.text)}</text>'
    )


def _rectangle(kind: str, left: float, top: float, width: float, height: float) -> str:
    """Return a rectangle of a style class; ``left`` and ``width`` in percent, ``top`` and ``height`` in pixels."""
    return (
        f'<rect class="{kind}" x="{_percent(left)}" y="{top:g}"'
        f' width="{_percent(width)}" height="{height:g}"/>'
    )


def _percent(value: float) -> str:
    """Return a horizontal place or length in percent as SVG writes it."""
    return f"{value:.2f}%"


def _text(text: str) -> str:
    """Return a string that is safe in text and in quoted attributes."""
    return escape(plain(text))
