"""The pictures: well-formed, points where they belong, and what an axis cannot show left out."""

from xml.etree import ElementTree

import pytest

from locsnn_compile.report.content import Curve
from locsnn_compile.report.pictures.chart import Panel, draw

SVG = "{http://www.w3.org/2000/svg}"


def drawn(*curves, **axes):
    return ElementTree.fromstring(draw("title & <more>", [Panel("panel", "x", curves, **axes)]))


def dots(picture):
    return [(float(dot.get("cx")), float(dot.get("cy"))) for dot in picture.iter(f"{SVG}circle")]


def test_decades_are_equally_far_apart():
    places = dots(drawn(Curve("one", ((1.0, 0.01), (10.0, 0.1), (100.0, 1.0)))))
    (x0, y0), (x1, y1), (x2, y2) = places
    assert x2 - x1 == pytest.approx(x1 - x0, abs=0.11)
    assert y1 - y2 == pytest.approx(y0 - y1, abs=0.11)
    assert x0 < x1
    assert y0 > y1


def test_linear_axes_begin_at_0():
    picture = drawn(Curve("one", ((1.0, 0.5), (2.0, 1.0))), x_log=False, y_log=False)
    (half, whole) = dots(picture)
    zero = next(float(text.get("y")) - 4 for text in picture.iter(f"{SVG}text") if text.text == "0")
    assert zero - half[1] == pytest.approx((zero - whole[1]) / 2, abs=0.11)


@pytest.mark.parametrize(
    ("points", "shown"),
    [(((1.0, 0.0), (2.0, 1.0)), 1), (((0.0, 1.0),), 0), ((), 0), (((5.0, 3.0),), 1)],
)
def test_what_a_logarithm_cannot_show_is_left_out(points, shown):
    assert len(dots(drawn(Curve("one", points)))) == shown


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
