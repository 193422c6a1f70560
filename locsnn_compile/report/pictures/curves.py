"""Charts of curves, each with a dash of its own, and a legend below each panel."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from hw_model.io.xml_text import xml_file
from locsnn_compile.report.content import Curve
from locsnn_compile.report.pictures import chart

_STYLE = """\
.curve{fill:none;stroke:var(--ink);stroke-width:1.6}.dot{fill:var(--ink)}
.c0{stroke:var(--accent)}.d0{fill:var(--accent)}
.c1{stroke-dasharray:7 3}.c2{stroke-dasharray:2 3}.c3{stroke-dasharray:9 3 2 3}.c4{stroke-dasharray:4 2 1 2 1 2}
"""
_LEGEND, _LINE = 56, 16
"""Pixels from the panels' lower edge to the legend, and of a line of it."""


@dataclass(frozen=True)
class Panel:
    """Curves over common axes, each linear or logarithmic; what a logarithmic axis cannot show is left out."""

    title: str
    x_label: str
    curves: tuple[Curve, ...]
    x_log: bool = True
    y_log: bool = True


def draw(title: str, panels: Sequence[Panel]) -> bytes:
    """Return the picture as a file; equal input gives equal bytes."""
    below = _LEGEND + _LINE * max(len(panel.curves) for panel in panels)
    root, groups = chart.chart(title, "", _STYLE, len(panels), below)
    for group, panel in zip(groups, panels, strict=True):
        _panel(group, panel)
    return xml_file(root)


def _panel(group: Element, panel: Panel) -> None:
    shown = [
        [(x, y) for x, y in curve.points if (x > 0 or not panel.x_log) and (y > 0 or not panel.y_log)]
        for curve in panel.curves
    ]
    x_axis = (chart.log_axis if panel.x_log else chart.linear_axis)([x for held in shown for x, _ in held], _figure)
    y_axis = (chart.log_axis if panel.y_log else chart.linear_axis)([y for held in shown for _, y in held], _figure)
    places = iter(chart.axes(group, panel.title, panel.x_label, x_axis, y_axis, [at for held in shown for at in held]))
    for i, (curve, held) in enumerate(zip(panel.curves, shown, strict=True)):
        mine = list(itertools.islice(places, len(held)))
        bottom = chart.HEIGHT + _LEGEND + i * _LINE
        for joined in (mine, [(0, bottom - 4), (26, bottom - 4)]):
            if len(joined) > 1:
                chart.points(group, "polyline", f"curve c{i}", joined)
        for at in mine:
            chart.circle(group, f"dot d{i}", *at, 2.2)
        chart.words(group, 34, bottom, curve.label, "soft")


def _figure(value: float) -> str:
    if value == 0 or 1e-3 <= abs(value) < 1e7:
        return f"{value:,.10g}"
    mantissa, exponent = f"{value:.0e}".split("e")
    return f"{mantissa}e{int(exponent)}"
