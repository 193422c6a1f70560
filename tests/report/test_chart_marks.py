"""Scatter charts of settings, as ``locsnn explore`` writes them.

The SVG files are parsed: they are complete, marks lie where their figures say, and labels keep clear of each other.
"""

import xml.etree.ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from locsnn_compile.report.pictures.axis import nice_step
from locsnn_compile.report.pictures.scatter import Mark, Panel, draw

SVG = "{http://www.w3.org/2000/svg}"
"""The namespace in front of the names of elements."""
FIGURE = st.floats(0, 1e12, allow_subnormal=False)


def panel(*marks):
    """A panel of energy (upwards) over error (to the right)."""
    return Panel("energy", "error", "{:g}".format, "{:g}".format, marks)


def mark(x, y, *, kind=0, front=True, taken=False, label="8-bit"):
    """A mark of the chart of settings, by default on the front and not taken."""
    return Mark(x, y, kind, label, f"at {x:g}, {y:g}", front, taken)


def drawn(*marks, kinds=("dendrite", "reset")):
    """The chart of these marks in one panel, parsed."""
    return ET.fromstring(draw("title", "subtitle", kinds, [panel(*marks)]))


MOST_TICKS = 6
"""About how many ticks a chart asks for."""


def shapes(root):
    """The marks of the panel, without those of the legend, which have no title."""
    return [
        element
        for element in root.iter()
        if (element.get("class") or "").startswith("mark") and len(element)
    ]


def shapes_by_title(root):
    """The marks of the panel by their figures, as in "at 0.1, 5"."""
    return {element.find(f"{SVG}title").text: element for element in shapes(root)}


@given(
    st.lists(
        st.builds(mark, FIGURE, FIGURE, kind=st.integers(0, 9), front=st.booleans()), max_size=8
    )
)
def test_any_figures_make_a_whole_picture(marks):
    root = drawn(*marks)
    assert [float(value) for value in root.get("viewBox").split()][:2] == [0, 0]
    assert len(shapes(root)) == len(marks)
    assert "nan" not in ET.tostring(root, encoding="unicode")


def test_kinds_differ_in_shape_and_the_front_in_its_fill():
    root = drawn(mark(0.1, 5), mark(0.5, 3, kind=1), mark(0.6, 4, kind=2, front=False))
    marks = shapes_by_title(root)
    assert [marks[title].get("href") for title in ("at 0.1, 5", "at 0.5, 3", "at 0.6, 4")] == [
        "#shape0",
        "#shape1",
        "#shape2",
    ]
    defined = {element.get("id") for element in root.find(f"{SVG}defs")}
    assert {element.get("href")[1:] for element in root.iter(f"{SVG}use")} <= defined
    assert [marks[title].get("class") for title in ("at 0.1, 5", "at 0.6, 4")] == [
        "mark front",
        "mark",
    ]


def test_lower_figures_are_lower_and_lower_errors_to_the_left():
    marks = shapes_by_title(drawn(mark(0.1, 5), mark(0.5, 3)))
    less_error = marks["at 0.1, 5"]
    less_energy = marks["at 0.5, 3"]
    assert float(less_error.get("x")) < float(less_energy.get("x"))
    # y of SVG counts downwards.
    assert float(less_error.get("y")) < float(less_energy.get("y"))


def test_the_recommended_mark_has_a_ring():
    root = drawn(mark(0.1, 5), mark(0.5, 3, taken=True))
    rings = [element for element in root.iter(f"{SVG}circle") if element.get("class") == "ring"]
    assert rings[0].get("cx") == shapes_by_title(root)["at 0.5, 3"].get("x")
    assert len(rings) == 2  # the second is the legend's


def test_crowded_marks_share_no_room_for_labels():
    crowd = [mark(0.5 + 1e-4 * i, 5, label=f"{i}-bit") for i in range(8)]
    root = drawn(*crowd, mark(1, 1))
    labels = [element for element in root.iter(f"{SVG}text") if element.get("class") == "label"]
    places = [
        (element.get("x"), element.get("y"), element.get("text-anchor")) for element in labels
    ]
    assert 2 <= len(labels) < 9
    assert len(set(places)) == len(places)


def test_names_that_are_no_xml_do_no_harm():
    content = draw("<a>&\x00", "</svg>", ["<b>"], [panel(mark(1, 1, label="]]>"))])
    assert ET.fromstring(content).find(f"{SVG}title").text == "<a>&�"


@pytest.mark.parametrize(
    ("largest", "step"), [(1, 0.2), (6, 1), (7, 2), (0.31, 0.1), (12e6, 2e6), (1e-300, 2e-301)]
)
def test_ticks_are_at_round_numbers(largest, step):
    assert nice_step(largest / MOST_TICKS) == pytest.approx(step)


@given(st.floats(1e-9, 1e12))
def test_there_are_neither_many_nor_few_ticks(largest):
    ticks = largest / nice_step(largest / MOST_TICKS)
    # A step may be a thousandth too small.
    assert 2 <= ticks <= MOST_TICKS * 1.001
