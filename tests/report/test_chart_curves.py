"""Charts of curves: the SVG files are parsed, and their points compared with what the axes demand.

Places are written with one decimal of a pixel, so distances between two points may be off by 0.1.
"""

from xml.etree import ElementTree

import pytest

from locsnn_compile.report.content import Curve
from locsnn_compile.report.pictures.chart import Panel, draw

SVG = "{http://www.w3.org/2000/svg}"
"""The namespace in front of the names of elements."""
ROUNDING = 0.11
"""Pixels by which the distance of two points may be off."""


def drawn(*curves, **axes):
    """The chart of these curves in one panel, parsed."""
    return ElementTree.fromstring(draw("title & <more>", [Panel("panel", "x", curves, **axes)]))


def dots(picture):
    """The places of all dots of a chart, in pixels; y grows downwards."""
    return [(float(dot.get("cx")), float(dot.get("cy"))) for dot in picture.iter(f"{SVG}circle")]


def test_decades_are_equally_far_apart():
    places = dots(drawn(Curve("one", ((1.0, 0.01), (10.0, 0.1), (100.0, 1.0)))))
    (x0, y0), (x1, y1), (x2, y2) = places
    assert x2 - x1 == pytest.approx(x1 - x0, abs=ROUNDING)
    assert y1 - y2 == pytest.approx(y0 - y1, abs=ROUNDING)
    assert x0 < x1
    assert y0 > y1


def test_linear_axes_begin_at_0():
    picture = drawn(Curve("one", ((1.0, 0.5), (2.0, 1.0))), x_log=False, y_log=False)
    (_, y_of_half), (_, y_of_one) = dots(picture)
    # The text of the tick at 0 stands 4 pixels below its line.
    y_of_zero = next(
        float(text.get("y")) - 4 for text in picture.iter(f"{SVG}text") if text.text == "0"
    )
    assert y_of_zero - y_of_half == pytest.approx((y_of_zero - y_of_one) / 2, abs=ROUNDING)


@pytest.mark.parametrize(
    ("points", "drawn_points"),
    [
        pytest.param(((1.0, 0.0), (2.0, 1.0)), 1, id="y of 0"),
        pytest.param(((0.0, 1.0),), 0, id="x of 0"),
        pytest.param((), 0, id="no points"),
        pytest.param(((5.0, 3.0),), 1, id="one point"),
    ],
)
def test_points_without_a_logarithm_are_left_out(points, drawn_points):
    assert len(dots(drawn(Curve("one", points)))) == drawn_points


def test_every_curve_is_in_the_legend():
    picture = drawn(
        Curve("first", ((1.0, 1.0), (2.0, 2.0))), Curve("second", ((1.0, 2.0), (3.0, 1.0)))
    )
    texts = [text.text for text in picture.iter(f"{SVG}text")]
    assert {"first", "second", "title & <more>", "panel", "x"} <= set(texts)
    # Each curve once in the panel and once in the legend.
    assert [line.get("class") for line in picture.iter(f"{SVG}polyline")].count("curve c1") == 2


def test_equal_input_gives_equal_bytes():
    panels = [Panel("panel", "x", (Curve("one", ((1.0, 1e-9), (1e6, 3.0))),))]
    assert draw("same", panels) == draw("same", panels)
