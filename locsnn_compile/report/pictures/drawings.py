"""Drawings of the page, as inline SVG: bars, plots, rasters and meshes.

Lengths across are percentages, so a drawing is as wide as its place; lengths down are pixels. No drawing needs colour
to be understood: parts differ in pattern, dash, place or shape, and each drawing says itself in words.

A spike of both sides is a stroke as high as its row. One of the reference alone is a thick stroke in the upper half of
its row, one of the chip alone in the lower half. So the sides are told apart by place and width, not by colour.
"""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import accumulate, product

from locsnn_compile.report.content import Bar, Mesh, Plot, Raster, Span, Stack, Strokes
from locsnn_compile.report.format import plain

AXIS_HEIGHT = 38
"""Pixels that the horizontal axis takes below a picture: ticks, their texts and the label."""
_PATTERNS = (
    '<rect width="8" height="8" class="ink"/>',
    '<rect width="8" height="8" class="tint"/><path d="M-2 10L10 -2M-2 2L2 -2M6 10L10 6" class="line"/>',
    '<rect width="8" height="8" class="paper"/><circle cx="2" cy="2" r="1.3" class="ink"/>'
    '<circle cx="6" cy="6" r="1.3" class="ink"/>',
    '<rect width="8" height="8" class="tint"/><path d="M0 2H8M0 6H8" class="line"/>',
    '<rect width="8" height="8" class="paper"/><path d="M-2 -2L10 10M-2 10L10 -2" class="line"/>',
    '<rect width="8" height="8" class="paper"/><path d="M2 0V8M6 0V8" class="line"/>',
)
_FIRST, _LAST = 1.0, 99.0
"""Percent: where the axis of a span begins, at zero, and where it ends, at the largest value."""
_PLOT_TOP, _PLOT_HEIGHT = 16, 150
"""Pixels above the curves, and of the curves."""
_RASTER_TOP = 14
"""Pixels above the rows, for the flag."""
_KINDS = {"equal": (1, 6), "reference": (0, 4), "chip": (4, 4), "event": (1, 6)}
"""Where a stroke begins in its row of 8 units, and its length."""
_ROW = 8
_HIGH, _LOW = 300, 6
"""Pixels of a picture at the most, and of a row at the most."""
_CORE, _GAP = 26, 5
"""Pixels down: of a core, and between tiles."""


def words_of(text: str) -> str:
    """Return a string safe in text and in quoted attributes."""
    return escape(plain(text))


def percent(value: float) -> str:
    """Return a place across."""
    return f"{value:.2f}%"


def patterns() -> str:
    """Return the definitions that the other drawings refer to; once a page."""
    made = (
        f'<pattern id="p{i}" width="8" height="8" patternUnits="userSpaceOnUse">{body}</pattern>'
        for i, body in enumerate(_PATTERNS)
    )
    attributes = 'class="defs" width="0" height="0" aria-hidden="true" focusable="false"'
    return _svg(attributes, ["<defs>", *made, "</defs>"])


def bar(cell: Bar) -> str:
    """Return a track filled to the cell's share."""
    return _track("bar", 10, cell.label, [_part(0.0, cell.share, cell.pattern, 10)])


def stack(drawn: Stack) -> str:
    """Return one bar cut into its shares, each with its own pattern."""
    starts = accumulate((part.share for part in drawn.shares), initial=0.0)
    parts = [_part(start, part.share, part.pattern, 28) for start, part in zip(starts, drawn.shares, strict=False)]
    label = f"{drawn.label}: {'; '.join(part.label for part in drawn.shares) or 'nothing'}"
    return _track("stack", 28, label, parts)


def span(drawn: Span) -> str:
    """Return an axis from 0 to the largest value: a band from least to most, the median a stroke, the mean a dot."""
    top = max(drawn.values)
    shares = (value / top if top else 0.0 for value in drawn.values)
    least, median, mean, most = (percent(_FIRST + (_LAST - _FIRST) * share) for share in shares)
    label = f"{drawn.title}: {', '.join(f'{fact.label} {fact.value}' for fact in drawn.facts)}; drawn from 0"
    parts = (
        _line("axis", f"{_FIRST:.0f}%", f"{_LAST:.0f}%", 17, 17),
        _down("axis", f"{_FIRST:.0f}%", 12, 22),
        _line("band", least, most, 17, 17),
        _down("end", least, 10, 24),
        _down("end", most, 10, 24),
        _down("median", median, 4, 30),
        f'<circle class="mean" cx="{mean}" cy="17" r="5.5"/>',
    )
    return _named("span", 34, label, parts)


