"""The content of a report apart from its form: verdicts, notices, and sections of text, tables and pictures.

    Report
      verdicts   questions with their answers, at the top
      notices    warnings before the figures
      sections   each with a heading, and blocks: paragraphs, lists, tables, plots

The words and numbers are chosen once, in ``report/sections``; the renderers ``html.py``, ``markdown.py`` and
``terminal.py`` (the forms) only give them form. Strings are unescaped here; each form escapes all of them.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal

from hw_model.values import Frozen
from locsnn_compile.report.pictures.axis import Axis

Document = dict[str, Any]
"""report.json, as ``figures/document.py`` builds it."""
Status = Literal["yes", "nearly", "no", "unknown", "modelled"]
"""The kind of a verdict's answer, which decides its sign and colour; ``modelled``: a number from a cost model."""


class Fact(Frozen):
    """A name and its value: ``accuracy`` - ``91 % on the chip``."""

    label: str
    value: str


class Verdict(Frozen):
    """A question, such as whether the program fits, with its answer at the top of the report.

    ``answer`` is a word or two, ``figure`` the number that matters most, with its ``figure_label``;
    ``sentence`` and ``facts`` say what is behind it.
    """

    question: str
    status: Status
    answer: str
    figure: str
    figure_label: str
    sentence: str
    facts: tuple[Fact, ...]


class Notice(Frozen):
    """Something a reader must know before believing the figures."""

    title: str
    text: str


class Facts(Frozen):
    """A list of names and values."""

    facts: tuple[Fact, ...]

    @classmethod
    def of(cls, values: Mapping[str, str | None]) -> "Facts":
        """Return a list of values by their names, without the values that are None or empty."""
        return cls(tuple(Fact(label, value) for label, value in values.items() if value))


class Bullets(Frozen):
    """A titled list."""

    title: str
    items: tuple[str, ...]


class Bar(Frozen):
    """A cell with a bar, filled to ``share`` (0..1, None for no bar); ``label`` says the share in words.

    ``pattern`` is the number of its hatching, the same as that of its share in a ``Stack``. With
    ``full_at``, forms with enough resolution draw what the share lacks of 1, and the bar is full when
    the share lacks ``full_at``: bars of 97 and 100 % look alike, but bars of 3 and 0 % do not.
    """

    share: float | None
    label: str
    pattern: int = 0
    full_at: float | None = None

    @property
    def drawn(self) -> float | None:
        """The part of the bar that is filled, 0..1; None for no bar."""
        if self.share is None or self.full_at is None:
            return self.share
        return (1.0 - self.share) / self.full_at


Cell = str | Bar


class Table(Frozen):
    """A table whose first column names the rows; columns without a heading hold bars, and all others numbers.

    ``total`` marks the last row as the sum of the others. Tables of more than :data:`MANY_ROWS` rows, and
    tables marked ``folded``, show their caption until a reader opens them, in forms that can fold.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    total: bool = False
    folded: bool = False


class Stack(Frozen):
    """One bar cut into labelled shares that add up to 1."""

    label: str
    shares: tuple[Bar, ...]


class Span(Frozen):
    """Least, median, mean and most of a quantity over the recordings, along an axis from 0.

    ``facts`` are these four in words, and ``values`` the same as numbers, in the same order.
    """

    title: str
    facts: tuple[Fact, ...]
    values: tuple[float, ...]
    axis: Axis


class Curve(Frozen):
    """A line through points (x, y) in order."""

    label: str
    points: tuple[tuple[float, float], ...]


class Plot(Frozen):
    """Curves over common axes, with a vertical line at x = ``marked``, if given.

    Forms without pictures leave it out: a table of the section has the same figures.
    """

    title: str
    x_label: str
    x: Axis
    y: Axis
    curves: tuple[Curve, ...]
    marked: float | None = None

    def placed(self, curve: Curve) -> list[tuple[float, float]]:
        """Return the points of a curve as shares (0..1) of the width and height, from the lower left corner."""
        return [(self.x.place(x), self.y.place(y)) for x, y in curve.points]


class Strokes(Frozen):
    """Spikes of one kind at (column, row), drawn as short strokes.

    ``equal`` are spikes of both the reference and the chip, ``reference`` and ``chip`` spikes of one of
    them alone, and ``event`` spikes of the input.
    """

    kind: Literal["equal", "reference", "chip", "event"]
    label: str
    points: tuple[tuple[int, int], ...]


class Raster(Frozen):
    """A picture of spikes over ``columns`` steps and ``rows`` neurons; ``description`` says it in words.

    ``flag`` is a (column, row) to point at. Forms without pictures leave it out: a table of the section
    has the same figures.
    """

    title: str
    description: str
    columns: int
    rows: int
    x_label: str
    x: Axis
    strokes: tuple[Strokes, ...]
    flag: tuple[int, int] | None = None
    flag_label: str = ""


class MeshCore(Frozen):
    """A core in a picture of the mesh, filled to ``share`` (0..1) and labelled with ``text``.

    ``column`` and ``row`` count cores, not tiles, over the whole mesh.
    """

    column: int
    row: int
    share: float
    text: str


class Mesh(Frozen):
    """A picture of a mesh of ``columns`` by ``rows`` tiles, each of ``tile_columns`` by ``tile_rows`` cores.

    It shows how full the used cores are. Forms without pictures leave it out: a table of the section has
    the same figures.
    """

    title: str
    description: str
    columns: int
    rows: int
    tile_columns: int
    tile_rows: int
    cores: tuple[MeshCore, ...]


class Folded(Frozen):
    """Blocks that show only their title until a reader opens them; forms that cannot fold show them all."""

    title: str
    blocks: "tuple[Block, ...]"

    @classmethod
    def of(cls, title: str, *blocks: "Block | None") -> "Folded | None":
        """Return the blocks that are neither None nor empty, under a title; None if none is left."""
        present = tuple(block for block in blocks if block)
        return cls(title, present) if present else None


Block = str | Facts | Bullets | Table | Stack | Span | Plot | Raster | Mesh | Folded
"""What a section consists of; a string is a paragraph."""

MANY_ROWS = 12
"""The longest table that is not folded, chosen by hand: about a third of a screen."""


class Section(Frozen):
    """A part of the report: a heading, a lead (the sentence that says what follows), and the blocks.

    ``key`` identifies it, and is its anchor in links. A ``folded`` section shows only its heading until a
    reader opens it, in forms that can fold.
    """

    key: str
    title: str
    lead: str
    blocks: tuple[Block, ...]
    folded: bool = False

    @classmethod
    def of(cls, key: str, title: str, lead: str, *blocks: Block | None) -> "Section":
        """Return a section without the blocks that are None and without empty paragraphs."""
        return cls(key, title, lead, tuple(block for block in blocks if block))

    @property
    def unfolded(self) -> tuple[Block, ...]:
        """All blocks in their order; a ``Folded`` block is replaced by the blocks in it."""
        return tuple(_unfolded(self.blocks))


def _unfolded(blocks: Iterable[Block]) -> Iterator[Block]:
    for block in blocks:
        if isinstance(block, Folded):
            yield from _unfolded(block.blocks)
        else:
            yield block


class Report(Frozen):
    """Everything that the page, the text file and the terminal show, in their order.

    ``kind`` says above the title of a page what kind of report it is; ``footer`` ends the page.
    """

    kind: str
    title: str
    subtitle: str
    verdicts: tuple[Verdict, ...]
    notices: tuple[Notice, ...]
    sections: tuple[Section, ...]
    footer: str
    assumptions: tuple[str, ...] = ()
    """What was assumed, in sentences; shown before anything else that limits the figures."""
