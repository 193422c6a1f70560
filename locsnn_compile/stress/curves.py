"""Curves side by side as one SVG: light, dark and printed, and readable without colour: each has a dash of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

from hw_model.io.xml_text import xml_file, xml_text

_STYLE = """
:root{--paper:#fff;--ink:#15191e;--soft:#57606b;--rule:#dfe3e7;--accent:#1d5a86}
@media (prefers-color-scheme:dark){:root{--paper:#121518;--ink:#e8ebee;--soft:#a1abb6;--rule:#2d343b;--accent:#7db8e3}}
text{font:11px system-ui,-apple-system,"Segoe UI",Arial,sans-serif;fill:var(--ink)}
.title{font-size:14px;font-weight:600}.soft{fill:var(--soft)}
.paper{fill:var(--paper)}.grid{stroke:var(--rule)}.frame{stroke:var(--soft)}
.curve{fill:none;stroke:var(--ink);stroke-width:1.6}.dot{fill:var(--ink)}
.c0{stroke:var(--accent)}.d0{fill:var(--accent)}
.c1{stroke-dasharray:7 3}.c2{stroke-dasharray:2 3}.c3{stroke-dasharray:9 3 2 3}.c4{stroke-dasharray:4 2 1 2 1 2}
"""
_WIDTH, _HEIGHT, _GAP = 340, 230, 70
"""Pixels of a panel, and left of each, where its labels are."""
_TOP, _LEGEND, _LINE, _RIGHT = 58, 44, 16, 18
"""Pixels above the panels, from their lower edge to the legend, of a line of it, and right of the last panel."""
_MARGIN = 0.04
"""Share of an axis that is left free beyond the outermost points."""


@dataclass(frozen=True)
class Curve:
    """Points (x, y), joined in order; what a logarithmic axis cannot show is left out."""

    label: str
    points: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Panel:
    """Curves over common axes, each linear or logarithmic."""

    title: str
    x_label: str
    curves: tuple[Curve, ...]
    x_log: bool = True
    y_log: bool = True


def draw(title: str, panels: Sequence[Panel]) -> bytes:
    """Return the picture as a file; equal input gives equal bytes."""
    lines = max(len(panel.curves) for panel in panels)
    width, height = len(panels) * (_WIDTH + _GAP) + _RIGHT, _TOP + _HEIGHT + _LEGEND + lines * _LINE
    root = Element("svg", {"xmlns": "http://www.w3.org/2000/svg", "viewBox": f"0 0 {width} {height}", "role": "img"})
    SubElement(root, "title").text = xml_text(title)
    SubElement(root, "style").text = _STYLE
    SubElement(root, "rect", {"class": "paper", "width": str(width), "height": str(height)})
    _text(root, 16, 24, title, "title")
    for i, panel in enumerate(panels):
        group = SubElement(root, "g", {"transform": f"translate({i * (_WIDTH + _GAP) + _GAP} {_TOP})"})
        _panel(group, panel)
    return xml_file(root)


def _panel(group: Element, panel: Panel) -> None:
    shown = [
        [(x, y) for x, y in curve.points if (x > 0 or not panel.x_log) and (y > 0 or not panel.y_log)]
        for curve in panel.curves
    ]
    x_axis = _Axis([x for points in shown for x, _ in points], panel.x_log)
    y_axis = _Axis([y for points in shown for _, y in points], panel.y_log)
    _text(group, 0, -10, panel.title, "soft")
    for value in y_axis.ticks():
        y = _HEIGHT * (1 - y_axis.place(value))
        _line(group, "grid", 0, y, _WIDTH, y)
        _text(group, -7, y + 4, _figure(value), "soft", "end")
    for value in x_axis.ticks():
        x = _WIDTH * x_axis.place(value)
        _line(group, "frame", x, _HEIGHT, x, _HEIGHT + 4)
        _text(group, x, _HEIGHT + 16, _figure(value), "soft", "middle")
    _line(group, "frame", 0, _HEIGHT, _WIDTH, _HEIGHT)
    _text(group, _WIDTH, _HEIGHT + 31, panel.x_label, "soft", "end")
    for i, (curve, points) in enumerate(zip(panel.curves, shown, strict=True)):
        places = [(_WIDTH * x_axis.place(x), _HEIGHT * (1 - y_axis.place(y))) for x, y in points]
        _curve(group, i, places)
        y = _HEIGHT + _LEGEND + i * _LINE
        _curve(group, i, [(0, y - 4), (26, y - 4)], dots=False)
        _text(group, 34, y, curve.label, "soft")


def _curve(group: Element, index: int, places: Sequence[tuple[float, float]], *, dots: bool = True) -> None:
    if len(places) > 1:
        points = " ".join(f"{_n(x)},{_n(y)}" for x, y in places)
        SubElement(group, "polyline", {"class": f"curve c{index}", "points": points})
    for x, y in places if dots else ():
        SubElement(group, "circle", {"class": f"dot d{index}", "cx": _n(x), "cy": _n(y), "r": "2.2"})


class _Axis:
    """Where values lie on an axis, 0..1: from the least to the largest, or from 0 where it is linear."""

    def __init__(self, values: Sequence[float], log: bool) -> None:
        self._log = log
        scaled = [self._scaled(value) for value in values] or [0.0, 1.0]
        self._low, self._high = (min(scaled) if log else min(0.0, *scaled)), max(scaled)
        if self._high == self._low:
            self._low, self._high = self._low - 0.5, self._high + 0.5

    def place(self, value: float) -> float:
        return _MARGIN + (1 - 2 * _MARGIN) * (self._scaled(value) - self._low) / (self._high - self._low)

    def ticks(self) -> list[float]:
        if self._log:
            low, high = math.ceil(self._low - 1e-9), math.floor(self._high + 1e-9)
            if high - low < 2:
                tried = [m * 10.0**decade for decade in range(low - 1, high + 1) for m in (1, 2, 5)]
                return [value for value in tried if self._low - 1e-9 <= math.log10(value) <= self._high + 1e-9]
            step = max(1, math.ceil((high - low + 1) / 8))
            return [10.0**decade for decade in range(low, high + 1, step)]
        least = self._high / 5
        power = 10.0 ** math.floor(math.log10(least))
        step_size = next(s * power for s in (1, 2, 5, 10) if s * power >= least * (1 - 1e-9))
        return [i * step_size for i in range(int(self._high / step_size + 1e-9) + 1)]

    def _scaled(self, value: float) -> float:
        return math.log10(value) if self._log else value


def _figure(value: float) -> str:
    if value == 0 or 1e-3 <= abs(value) < 1e7:
        return f"{value:,.10g}"
    mantissa, exponent = f"{value:.0e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def _text(parent: Element, x: float, y: float, words: str, style: str, anchor: str = "start") -> None:
    at = {"class": style, "x": _n(x), "y": _n(y), "text-anchor": anchor}
    SubElement(parent, "text", at).text = xml_text(words)


def _line(parent: Element, style: str, x1: float, y1: float, x2: float, y2: float) -> None:
    SubElement(parent, "line", {"class": style, "x1": _n(x1), "y1": _n(y1), "x2": _n(x2), "y2": _n(y2)})


def _n(value: float) -> str:
    return f"{value:.1f}"
