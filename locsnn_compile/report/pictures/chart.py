"""Draw charts as SVG files: one or more panels (pairs of axes) side by side, with a title above them.

``draw`` makes a chart of curves; ``scatter.py`` uses the rest of this module for charts of marks. A chart follows the
reader's light or dark scheme and prints in black, and it can be read without colour: curves have different dashes.

The picture from top to bottom, in pixels: title and subtitle (``_TOP``), panels (``HEIGHT``) with the texts of
their horizontal axis below, then the legend. Inside a panel, (0, 0) is its upper left corner and y grows downwards. All
sizes are chosen by hand.
"""

from collections.abc import Sequence
from typing import Literal

from hw_model.io.xml_text import escaped, xml_file
from hw_model.texts.templates import filled
from hw_model.values import Frozen
from locsnn_compile.report.content import Curve
from locsnn_compile.report.pictures.axis import Axis, linear_axis, log_axis

WIDTH = 340
"""Width of a panel in pixels."""
HEIGHT = 240
"""Height of a panel in pixels."""
RIGHT = 18
"""Pixels to the right of the last panel, for half of its last label."""
_GAP = 72
"""Pixels to the left of each panel, for the labels of its vertical axis."""
_TOP = 70
"""Pixels above the panels, for the title, the subtitle and the titles of panels."""
BOTTOM = _TOP + HEIGHT
"""Pixels from the top of the picture to the lower edge of its panels."""
_MARGIN = 16
"""Pixels from the left edge of the picture to the title and the subtitle."""
_TITLE_Y = 22
"""Pixels from the top of the picture to the baseline of the title."""
_SUBTITLE_Y = 39
"""Pixels from the top of the picture to the baseline of the subtitle."""
_TICK = 4
"""Length of a tick in pixels."""
_TICK_TEXT_Y = 17
"""Pixels from the lower edge of a panel to the baseline of the texts of ticks."""
_AXIS_LABEL_Y = 34
"""Pixels from the lower edge of a panel to the baseline of the name of its horizontal axis."""
HALF_LETTER = 4
"""Pixels from the middle of a letter to its baseline, to centre a text of 11 pixels on a line."""
_LEGEND = 56
"""Pixels from the lower edge of the panels to the baseline of the first line of the legend."""
_LINE = 16
"""Height of a line of the legend in pixels."""
_SAMPLE = 26
"""Length of a curve's sample in the legend in pixels."""
Point = tuple[float, float]
"""x and y, as values of the axes or as pixels."""
Anchor = Literal["start", "middle", "end"]
"""Which end of a text stands at its x, as SVG's ``text-anchor``."""


def sheet(width: int, height: int, title: str, style: str, inside: str) -> bytes:
    """Return an SVG file with a title, shown above and as metadata.

    ``style`` names the CSS file of this folder that the picture needs in addition to ``sheet.css``; ``inside`` is
    SVG markup.
    """
    rules = filled(__package__, "sheet.css") + filled(__package__, style)
    title_markup = escaped(title)
    markup = f"""\
<svg viewBox="0 0 {width} {height}" role="img"><title>{title_markup}</title>
<style>
{rules}</style>
<rect class="paper" width="{width}" height="{height}"/>
<text class="title" x="{_MARGIN:.1f}" y="{_TITLE_Y:.1f}" text-anchor="start">{title_markup}</text>
{inside}</svg>"""
    return xml_file(markup, xmlns="http://www.w3.org/2000/svg")


def chart(
    title: str, subtitle: str, style: str, panels: Sequence[str], below: int, legend: str = ""
) -> bytes:
    """Return a chart as an SVG file: panels side by side, with ``below`` pixels under them for ``legend``.

    ``panels`` and ``legend`` are SVG markup: panels around their own upper left corner, the legend around that of
    the picture.
    """
    column_width = _GAP + WIDTH
    placed_panels = "".join(
        f'<g transform="translate({i * column_width + _GAP} {_TOP})">{panel}</g>'
        for i, panel in enumerate(panels)
    )
    inside = f"{soft_text(_MARGIN, _SUBTITLE_Y, 'start', subtitle)}{placed_panels}{legend}"
    width = len(panels) * column_width + RIGHT
    return sheet(width, BOTTOM + below, title, style, inside)


def axes(title: str, x_label: str, x: Axis, y: Axis) -> str:
    """Draw the axes of a panel, with the title of the panel above."""
    rows = "".join(_axis_row(HEIGHT * (1 - place), label) for place, label in y.places)
    columns = "".join(_axis_column(WIDTH * place, label) for place, label in x.places)
    title_y = -10  # above the panel
    return f"""\
{soft_text(0, title_y, "start", title)}
{rows}{columns}{polyline("frame", [(0, HEIGHT), (WIDTH, HEIGHT)])}
{soft_text(WIDTH / 2, HEIGHT + _AXIS_LABEL_Y, "middle", x_label)}
"""


