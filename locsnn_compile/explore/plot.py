"""Scatter plots side by side as one SVG: light, dark and printed, and readable without colour.

Shapes tell kinds apart, a filled mark is on the front, a ring is around the recommended one, and a stair joins the
marks that no other beats in the two figures of a panel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

from hw_model.io.xml_text import xml_file, xml_text

_STYLE = """
:root{--paper:#fff;--ink:#15191e;--soft:#57606b;--rule:#dfe3e7;--accent:#1d5a86}
@media (prefers-color-scheme:dark){:root{--paper:#121518;--ink:#e8ebee;--soft:#a1abb6;--rule:#2d343b;--accent:#7db8e3}}
@media print{:root{--paper:#fff;--ink:#000;--soft:#444;--rule:#c4c9ce;--accent:#000}}
text{font:11px system-ui,-apple-system,"Segoe UI",Arial,sans-serif;fill:var(--ink)}
.title{font-size:14px;font-weight:600}.axis,.tick{fill:var(--soft)}
.paper{fill:var(--paper)}.grid{stroke:var(--rule)}.frame{stroke:var(--soft)}
.mark{fill:var(--paper);stroke:var(--soft);stroke-width:1.3}
.mark.front{fill:var(--accent);stroke:var(--paper);stroke-width:1}
.label{paint-order:stroke;stroke:var(--paper);stroke-width:3}
.ring{fill:none;stroke:var(--ink);stroke-width:1.6}
.stair{fill:none;stroke:var(--accent);stroke-width:1;stroke-dasharray:3 3}
"""
_SHAPES = ("circle", "square", "triangle", "diamond")
_WIDTH, _HEIGHT, _GAP = 330, 250, 74
"""Pixels of a panel, and left of each one, where its labels are."""
_TOP, _BOTTOM, _RIGHT = 74, 88, 18
_RADIUS, _RING = 4.5, 9
_LETTER, _LINE = 6.2, 12
"""Pixels that a letter and a line of a label take, about: labels keep clear of each other by this."""
_TICKS = 6

Box = tuple[float, float, float, float]
"""Left, top, right and bottom."""


@dataclass(frozen=True)
class Mark:
    """One setting: both figures, its ``kind`` among those of the picture, words beside it, and words shown over it."""

    x: float
    y: float
    kind: int
    label: str
    words: str
    front: bool
    taken: bool


@dataclass(frozen=True)
class Panel:
    """Marks over axes from 0; ``x_text`` and ``y_text`` write the figures of the ticks."""

    title: str
    x_label: str
    x_text: Callable[[float], str]
    y_text: Callable[[float], str]
    marks: tuple[Mark, ...]


def draw(title: str, subtitle: str, kinds: Sequence[str], panels: Sequence[Panel]) -> bytes:
    """Return the picture as a file; equal input gives equal bytes."""
    width, height = len(panels) * (_WIDTH + _GAP) + _RIGHT, _TOP + _HEIGHT + _BOTTOM
    root = Element("svg", {"xmlns": "http://www.w3.org/2000/svg", "viewBox": f"0 0 {width} {height}", "role": "img"})
    SubElement(root, "title").text = xml_text(title)
    SubElement(root, "style").text = _STYLE
    SubElement(root, "rect", {"class": "paper", "width": str(width), "height": str(height)})
    _text(root, 16, 22, title, "title")
    _text(root, 16, 39, subtitle, "axis")
    for i, panel in enumerate(panels):
        group = SubElement(root, "g", {"transform": f"translate({i * (_WIDTH + _GAP) + _GAP} {_TOP})"})
        _panel(group, panel)
    _legend(root, kinds, height - 20)
    return xml_file(root)


def _panel(group: Element, panel: Panel) -> None:
    x_step = nice_step(max((mark.x for mark in panel.marks), default=0.0))
    y_step = nice_step(max((mark.y for mark in panel.marks), default=0.0))
    x_end = _end(x_step, [mark.x for mark in panel.marks])
    y_end = _end(y_step, [mark.y for mark in panel.marks])
    _text(group, 0, -8, panel.title, "axis")
    for value in _ticks(y_step, y_end):
        y = _HEIGHT * (1 - value / y_end)
        _line(group, "grid", 0, y, _WIDTH, y)
        _text(group, -7, y + 4, panel.y_text(value), "tick", "end")
    for value in _ticks(x_step, x_end):
        x = _WIDTH * value / x_end
        _line(group, "frame", x, _HEIGHT, x, _HEIGHT + 4)
        _text(group, x, _HEIGHT + 17, panel.x_text(value), "tick", "middle")
    _line(group, "frame", 0, _HEIGHT, _WIDTH, _HEIGHT)
    _text(group, _WIDTH / 2, _HEIGHT + 35, panel.x_label, "axis", "middle")
    places = [(_WIDTH * mark.x / x_end, _HEIGHT * (1 - mark.y / y_end)) for mark in panel.marks]
    _stair(group, places)
    _marks(group, panel.marks, places)


def _marks(group: Element, marks: Sequence[Mark], places: Sequence[tuple[float, float]]) -> None:
    """Draw the marks, those of the front last, and label these wherever there is room."""
    order = sorted(range(len(marks)), key=lambda i: (marks[i].taken, marks[i].front))
    for i in order:
        mark, (x, y) = marks[i], places[i]
        shape = _shape(group, mark.kind, x, y, "mark front" if mark.front else "mark")
        SubElement(shape, "title").text = xml_text(mark.words)
        if mark.taken:
            SubElement(group, "circle", {"class": "ring", "cx": _n(x), "cy": _n(y), "r": str(_RING)})
    taken = [_around(x, y, _RING if mark.taken else _RADIUS) for mark, (x, y) in zip(marks, places, strict=True)]
    for i in reversed(order):
        if not (marks[i].front or marks[i].taken):
            continue
        for anchor, box in _label_places(*places[i], marks[i].label):
            if not any(_overlap(box, other) for other in taken):
                left = box[2] if anchor == "end" else box[0]
                _text(group, left, box[3] - 3, marks[i].label, "label", anchor)
                taken.append(box)
                break


def _label_places(x: float, y: float, label: str) -> list[tuple[str, Box]]:
    """Return where a label may stand, the best first: right, left, above and below to either side; within the panel."""
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
    return [(anchor, box) for anchor, box in boxes if box[0] >= 0 and box[2] <= _WIDTH + _RIGHT and box[3] <= _HEIGHT]


def _stair(group: Element, places: Sequence[tuple[float, float]]) -> None:
    """Join the places that none other has to its lower left (pixels grow downwards: a lower figure is further down)."""
    path: list[str] = []
    lowest = -math.inf
    for x, y in sorted(set(places), key=lambda place: (place[0], -place[1])):
        if y > lowest:
            path.append(f"H{_n(x)}V{_n(y)}" if path else f"M{_n(x)} {_n(y)}")
            lowest = y
    if len(path) > 1:
        SubElement(group, "path", {"class": "stair", "d": "".join(path)})


def _legend(root: Element, kinds: Sequence[str], y: float) -> None:
    x = 20.0
    entries = [(kind, "mark", name) for kind, name in enumerate(kinds)]
    entries += [(0, "mark front", "on the front"), (0, "ring", "recommended"), (0, "stair", "best of the two figures")]
    for kind, style, words in entries:
        if style == "ring":
            SubElement(root, "circle", {"class": "ring", "cx": _n(x), "cy": _n(y), "r": "6"})
        elif style == "stair":
            SubElement(root, "path", {"class": "stair", "d": f"M{_n(x - 8)} {_n(y)}h16"})
        else:
            _shape(root, kind, x, y, style)
        _text(root, x + 12, y + 4, words, "axis")
        x += 40 + _LETTER * len(words)


def _shape(parent: Element, kind: int, x: float, y: float, style: str) -> Element:
    r = _RADIUS
    match _SHAPES[kind % len(_SHAPES)]:
        case "circle":
            return SubElement(parent, "circle", {"class": style, "cx": _n(x), "cy": _n(y), "r": str(r)})
        case "square":
            corners = [(-r, -r), (r, -r), (r, r), (-r, r)]
        case "triangle":
            corners = [(0, -r - 1), (r + 1, r), (-r - 1, r)]
        case _:
            corners = [(0, -r - 1), (r + 1, 0), (0, r + 1), (-r - 1, 0)]
    points = " ".join(f"{_n(x + dx)},{_n(y + dy)}" for dx, dy in corners)
    return SubElement(parent, "polygon", {"class": style, "points": points})


def nice_step(largest: float) -> float:
    """Return the distance of ticks, 1, 2 or 5 times a power of ten: at most :data:`_TICKS` of them to the largest."""
    if largest <= 0:
        return 1.0
    least = largest / _TICKS
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= least * (1 - 1e-9))


def _end(step: float, values: Sequence[float]) -> float:
    """Return where an axis ends: half a step beyond a largest value that would lie in its end."""
    largest = max(values, default=0.0)
    return largest + 0.5 * step if largest > 0 else step


def _ticks(step: float, end: float) -> list[float]:
    return [i * step for i in range(math.floor(end / step + 1e-9) + 1)]


def _around(x: float, y: float, radius: float) -> Box:
    return x - radius, y - radius, x + radius, y + radius


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _text(parent: Element, x: float, y: float, words: str, style: str, anchor: str = "start") -> None:
    at = {"class": style, "x": _n(x), "y": _n(y), "text-anchor": anchor}
    SubElement(parent, "text", at).text = xml_text(words)


def _line(parent: Element, style: str, x1: float, y1: float, x2: float, y2: float) -> None:
    SubElement(parent, "line", {"class": style, "x1": _n(x1), "y1": _n(y1), "x2": _n(x2), "y2": _n(y2)})


def _n(value: float) -> str:
    return f"{value:.1f}"
