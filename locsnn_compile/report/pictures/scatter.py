"""Draw scatter charts of settings as SVG files, such as energy against accuracy; ``locsnn explore`` writes them.

Each mark is a setting. Its shape tells its kind, such as the strategy. It is filled if the setting is on the front: no
other setting is better in all figures that are compared, which may be more than the two of a panel. The recommended
setting has a ring. A stair joins the marks that no other beats in the two figures of a panel alone; less is better.
All sizes are pixels, and chosen by hand.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial

from hw_model.io.xml_text import escaped
from hw_model.values import Frozen
from locsnn_compile.report.pictures import chart
from locsnn_compile.report.pictures.axis import linear_axis

_SHAPES = """\
<defs><circle id="shape0" r="4.5"/>
<polygon id="shape1" points="-4.5,-4.5 4.5,-4.5 4.5,4.5 -4.5,4.5"/>
<polygon id="shape2" points="0,-5.5 5.5,4.5 -5.5,4.5"/>
<polygon id="shape3" points="0,-5.5 5.5,0 0,5.5 -5.5,0"/></defs>
"""
"""The shapes of marks around (0, 0): a circle, a square, a triangle and a diamond, of about equal area. The last two
have corners further out than the edges of the others."""
_SHAPE_COUNT = 4
"""Number of shapes; further kinds take the first ones again."""
_LEGEND = 68
"""Pixels from the lower edge of the panels to the middle of the legend."""
_BELOW = 88
"""Pixels from the lower edge of the panels to the end of the picture."""
_RADIUS = 4.5
"""Half the side of the square around a mark that a label must not touch. Corners of triangles and diamonds reach a
pixel further; they are thin, so a label may touch them."""
_RING = 9
"""Radius of the ring around the recommended mark, in pixels."""
_LETTER = 6.2
"""Approximate width of a letter of a label in pixels, at 11 pixels of height, to keep labels apart."""
_LINE = 12
"""Height of a label in pixels."""
_LABEL_GAP = 2
"""Pixels between the ring of a mark and its label, and by which a label above or below begins aside of the middle."""
_LEGEND_RING = 6
"""Radius of the ring in the legend; smaller than in a panel, so that it fits its line."""
_LEGEND_LEFT = 20.0
"""Pixels from the left edge of the picture to the middle of the first sample of the legend."""
_LEGEND_TEXT = 12
"""Pixels from the middle of a sample to its name."""
_LEGEND_SPACE = 40
"""Pixels from the middle of a sample to that of the next, in addition to the width of its name."""
_HALF_STAIR = 8
"""Half the length of the sample of a stair."""

Box = tuple[float, float, float, float]
"""Left, top, right and bottom of a rectangle, in pixels of a panel."""


class Mark(Frozen):
    """One setting as a mark.

    - ``x``, ``y``: its two figures
    - ``kind``: the number of its kind, which gives its shape
    - ``label``: stands next to it where there is room; ``words`` are shown when pointing at it
    - ``front``: whether no other setting is better in all figures
    - ``taken``: whether it is the recommended setting
    """

    x: float
    y: float
    kind: int
    label: str
    words: str
    front: bool
    taken: bool


class Panel(Frozen):
    """Marks over axes from 0; ``x_text`` and ``y_text`` write the ticks.

    ``title`` stands above the panel and names the figure of the vertical axis, ``x_label`` below names the other one.
    """

    title: str
    x_label: str
    x_text: Callable[[float], str]
    y_text: Callable[[float], str]
    marks: tuple[Mark, ...]


def draw(title: str, subtitle: str, kinds: Sequence[str], panels: Sequence[Panel]) -> bytes:
    """Return a chart as an SVG file; equal input gives equal bytes. ``kinds`` are the names of kinds, by number."""
    legend = _legend(kinds, chart.BOTTOM + _LEGEND)
    return chart.chart(
        title, subtitle, "marks.css", [_panel(panel) for panel in panels], _BELOW, legend
    )


def _panel(panel: Panel) -> str:
    """Draw a panel: its axes, the stair, and above it the marks with their labels."""
    x_axis = linear_axis([mark.x for mark in panel.marks], panel.x_text)
    y_axis = linear_axis([mark.y for mark in panel.marks], panel.y_text)
    places = chart.places(x_axis, y_axis, [(mark.x, mark.y) for mark in panel.marks])
    return (
        chart.axes(panel.title, panel.x_label, x_axis, y_axis)
        + _stair(places)
        + _marks(panel.marks, places)
    )


def _marks(marks: Sequence[Mark], places: Sequence[chart.Point]) -> str:
    """Draw the marks, and label those on the front where there is room.

    Marks on the front are drawn last, and the recommended one after all others, so that nothing hides them.
    Labels are placed in the opposite order, because the first labels find most room.
    """
    order = sorted(range(len(marks)), key=lambda i: (marks[i].taken, marks[i].front))
    drawn = "".join(_mark(marks[i], *places[i]) for i in order)
    occupied = [_box_of_mark(mark, *place) for mark, place in zip(marks, places, strict=True)]
    for i in reversed(order):
        if not (marks[i].front or marks[i].taken):
            continue
        for anchor, box in _label_places(*places[i], marks[i].label):
            is_free = not any(_overlap(box, other) for other in occupied)
            if is_free:
                drawn += _label(marks[i].label, anchor, box)
                occupied.append(box)
                break
    return drawn


def _box_of_mark(mark: Mark, x: float, y: float) -> Box:
    """Return the rectangle that a mark covers, with its ring if it has one."""
    size = _RING if mark.taken else _RADIUS
    return x - size, y - size, x + size, y + size


def _mark(mark: Mark, x: float, y: float) -> str:
    """Draw a mark, with a ring if it is recommended; pointing at it shows its words."""
    style = "mark front" if mark.front else "mark"
    title = f"<title>{escaped(mark.words)}</title>"
    shape = _shape(mark.kind, x, y, style, title)
    return shape + _ring(x, y, _RING) if mark.taken else shape


def _label(label: str, anchor: chart.Anchor, box: Box) -> str:
    """Write a label into its box; its baseline lies 3 pixels above the lower edge, for letters such as g."""
    left, _, right, bottom = box
    x = right if anchor == "end" else left
    return (
        f'<text class="label" x="{x:.1f}" y="{bottom - 3:.1f}" text-anchor="{anchor}">'
        f"{escaped(label)}</text>"
    )


def _label_places(x: float, y: float, label: str) -> list[tuple[chart.Anchor, Box]]:
    """Return possible places of a label within the panel, the best first.

    They are to the right and to the left of the mark, above it to either side, and below it to either side.
    """
    width = _LETTER * len(label)
    # Beyond a ring, also where a mark has none, so that all labels stand alike.
    distance = _RING + _LABEL_GAP
    beside_top = y - _LINE / 2
    above_top = y - distance - _LINE
    below_top = y + distance
    corners: list[tuple[chart.Anchor, chart.Point]] = [
        ("start", (x + distance, beside_top)),
        ("end", (x - distance - width, beside_top)),
        ("start", (x + _LABEL_GAP, above_top)),
        ("end", (x - _LABEL_GAP - width, above_top)),
        ("start", (x + _LABEL_GAP, below_top)),
        ("end", (x - _LABEL_GAP - width, below_top)),
    ]
    boxes = [(anchor, (left, top, left + width, top + _LINE)) for anchor, (left, top) in corners]
    return [(anchor, box) for anchor, box in boxes if _within_panel(box)]


def _within_panel(box: Box) -> bool:
    """Whether a label lies within the panel or in the free margins to its right and above.

    The upper edge needs no check: an axis goes on for half a step above the highest mark, so a label above this mark
    reaches only a few pixels into the margin.
    """
    left, _, right, bottom = box
    return left >= 0 and right <= chart.WIDTH + chart.RIGHT and bottom <= chart.HEIGHT


def _stair(places: Sequence[chart.Point]) -> str:
    """Join the marks that no other beats in both figures: those without another mark to their lower left.

    From left to right, such a mark lies lower than all marks before it. Pixels grow downwards, so lower marks have
    a larger y.
    """
    corners: list[chart.Point] = []
    lowest_y = -math.inf
    # Of marks with the same x, the lowest comes first, so that it hides the others.
    for x, y in sorted(set(places), key=lambda place: (place[0], -place[1])):
        if y > lowest_y:
            if corners:
                corners.append((x, lowest_y))
            corners.append((x, y))
            lowest_y = y
    return chart.polyline("stair", corners) if len(corners) > 1 else ""


def _legend(kinds: Sequence[str], y: float) -> str:
    """Define the shapes of marks, and draw a sample of everything that panels show, with its name, in one line."""
    samples: list[tuple[str, Callable[[float, float], str]]] = [
        *((name, partial(_shape, kind, style="mark")) for kind, name in enumerate(kinds)),
        ("on the front", partial(_shape, 0, style="mark front")),
        ("recommended", partial(_ring, radius=_LEGEND_RING)),
        ("best of the two figures", _stair_sample),
    ]
    drawn = _SHAPES
    x = _LEGEND_LEFT
    for name, sample in samples:
        drawn += sample(x, y)
        drawn += chart.soft_text(x + _LEGEND_TEXT, y + chart.HALF_LETTER, "start", name)
        x += _LEGEND_SPACE + _LETTER * len(name)
    return drawn


def _stair_sample(x: float, y: float) -> str:
    return chart.polyline("stair", [(x - _HALF_STAIR, y), (x + _HALF_STAIR, y)])


def _ring(x: float, y: float, radius: int) -> str:
    return f'<circle class="ring" cx="{x:.1f}" cy="{y:.1f}" r="{radius}"/>'


def _shape(kind: int, x: float, y: float, style: str, inside: str = "") -> str:
    number = kind % _SHAPE_COUNT
    return f'<use href="#shape{number}" class="{style}" x="{x:.1f}" y="{y:.1f}">{inside}</use>'


def _overlap(a: Box, b: Box) -> bool:
    a_left, a_top, a_right, a_bottom = a
    b_left, b_top, b_right, b_bottom = b
    return a_left < b_right and b_left < a_right and a_top < b_bottom and b_top < a_bottom
