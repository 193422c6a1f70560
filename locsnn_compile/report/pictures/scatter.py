"""Charts of marks.

Kinds have different shapes, marks on the front are filled, the recommended one has a ring, and a stair joins the marks
that no other beats in the two figures of a panel.
"""

import math
from collections.abc import Callable, Sequence
from xml.etree.ElementTree import Element, SubElement

from hw_model.io.xml_text import xml_file, xml_text
from hw_model.values import Frozen
from locsnn_compile.report.pictures import chart

_SHAPES = ("circle", "square", "triangle", "diamond")
_LEGEND, _BELOW = 68, 88
"""Pixels from the lower edge of the panels to the middle of the legend, and to the end of the picture."""
_RADIUS, _RING = 4.5, 9
_LETTER, _LINE = 6.2, 12
"""Approximate pixels of a letter and of a line of a label, to keep labels apart."""

Box = tuple[float, float, float, float]
"""Left, top, right and bottom."""


class Mark(Frozen):
    """One setting: both figures, its ``kind``, the label next to it, and the words shown when pointing at it."""

    x: float
    y: float
    kind: int
    label: str
    words: str
    front: bool
    taken: bool


class Panel(Frozen):
    """Marks over axes from 0; ``x_text`` and ``y_text`` write the ticks."""

    title: str
    x_label: str
    x_text: Callable[[float], str]
    y_text: Callable[[float], str]
    marks: tuple[Mark, ...]


def draw(title: str, subtitle: str, kinds: Sequence[str], panels: Sequence[Panel]) -> bytes:
    """Return the picture as a file; equal input gives equal bytes."""
    root, groups = chart.chart(title, subtitle, "marks.css", len(panels), _BELOW)
    for group, panel in zip(groups, panels, strict=True):
        _panel(group, panel)
    _legend(root, kinds, chart.BOTTOM + _LEGEND)
    return xml_file(root)


def _panel(group: Element, panel: Panel) -> None:
    x_axis = chart.linear_axis([mark.x for mark in panel.marks], panel.x_text)
    y_axis = chart.linear_axis([mark.y for mark in panel.marks], panel.y_text)
    places = chart.axes(group, panel.title, panel.x_label, x_axis, y_axis, [(mark.x, mark.y) for mark in panel.marks])
    _stair(group, places)
    _marks(group, panel.marks, places)


def _marks(group: Element, marks: Sequence[Mark], places: Sequence[tuple[float, float]]) -> None:
    """Draw the marks, those on the front last, and label those where there is room."""
    order = sorted(range(len(marks)), key=lambda i: (marks[i].taken, marks[i].front))
    for i in order:
        mark, (x, y) = marks[i], places[i]
        shape = _shape(group, mark.kind, x, y, "mark front" if mark.front else "mark")
        SubElement(shape, "title").text = xml_text(mark.words)
        if mark.taken:
            chart.circle(group, "ring", x, y, _RING)
    taken = [_around(x, y, _RING if mark.taken else _RADIUS) for mark, (x, y) in zip(marks, places, strict=True)]
    for i in reversed(order):
        if not (marks[i].front or marks[i].taken):
            continue
        for anchor, box in _label_places(*places[i], marks[i].label):
            if not any(_overlap(box, other) for other in taken):
                left = box[2] if anchor == "end" else box[0]
                chart.words(group, left, box[3] - 3, marks[i].label, "label", anchor)
                taken.append(box)
                break


def _label_places(x: float, y: float, label: str) -> list[tuple[str, Box]]:
    """Return possible places of a label within the panel, the best first: right, left, above and below."""
    width, away = _LETTER * len(label), _RING + 2
    middle, above, below = y - _LINE / 2, y - away - _LINE, y + away
    tried = [
        ("start", (x + away, middle)),
        ("end", (x - away - width, middle)),
        ("start", (x + 2, above)),
        ("end", (x - 2 - width, above)),
        ("start", (x + 2, below)),
        ("end", (x - 2 - width, below)),
    ]
    boxes = [(anchor, (left, top, left + width, top + _LINE)) for anchor, (left, top) in tried]
    return [
        (anchor, box)
        for anchor, box in boxes
        if box[0] >= 0 and box[2] <= chart.WIDTH + chart.RIGHT and box[3] <= chart.HEIGHT
    ]


def _stair(group: Element, places: Sequence[tuple[float, float]]) -> None:
    """Join the places without another to their lower left (pixels grow downwards, so lower figures have larger y)."""
    corners: list[tuple[float, float]] = []
    lowest = -math.inf
    for x, y in sorted(set(places), key=lambda place: (place[0], -place[1])):
        if y > lowest:
            corners += [(x, lowest), (x, y)] if corners else [(x, y)]
            lowest = y
    if len(corners) > 1:
        chart.points(group, "polyline", "stair", corners)


def _legend(root: Element, kinds: Sequence[str], y: float) -> None:
    x = 20.0
    entries = [(kind, "mark", name) for kind, name in enumerate(kinds)]
    entries += [(0, "mark front", "on the front"), (0, "ring", "recommended"), (0, "stair", "best of the two figures")]
    for kind, style, text in entries:
        if style == "ring":
            chart.circle(root, style, x, y, 6)
        elif style == "stair":
            chart.points(root, "polyline", style, [(x - 8, y), (x + 8, y)])
        else:
            _shape(root, kind, x, y, style)
        chart.words(root, x + 12, y + 4, text, "soft")
        x += 40 + _LETTER * len(text)


def _shape(parent: Element, kind: int, x: float, y: float, style: str) -> Element:
    r = _RADIUS
    match _SHAPES[kind % len(_SHAPES)]:
        case "circle":
            return chart.circle(parent, style, x, y, r)
        case "square":
            corners = [(-r, -r), (r, -r), (r, r), (-r, r)]
        case "triangle":
            corners = [(0, -r - 1), (r + 1, r), (-r - 1, r)]
        case _:
            corners = [(0, -r - 1), (r + 1, 0), (0, r + 1), (-r - 1, 0)]
    return chart.points(parent, "polygon", style, [(x + dx, y + dy) for dx, dy in corners])


def _around(x: float, y: float, radius: float) -> Box:
    return x - radius, y - radius, x + radius, y + radius


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
