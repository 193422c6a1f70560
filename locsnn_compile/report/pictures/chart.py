"""Charts as SVG files, also of curves: panels side by side, for light, dark and paper, readable without colour."""

import itertools
import math
from collections.abc import Callable, Sequence
from xml.etree.ElementTree import Element, SubElement

from hw_model.io.xml_text import xml_file, xml_text
from hw_model.texts.templates import filled
from hw_model.values import Frozen
from locsnn_compile.report.content import Curve
from locsnn_compile.report.pictures.ticks import nice_step

WIDTH, HEIGHT, RIGHT = 340, 240, 18
"""Pixels of a panel, and to the right of the last one."""
_GAP, _TOP = 72, 70
"""Pixels to the left of a panel, for its labels, and above all panels."""
BOTTOM = _TOP + HEIGHT
"""Pixels from the top of the picture to the lower edge of its panels."""
_TICKS = 6
"""Most ticks of a linear axis, besides the one at 0."""
_LEGEND, _LINE = 56, 16
"""Pixels from the lower edge of the panels to the legend, and per line of it."""
Point = tuple[float, float]


class Axis(Frozen):
    """Values between two ends on a linear or logarithmic scale; ``text`` writes the ``ticks``."""

    low: float
    high: float
    ticks: tuple[float, ...]
    text: Callable[[float], str]
    log: bool = False

    def place(self, value: float) -> float:
        """Return the place of a value, 0..1."""
        return ((math.log10(value) if self.log else value) - self.low) / (self.high - self.low)


def linear_axis(values: Sequence[float], text: Callable[[float], str]) -> Axis:
    """Return an axis from 0 to half a tick beyond the largest value."""
    largest = max(values, default=0.0)
    step = nice_step(largest / _TICKS) if largest > 0 else 1.0
    high = largest + 0.5 * step if largest > 0 else step
    return Axis(0.0, high, tuple(i * step for i in range(math.floor(high / step + 1e-9) + 1)), text)


def log_axis(values: Sequence[float], text: Callable[[float], str]) -> Axis:
    """Return an axis for values above 0, with a tick per decade or, for few decades, at 1, 2 and 5."""
    scaled = [math.log10(value) for value in values] or [0.0, 1.0]
    low, high = min(scaled), max(scaled)
    beyond = 0.04 * (high - low) or 0.5
    first, last = math.ceil(low - 1e-9), math.floor(high + 1e-9)
    if last - first < 2:
        tried = (m * 10.0**decade for decade in range(first - 1, last + 1) for m in (1, 2, 5))
        ticks = tuple(value for value in tried if low - 1e-9 <= math.log10(value) <= high + 1e-9)
    else:
        ticks = tuple(10.0**decade for decade in range(first, last + 1, max(1, math.ceil((last - first + 1) / 8))))
    return Axis(low - beyond, high + beyond, ticks, text, log=True)


def sheet(width: int, height: int, title: str, style: str) -> Element:
    """Return an empty picture with its title, shown and as metadata; ``style`` is a file of further rules."""
    root = Element("svg", {"xmlns": "http://www.w3.org/2000/svg", "viewBox": f"0 0 {width} {height}", "role": "img"})
    SubElement(root, "title").text = xml_text(title)
    SubElement(root, "style").text = "\n" + filled(__package__, "sheet.css") + filled(__package__, style)
    SubElement(root, "rect", {"class": "paper", "width": str(width), "height": str(height)})
    words(root, 16, 22, title, "title")
    return root


def chart(title: str, subtitle: str, style: str, panels: int, below: int) -> tuple[Element, list[Element]]:
    """Return an empty chart and the groups of its panels, with ``below`` pixels under them."""
    root = sheet(panels * (WIDTH + _GAP) + RIGHT, BOTTOM + below, title, style)
    words(root, 16, 39, subtitle, "soft")
    places = (f"translate({i * (WIDTH + _GAP) + _GAP} {_TOP})" for i in range(panels))
    return root, [SubElement(root, "g", {"transform": place}) for place in places]


def axes(group: Element, title: str, x_label: str, x: Axis, y: Axis, drawn: Sequence[Point]) -> list[Point]:
    """Draw the axes of a panel, and return the points to be drawn there in pixels."""
    words(group, 0, -10, title, "soft")
    for value in y.ticks:
        at = HEIGHT * (1 - y.place(value))
        points(group, "polyline", "grid", [(0, at), (WIDTH, at)])
        words(group, -7, at + 4, y.text(value), "soft", "end")
    for value in x.ticks:
        at = WIDTH * x.place(value)
        points(group, "polyline", "frame", [(at, HEIGHT), (at, HEIGHT + 4)])
        words(group, at, HEIGHT + 17, x.text(value), "soft", "middle")
    points(group, "polyline", "frame", [(0, HEIGHT), (WIDTH, HEIGHT)])
    words(group, WIDTH / 2, HEIGHT + 34, x_label, "soft", "middle")
    return [(WIDTH * x.place(at_x), HEIGHT * (1 - y.place(at_y))) for at_x, at_y in drawn]


def words(parent: Element, x: float, y: float, text: str, style: str, anchor: str = "start") -> None:
    """Write a line of text."""
    at = {"class": style, "x": _number(x), "y": _number(y), "text-anchor": anchor}
    SubElement(parent, "text", at).text = xml_text(text)


def circle(parent: Element, style: str, x: float, y: float, radius: float) -> Element:
    """Draw a circle."""
    return SubElement(parent, "circle", {"class": style, "cx": _number(x), "cy": _number(y), "r": str(radius)})


def points(parent: Element, kind: str, style: str, corners: Sequence[Point]) -> Element:
    """Draw a ``polyline`` or ``polygon``."""
    path = " ".join(f"{_number(x)},{_number(y)}" for x, y in corners)
    return SubElement(parent, kind, {"class": style, "points": path})


def _number(value: float) -> str:
    return f"{value:.1f}"


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
    root, groups = chart(title, "", "curves.css", len(panels), below)
    for group, panel in zip(groups, panels, strict=True):
        _panel(group, panel)
    return xml_file(root)


def _panel(group: Element, panel: Panel) -> None:
    shown = [
        [(x, y) for x, y in curve.points if (x > 0 or not panel.x_log) and (y > 0 or not panel.y_log)]
        for curve in panel.curves
    ]
    x_axis = (log_axis if panel.x_log else linear_axis)([x for held in shown for x, _ in held], _figure)
    y_axis = (log_axis if panel.y_log else linear_axis)([y for held in shown for _, y in held], _figure)
    places = iter(axes(group, panel.title, panel.x_label, x_axis, y_axis, [at for held in shown for at in held]))
    for i, (curve, held) in enumerate(zip(panel.curves, shown, strict=True)):
        mine = list(itertools.islice(places, len(held)))
        bottom = HEIGHT + _LEGEND + i * _LINE
        for joined in (mine, [(0, bottom - 4), (26, bottom - 4)]):
            if len(joined) > 1:
                points(group, "polyline", f"curve c{i}", joined)
        for at in mine:
            circle(group, f"dot d{i}", *at, 2.2)
        words(group, 34, bottom, curve.label, "soft")


def _figure(value: float) -> str:
    if value == 0 or 1e-3 <= abs(value) < 1e7:
        return f"{value:,.10g}"
    mantissa, exponent = f"{value:.0e}".split("e")
    return f"{mantissa}e{int(exponent)}"
