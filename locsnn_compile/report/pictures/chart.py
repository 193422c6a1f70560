"""Charts as SVG files, also of curves: panels side by side, for light, dark and paper, readable without colour."""

from collections.abc import Sequence
from typing import Literal

from hw_model.io.xml_text import escaped, xml_file
from hw_model.texts.templates import filled
from hw_model.values import Frozen
from locsnn_compile.report.content import Curve
from locsnn_compile.report.pictures.axis import Axis, linear_axis, log_axis

WIDTH = 340
HEIGHT = 240
"""Pixels of a panel."""
RIGHT = 18
"""Pixels to the right of the last panel."""
_GAP = 72
"""Pixels to the left of a panel, for its labels."""
_TOP = 70
"""Pixels above all panels."""
BOTTOM = _TOP + HEIGHT
"""Pixels from the top of the picture to the lower edge of its panels."""
_LEGEND = 56
"""Pixels from the lower edge of the panels to the legend."""
_LINE = 16
"""Pixels of a line of the legend."""
_SAMPLE = 26
"""Pixels of a curve's sample in the legend."""
Point = tuple[float, float]
Anchor = Literal["start", "middle", "end"]
"""Which end of a text stands at its place."""


def sheet(width: int, height: int, title: str, style: str, inside: str) -> bytes:
    """Return a picture as a file, with its title, shown and as metadata; ``style`` is a file of further rules."""
    rules = filled(__package__, "sheet.css") + filled(__package__, style)
    name = escaped(title)
    markup = f"""\
<svg viewBox="0 0 {width} {height}" role="img"><title>{name}</title>
<style>
{rules}</style>
<rect class="paper" width="{width}" height="{height}"/>
<text class="title" x="16.0" y="22.0" text-anchor="start">{name}</text>
{inside}</svg>"""
    return xml_file(markup, xmlns="http://www.w3.org/2000/svg")


def chart(
    title: str, subtitle: str, style: str, panels: Sequence[str], below: int, legend: str = ""
) -> bytes:
    """Return a chart of drawn panels, with ``below`` pixels under them."""
    placed = "".join(
        f'<g transform="translate({i * (WIDTH + _GAP) + _GAP} {_TOP})">{panel}</g>'
        for i, panel in enumerate(panels)
    )
    inside = f"{soft_text(16, 39, 'start', subtitle)}{placed}{legend}"
    return sheet(len(panels) * (WIDTH + _GAP) + RIGHT, BOTTOM + below, title, style, inside)


def axes(title: str, x_label: str, x: Axis, y: Axis) -> str:
    """Draw the axes of a panel."""
    rows = "".join(_axis_row(HEIGHT * (1 - place), label) for place, label in y.places)
    columns = "".join(_axis_column(WIDTH * place, label) for place, label in x.places)
    return f"""\
{soft_text(0, -10, "start", title)}
{rows}{columns}{polyline("frame", [(0, HEIGHT), (WIDTH, HEIGHT)])}
{soft_text(WIDTH / 2, HEIGHT + 34, "middle", x_label)}
"""


def _axis_row(y: float, label: str) -> str:
    """Draw a line across a panel, with its label to the left."""
    return polyline("grid", [(0, y), (WIDTH, y)]) + soft_text(-7, y + 4, "end", label)


def _axis_column(x: float, label: str) -> str:
    """Draw a tick at the lower edge of a panel, with its label below."""
    tick = polyline("frame", [(x, HEIGHT), (x, HEIGHT + 4)])
    return tick + soft_text(x, HEIGHT + 17, "middle", label)


def soft_text(x: float, y: float, anchor: Anchor, text: str) -> str:
    """Write a text in the colour of what explains a picture."""
    return (
        f'<text class="soft" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escaped(text)}</text>'
    )


def polyline(kind: str, corners: Sequence[Point]) -> str:
    """Draw a line through corners in the style of its class."""
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    return f'<polyline class="{kind}" points="{points}"/>'


def places(x: Axis, y: Axis, points: Sequence[Point]) -> list[Point]:
    """Return points in pixels of their panel."""
    return [(WIDTH * x.place(at_x), HEIGHT * (1 - y.place(at_y))) for at_x, at_y in points]


class Panel(Frozen):
    """Curves over common axes, each linear or logarithmic; a logarithmic axis leaves out values up to 0."""

    title: str
    x_label: str
    curves: tuple[Curve, ...]
    x_log: bool = True
    y_log: bool = True


def draw(title: str, panels: Sequence[Panel]) -> bytes:
    """Return the picture as a file; equal input gives equal bytes."""
    below = _LEGEND + _LINE * max(len(panel.curves) for panel in panels)
    return chart(title, "", "curves.css", [_panel(panel) for panel in panels], below)


def _panel(panel: Panel) -> str:
    shown = [_points_on_axes(curve, panel) for curve in panel.curves]
    x_axis = _axis_of([x for points in shown for x, _ in points], log=panel.x_log)
    y_axis = _axis_of([y for points in shown for _, y in points], log=panel.y_log)
    curves = "".join(
        _curve(number, curve.label, places(x_axis, y_axis, points))
        for number, (curve, points) in enumerate(zip(panel.curves, shown, strict=True))
    )
    return axes(panel.title, panel.x_label, x_axis, y_axis) + curves


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
    """Draw a curve and its dots, and below its panel a sample of it with its label."""
    legend_y = HEIGHT + _LEGEND + number * _LINE
    kind = f"curve c{number}"
    line = polyline(kind, points) if len(points) > 1 else ""
    sample = polyline(kind, [(0, legend_y - 4), (_SAMPLE, legend_y - 4)])
    dots = "".join(
        f'<circle class="dot d{number}" cx="{x:.1f}" cy="{y:.1f}" r="2.2"/>' for x, y in points
    )
    return f"{line}{sample}{dots}{soft_text(_SAMPLE + 8, legend_y, 'start', label)}"


def _figure(value: float) -> str:
    """Return a number of a tick: very large and very small ones as a power of ten."""
    if value == 0 or 1e-3 <= abs(value) < 1e7:
        return f"{value:,.10g}"
    mantissa, exponent = f"{value:.0e}".split("e")
    return f"{mantissa}e{int(exponent)}"
