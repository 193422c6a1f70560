"""What a report consists of, apart from its form: sections of text, figures and tables.

    Report -- verdicts (questions answered) -- notices -- sections -- blocks

The words and numbers are chosen once, in ``verdict.py`` and the section files; ``html.py``, ``markdown.py`` and
``terminal.py`` only give them form. Strings are unescaped here; each form escapes all of them.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal

from hw_model.values import Frozen
from locsnn_compile.report.pictures.axis import Axis

Document = dict[str, Any]
"""report.json, as ``figures/document.py`` builds it."""
Status = Literal["yes", "nearly", "no", "unknown", "modelled"]


class Fact(Frozen):
    """A name and its value: ``accuracy`` - ``91 % on the chip``."""

    label: str
    value: str


class Verdict(Frozen):
    """A question, its answer in a word or two, the figure that matters most, and the facts behind it."""

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
        """Return values by their names; empty ones are left out."""
        return cls(tuple(Fact(label, value) for label, value in values.items() if value))


class Bullets(Frozen):
    """A titled list."""

    title: str
    items: tuple[str, ...]


class Bar(Frozen):
    """A cell that draws ``share`` (0..1, None for no share) of a track; ``label`` says it in words.

    ``pattern`` is that of the same part of a ``Stack``. With ``full_at``, forms that are fine
    enough draw what the share lacks of 1, on a track that is full when it lacks ``full_at``: 97
    and 100 % look alike, 3 and 0 % do not.
    """

    share: float | None
    label: str
    pattern: int = 0
    full_at: float | None = None

    @property
    def drawn(self) -> float | None:
        """The part of the track that is filled, 0..1; None for no share."""
        if self.share is None or self.full_at is None:
            return self.share
        return (1.0 - self.share) / self.full_at


Cell = str | Bar


class Table(Frozen):
    """A table whose first column names the rows; columns without a name are drawn, and all others hold numbers.

    ``total`` marks the last row as the sum of the others. Tables of more than ``MANY_ROWS`` rows, and those marked
    ``folded``, are folded in forms that can fold.
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

    ``values`` are the same as numbers.
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
    """Curves over common axes, with a line at ``marked`` of the horizontal one. A table has the same figures."""

    title: str
    x_label: str
    x: Axis
    y: Axis
    curves: tuple[Curve, ...]
    marked: float | None = None

    def placed(self, curve: Curve) -> list[tuple[float, float]]:
        """Return the points of a curve, 0..1 from the lower left corner."""
        return [(self.x.place(x), self.y.place(y)) for x, y in curve.points]


class Strokes(Frozen):
    """Spikes of one kind at (column, row): on both sides, on one side only, or of an input."""

    kind: Literal["equal", "reference", "chip", "event"]
    label: str
    points: tuple[tuple[int, int], ...]


class Raster(Frozen):
    """Spikes over ``columns`` steps and ``rows`` neurons. ``description`` is in words.

    ``flag`` is a (column, row) to point at. A table of the section has the same figures.
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
    """A core at (column, row) among all cores of the mesh, filled to ``share`` (0..1) and labelled with ``text``."""

    column: int
    row: int
    share: float
    text: str


class Mesh(Frozen):
    """Columns by rows of tiles, with their cores and how full these are. A table has the same figures."""

    title: str
    description: str
    columns: int
    rows: int
    tile_columns: int
    tile_rows: int
    cores: tuple[MeshCore, ...]


class Folded(Frozen):
    """Blocks that a reader opens by their title, in forms that can fold; others show them all."""

    title: str
    blocks: "tuple[Block, ...]"

    @classmethod
    def of(cls, title: str, *blocks: "Block | None") -> "Folded | None":
        """Return the blocks that are there below their title; None without any."""
        shown = tuple(block for block in blocks if block)
        return cls(title, shown) if shown else None


Block = str | Facts | Bullets | Table | Stack | Span | Plot | Raster | Mesh | Folded
"""What a section consists of; a string is a paragraph."""

MANY_ROWS = 12


class Section(Frozen):
    """A heading, a lead on what is shown below it, and the blocks. ``key`` is its anchor.

    A ``folded`` section is opened by its heading, in forms that can fold.
    """

    key: str
    title: str
    lead: str
    blocks: tuple[Block, ...]
    folded: bool = False

    @classmethod
    def of(cls, key: str, title: str, lead: str, *blocks: Block | None) -> "Section":
        """Return a section with the blocks that are there: None and empty paragraphs are left out."""
        return cls(key, title, lead, tuple(block for block in blocks if block))

    @property
    def unfolded(self) -> tuple[Block, ...]:
        """All blocks in their order, those of ``Folded`` ones in their place."""
        return tuple(_unfolded(self.blocks))


def _unfolded(blocks: Iterable[Block]) -> Iterator[Block]:
    for block in blocks:
        if isinstance(block, Folded):
            yield from _unfolded(block.blocks)
        else:
            yield block


class Report(Frozen):
    """Everything that the page, the text file and the terminal show, in their order.

    ``kind`` stands above the title of a page, ``footer`` at its end.
    """

    kind: str
    title: str
    subtitle: str
    verdicts: tuple[Verdict, ...]
    notices: tuple[Notice, ...]
    sections: tuple[Section, ...]
    footer: str
    assumptions: tuple[str, ...] = ()
    """Sentences that stand before anything else that limits the figures."""