def mark(kind: str) -> str:
    """Return the sign of ``span`` for ``least``, ``median``, ``mean`` or ``most``, to stand next to its name."""
    if kind == "mean":
        return _mark(14, '<circle class="mean" cx="7" cy="7" r="4.5"/>')
    return _mark(14, _down("median", "7", 0, 14) if kind == "median" else _down("end", "7", 2, 12))


def plot(drawn: Plot) -> str:
    """Return curves over a grid: each with its own dash, labels of the vertical axis above its lines.

    The curves are drawn in a square of 100 by 100 that is stretched to its place; their strokes are not.
    """
    parts, labels, bottom = [], [], _PLOT_TOP + _PLOT_HEIGHT
    for at, label in drawn.y_ticks:
        y = _PLOT_TOP + (1.0 - at) * _PLOT_HEIGHT
        parts.append(_line("grid", "0%", "100%", f"{y:.1f}", f"{y:.1f}"))
        labels.append(f'<text class="tick" x="0%" y="{y - 3:.1f}">{words_of(label)}</text>')
    if drawn.marked is not None:
        parts.append(_down("marked", percent(100 * drawn.marked), _PLOT_TOP, bottom))
    curves = (_curve(i, curve.points) for i, curve in enumerate(drawn.curves))
    stretched = _stretched(_PLOT_TOP, _PLOT_HEIGHT, "0 0 100 100", curves)
    parts += [_axis(bottom, drawn.x_ticks, drawn.x_label), stretched, *labels]
    description = "; ".join(curve.label for curve in drawn.curves)
    return _framed("plot", bottom + AXIS_HEIGHT, drawn.title, description, parts)


def curve_mark(index: int) -> str:
    """Return a piece of the curve of a plot, to stand next to its label."""
    return _mark(26, _line(f"curve c{index}", "0", "26", 7, 7))


def raster(drawn: Raster) -> str:
    """Return the strokes over their axis; a dashed line and a ring at what is flagged."""
    pixels = min(float(_LOW + 2), max(1.0, _HIGH / max(1, drawn.rows)))
    height = round(pixels * drawn.rows)
    bottom = _RASTER_TOP + height
    strokes = (_strokes(one) for one in drawn.strokes)
    parts = [
        f'<rect class="ground" x="0%" y="{_RASTER_TOP}" width="100%" height="{height}"/>',
        _stretched(_RASTER_TOP, height, f"-.5 0 {drawn.columns} {_ROW * drawn.rows}", strokes),
    ]
    if drawn.flag is not None:
        column, row = drawn.flag
        place = (column + 0.5) / drawn.columns
        x, y = percent(100 * place), _RASTER_TOP + (row + 0.5) * pixels
        anchor, side = ("start", 6) if place < 0.5 else ("end", -6)
        parts += [
            _down("marked", x, 4, bottom),
            f'<circle class="ring" cx="{x}" cy="{y:.1f}" r="7"/>',
            _label("tick", anchor, x, 10, drawn.flag_label, f' dx="{side}"'),
        ]
    parts.append(_axis(bottom, drawn.x_ticks, drawn.x_label))
    return _framed("raster", bottom + AXIS_HEIGHT, drawn.title, drawn.description, parts)


def stroke_mark(kind: str) -> str:
    """Return a stroke in its row, to stand next to its label."""
    start, length = _KINDS[kind]
    stroke = f'<path class="stroke {kind}" d="M7 {3 + start}v{length}"/>'
    return _mark(14, f'<path class="grid" d="M0 2.5h14M0 11.5h14"/>{stroke}')


def mesh(drawn: Mesh) -> str:
    """Return tiles of cores; the number in a core is its use in percent."""
    wide = 100 / drawn.columns
    gap = wide * 0.08
    core_wide = (wide - gap) / drawn.tile_columns
    tile_high = _CORE * drawn.tile_rows + _GAP
    parts = [
        _rect("tile", column * wide + gap / 2, row * tile_high, wide - gap, _CORE * drawn.tile_rows)
        for row, column in product(range(drawn.rows), range(drawn.columns))
    ]
    for core in drawn.cores:
        tile_column, within_column = divmod(core.column, drawn.tile_columns)
        tile_row, within_row = divmod(core.row, drawn.tile_rows)
        left = tile_column * wide + gap / 2 + within_column * core_wide
        top = tile_row * tile_high + within_row * _CORE
        filled = max(2.0, core.share * _CORE)
        parts.append(_rect("core", left, top, core_wide, _CORE))
        parts.append(_rect("fill", left, top + _CORE - filled, core_wide, filled))
        parts.append(_label("value", "middle", percent(left + core_wide / 2), f"{top + 17:g}", core.text))
    return _framed("mesh", drawn.rows * tile_high, drawn.title, drawn.description, parts)