def _axis_row(y: float, label: str) -> str:
    """Draw a line across a panel, with its label to the left."""
    line = polyline("grid", [(0, y), (WIDTH, y)])
    label_x = -7  # to the left of the panel
    return line + soft_text(label_x, y + HALF_LETTER, "end", label)


def _axis_column(x: float, label: str) -> str:
    """Draw a tick at the lower edge of a panel, with its label below."""
    tick = polyline("frame", [(x, HEIGHT), (x, HEIGHT + _TICK)])
    return tick + soft_text(x, HEIGHT + _TICK_TEXT_Y, "middle", label)


def soft_text(x: float, y: float, anchor: Anchor, text: str) -> str:
    """Write a text in the soft colour, that of labels and legends."""
    return (
        f'<text class="soft" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escaped(text)}</text>'
    )


def polyline(kind: str, corners: Sequence[Point]) -> str:
    """Draw a line through corners; ``kind`` is its class in the style sheets."""
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    return f'<polyline class="{kind}" points="{points}"/>'


def places(x: Axis, y: Axis, points: Sequence[Point]) -> list[Point]:
    """Return points, given as values of the two axes, in pixels of their panel.

    The place of a value on an axis is a share of the length of the axis, from 0 to 1.
    """
    return [
        (WIDTH * x.place(x_value), HEIGHT * (1 - y.place(y_value))) for x_value, y_value in points
    ]


class Panel(Frozen):
    """Curves over common axes, each linear or logarithmic; a logarithmic axis leaves out values of 0 and below.

    ``title`` says what y is: the vertical axis has no name. curves.css has
    styles for five curves: more of them look alike.
    """

    title: str
    x_label: str
    curves: tuple[Curve, ...]
    x_log: bool = True
    y_log: bool = True


def draw(title: str, panels: Sequence[Panel]) -> bytes:
    """Return a chart of curves as an SVG file; equal input gives equal bytes."""
    # Each panel has a legend of its own, with a line per curve.
    below = _LEGEND + _LINE * max(len(panel.curves) for panel in panels)
    return chart(title, "", "curves.css", [_panel(panel) for panel in panels], below)


def _panel(panel: Panel) -> str:
    """Draw a panel: its axes, its curves and their legend."""
    points_by_curve = [_points_on_axes(curve, panel) for curve in panel.curves]
    all_points = [point for points in points_by_curve for point in points]
    x_axis = _axis_of([x for x, _ in all_points], log=panel.x_log)
    y_axis = _axis_of([y for _, y in all_points], log=panel.y_log)
    drawn = axes(panel.title, panel.x_label, x_axis, y_axis)
    for number, curve in enumerate(panel.curves):
        pixels = places(x_axis, y_axis, points_by_curve[number])
        drawn += _curve(number, curve.label, pixels)
    return drawn


def _points_on_axes(curve: Curve, panel: Panel) -> list[Point]:
    """Return the points of a curve that the axes of its panel can show."""
    return [(x, y) for x, y in curve.points if _is_on(panel, x, y)]


def _is_on(panel: Panel, x: float, y: float) -> bool:
    x_is_on = x > 0 or not panel.x_log
    y_is_on = y > 0 or not panel.y_log
    return x_is_on and y_is_on


def _axis_of(values: Sequence[float], *, log: bool) -> Axis:
    return log_axis(values, _figure) if log else linear_axis(values, _figure)


def _curve(number: int, label: str, points: Sequence[Point]) -> str:
    """Draw a curve and its dots, and in the legend below its panel a sample of it with its label.

    ``points`` are in pixels of the panel. ``number`` is that of the curve in its panel; it selects the style and the
    line of the legend.
    """
    label_y = HEIGHT + _LEGEND + number * _LINE
    sample_y = label_y - HALF_LETTER
    kind = f"curve c{number}"
    line = polyline(kind, points) if len(points) > 1 else ""
    sample = polyline(kind, [(0, sample_y), (_SAMPLE, sample_y)])
    dots = "".join(
        f'<circle class="dot d{number}" cx="{x:.1f}" cy="{y:.1f}" r="2.2"/>' for x, y in points
    )
    label_x = _SAMPLE + 8  # a gap between sample and label
    return f"{line}{sample}{dots}{soft_text(label_x, label_y, 'start', label)}"


def _figure(value: float) -> str:
    """Return the text of a tick: very large and very small numbers as one digit and a power of ten."""
    if value == 0 or 1e-3 <= abs(value) < 1e7:
        return f"{value:,.10g}"
    mantissa, exponent = f"{value:.0e}".split("e")
    return f"{mantissa}e{int(exponent)}"
