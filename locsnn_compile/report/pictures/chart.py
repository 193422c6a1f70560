"""Charts as SVG files, also of curves: panels side by side, for light, dark and paper, readable without colour."""

from collections.abc import Sequence

from hw_model.io.xml_text import escaped, xml_file
from hw_model.texts.pieces import Pieces
from hw_model.texts.templates import filled
from hw_model.values import Frozen
from locsnn_compile.report.content import Curve
from locsnn_compile.report.pictures.axis import Axis, linear_axis, log_axis

WIDTH, HEIGHT, RIGHT = 340, 240, 18
"""Pixels of a panel, and to the right of the last one."""
_GAP, _TOP = 72, 70
"""Pixels to the left of a panel, for its labels, and above all panels."""
BOTTOM = _TOP + HEIGHT
"""Pixels from the top of the picture to the lower edge of its panels."""
_LEGEND, _LINE = 56, 16
"""Pixels from the lower edge of the panels to the legend, and per line of it."""
Point = tuple[float, float]
PIECES = Pieces(__package__, "files.svg", escaped)


def sheet(width: int, height: int, title: str, style: str, inside: str) -> bytes:
    """Return a picture as a file, with its title, shown and as metadata; ``style`` is a file of further rules."""
    rules = filled(__package__, "sheet.css") + filled(__package__, style)
    made = PIECES.piece(
        "sheet", None, width=width, height=height, title=title, style=rules, inside=inside
    )
    return xml_file(made, xmlns="http://www.w3.org/2000/svg")


def chart(
    title: str, subtitle: str, style: str, panels: Sequence[str], below: int, legend: str = ""
) -> bytes:
    """Return a chart of drawn panels, with ``below`` pixels under them."""
    placed = [
        {"left": i * (WIDTH + _GAP) + _GAP, "top": _TOP, "drawn": drawn}
        for i, drawn in enumerate(panels)
    ]
    inside = PIECES.piece("chart", None, subtitle=subtitle, panels=placed, legend=legend)
    return sheet(len(panels) * (WIDTH + _GAP) + RIGHT, BOTTOM + below, title, style, inside)


def axes(title: str, x_label: str, x: Axis, y: Axis) -> str:
    """Draw the axes of a panel."""
    rows = ((HEIGHT * (1 - at), label) for at, label in y.places)
    return PIECES.piece(
        "axes",
        None,
        title=title,
        x_label=x_label,
        rows=[{"at": at, "below": at + 4, "label": label} for at, label in rows],
        columns=[{"at": WIDTH * at, "label": label} for at, label in x.places],
    )


def places(x: Axis, y: Axis, points: Sequence[Point]) -> list[Point]:
    """Return points in pixels of their panel."""
    return [(WIDTH * x.place(at_x), HEIGHT * (1 - y.place(at_y))) for at_x, at_y in points]


def path(corners: Sequence[Point]) -> str:
    """Return corners as SVG has them."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)


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
    shown = [
        [
            (x, y)
            for x, y in curve.points
            if (x > 0 or not panel.x_log) and (y > 0 or not panel.y_log)
        ]
        for curve in panel.curves
    ]
    x_axis = (log_axis if panel.x_log else linear_axis)(
        [x for held in shown for x, _ in held], _figure
    )
    y_axis = (log_axis if panel.y_log else linear_axis)(
        [y for held in shown for _, y in held], _figure
    )
    curves = []
    for i, (curve, held) in enumerate(zip(panel.curves, shown, strict=True)):
        mine, bottom = places(x_axis, y_axis, held), HEIGHT + _LEGEND + i * _LINE
        lines = [line for line in (mine, [(0, bottom - 4), (26, bottom - 4)]) if len(line) > 1]
        curves.append(
            {
                "lines": [{"number": i, "path": path(line)} for line in lines],
                "dots": [{"number": i, "x": x, "y": y} for x, y in mine],
                "bottom": bottom,
                "label": curve.label,
            }
        )
    return axes(panel.title, panel.x_label, x_axis, y_axis) + PIECES.each(curves, "curve")


def _figure(value: float) -> str:
    if value == 0 or 1e-3 <= abs(value) < 1e7:
        return f"{value:,.10g}"
    mantissa, exponent = f"{value:.0e}".split("e")
    return f"{mantissa}e{int(exponent)}"