def _framed(kind: str, height: int, title: str, description: str, parts: Iterable[str]) -> str:
    """Return a picture that names and describes itself to who cannot see it."""
    words = f"<title>{words_of(title)}</title><desc>{words_of(description)}</desc>"
    return _svg(f'class="{kind}" width="100%" height="{height}" role="img"', [words, *parts])


def _named(kind: str, height: int, label: str, parts: Iterable[str]) -> str:
    """Return a small picture that one label describes."""
    return _svg(f'class="{kind}" width="100%" height="{height}" role="img" aria-label="{words_of(label)}"', parts)


def _svg(attributes: str, parts: Iterable[str]) -> str:
    return f"<svg {attributes}>{''.join(parts)}</svg>"


def _track(kind: str, height: int, label: str, parts: Iterable[str]) -> str:
    return _named(kind, height, label, [f'<rect class="track" width="100%" height="{height}"/>', *parts])


def _mark(width: int, body: str) -> str:
    return _svg(f'class="mark" width="{width}" height="14" aria-hidden="true" focusable="false"', [body])


def _stretched(top: int, height: int, view_box: str, parts: Iterable[str]) -> str:
    """Return a part whose own units are stretched to the width of the picture; strokes are not, if they say so."""
    place = f'x="0%" y="{top}" width="100%" height="{height}" viewBox="{view_box}"'
    return _svg(f'{place} preserveAspectRatio="none" aria-hidden="true"', parts)


def _axis(bottom: int, ticks: Sequence[tuple[float, str]], label: str) -> str:
    """Return the ticks of a horizontal axis at places 0..1 with their texts, and the label below them."""
    parts = []
    for at, text in ticks:
        anchor = "start" if at < 0.03 else "end" if at > 0.97 else "middle"
        x = percent(100 * at)
        parts += [_down("axis", x, bottom, bottom + 4), _label("tick", anchor, x, bottom + 17, text)]
    return "".join([*parts, _label("tick", "middle", "50%", bottom + 33, label)])


def _part(start: float, share: float, pattern: int, height: int) -> str:
    """Return a share of a track, filled with a pattern; there are few, so they come again."""
    if share <= 0:
        return ""
    place = f'x="{percent(100 * start)}" width="{percent(100 * min(share, 1.0))}" height="{height}"'
    return f'<rect class="part" {place} fill="url(#p{pattern % len(_PATTERNS)})"/>'


def _curve(index: int, points: tuple[tuple[float, float], ...]) -> str:
    path = " ".join(f"{100 * x:.4g},{100 * (1 - y):.4g}" for x, y in points)
    return f'<polyline class="curve c{index}" vector-effect="non-scaling-stroke" points="{path}"/>' if points else ""


def _strokes(one: Strokes) -> str:
    start, length = _KINDS[one.kind]
    path = "".join(f"M{column} {_ROW * row + start}v{length}" for column, row in one.points)
    return f'<path class="stroke {one.kind}" vector-effect="non-scaling-stroke" d="{path}"/>' if path else ""


def _line(kind: str, x1: str, x2: str, y1: float | str, y2: float | str) -> str:
    return f'<line class="{kind}" x1="{x1}" x2="{x2}" y1="{y1}" y2="{y2}"/>'


def _down(kind: str, x: str, top: float, bottom: float) -> str:
    return _line(kind, x, x, top, bottom)


def _label(kind: str, anchor: str, x: str, y: float | str, text: str, shift: str = "") -> str:
    return f'<text class="{kind}" text-anchor="{anchor}" x="{x}"{shift} y="{y}">{words_of(text)}</text>'


def _rect(kind: str, left: float, top: float, width: float, height: float) -> str:
    return f'<rect class="{kind}" x="{percent(left)}" y="{top:g}" width="{percent(width)}" height="{height:g}"/>'
