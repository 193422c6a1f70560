"""What a report consists of, apart from its form: sections of text, figures and tables.

    Report -- verdicts (three questions answered) -- notices -- sections -- blocks

The words and numbers are chosen once, in ``verdict.py`` and the section files; ``html.py``, ``markdown.py`` and
``terminal.py`` only give them form. Strings here are unescaped: each form escapes all of them. The functions at the end
build sections, facts and tables from rows, and leave out what there is not.
"""

from collections.abc import Iterable, Mapping
from typing import Any, Literal

from hw_model.values import Frozen
from locsnn_compile.report.words import fill, section_words, texts

Document = dict[str, Any]
"""report.json, as ``document.py`` builds it."""
Status = Literal["yes", "nearly", "no", "unknown", "modelled"]


class Fact(Frozen):
    """A name and what it is: ``accuracy`` - ``91 % on the chip``."""

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
    """Something a reader has to know before believing the figures."""

    title: str
    text: str


class Facts(Frozen):
    """A list of names and values."""

    facts: tuple[Fact, ...]


class Bullets(Frozen):
    """A titled list."""

    title: str
    items: tuple[str, ...]


class Bar(Frozen):
    """A cell that draws ``share`` (0..1) of a track; ``label`` says it in words. ``pattern`` matches a ``Stack``."""

    share: float
    label: str
    pattern: int = 0


Cell = str | Bar


class Table(Frozen):
    """A table whose first column names the rows; a column without a name is drawn, every other one holds numbers.

    ``total`` marks the last row as the sum of the others. A table of more than ``MANY_ROWS`` rows, or one that asks for
    it, is folded where the form can fold.
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
    """Least, median, mean and most of a quantity over the recordings; ``values`` are the same four as numbers."""

    title: str
    facts: tuple[Fact, ...]
    values: tuple[float, ...]


class Curve(Frozen):
    """A line through points (x, y) in order; those of a ``Plot`` are 0..1 from its lower left corner."""

    label: str
    points: tuple[tuple[float, float], ...]


class Plot(Frozen):
    """Curves over common axes; ticks are (place 0..1, text). A table of the section has its figures too.

    ``marked`` is a place on the horizontal axis that a line is drawn at.
    """

    title: str
    x_label: str
    x_ticks: tuple[tuple[float, str], ...]
    y_ticks: tuple[tuple[float, str], ...]
    curves: tuple[Curve, ...]
    marked: float | None = None


class Strokes(Frozen):
    """Spikes of one kind at (column, row): of both sides, of one alone, or of an input."""

    kind: Literal["equal", "reference", "chip", "event"]
    label: str
    points: tuple[tuple[int, int], ...]


class Raster(Frozen):
    """Spikes over ``columns`` steps and ``rows`` neurons; ticks are (place 0..1, text). ``description`` is in words.

    ``flag`` is a (column, row) to point at. A table of the section has its figures too.
    """

    title: str
    description: str
    columns: int
    rows: int
    x_label: str
    x_ticks: tuple[tuple[float, str], ...]
    strokes: tuple[Strokes, ...]
    flag: tuple[int, int] | None = None
    flag_label: str = ""


class MeshCore(Frozen):
    """A core at (column, row) of all cores of the mesh, ``share`` (0..1) of it in use; ``text`` says so in it."""

    column: int
    row: int
    share: float
    text: str


class Mesh(Frozen):
    """Tiles, columns by rows, each of cores, and how full these are. A table of the section has its figures too."""

    title: str
    description: str
    columns: int
    rows: int
    tile_columns: int
    tile_rows: int
    cores: tuple[MeshCore, ...]


Block = str | Facts | Bullets | Table | Stack | Span | Plot | Raster | Mesh
"""What a section consists of; a string is a paragraph of running text."""

MANY_ROWS = 12


class Section(Frozen):
    """A heading, a sentence on what is shown below it, and the blocks. ``key`` is its anchor."""

    key: str
    title: str
    lead: str
    blocks: tuple[Block, ...]


class Report(Frozen):
    """Everything that the page and the text file show, in their order."""

    title: str
    subtitle: str
    verdicts: tuple[Verdict, Verdict, Verdict]
    notices: tuple[Notice, ...]
    sections: tuple[Section, ...]
    assumptions: tuple[str, ...] = ()
    """Sentences, before anything else that limits the figures."""


def section(key: str, *blocks: Block | None, called: str | None = None, **given: Any) -> Section:
    """Return a section of those of the blocks that there are, with the words for its key, or those ``called`` so."""
    return Section(key, *section_words(called or key, **given), tuple(block for block in blocks if block))


def facts(name: str, /, **given: Any) -> Facts:
    """Return names and values of ``words.yaml``, their places filled; a value with nothing in it is left out."""
    found = ((label, fill(text, given)) for label, text in texts("facts", name).items())
    return Facts(tuple(Fact(label, value) for label, value in found if value))


def verdict(name: str, status: Status, answer: str, facts: Facts, /, **given: Any) -> Verdict:
    """Return a verdict in the words of ``words.yaml``, their places filled."""
    said = {key: fill(text, given) for key, text in texts("verdicts", name).items()}
    return Verdict(status=status, answer=answer, facts=facts.facts, **said)


def notice(name: str, /, **given: Any) -> Notice:
    """Return a notice in the words of ``words.yaml``, their places filled."""
    said = texts("notices", name)
    return Notice(said["title"], fill(said["text"], given))


def table(
    name: str,
    rows: Mapping[str, Any] | Iterable[Mapping[str, Any]],
    /,
    *,
    columns: Mapping[str, str] | None = None,
    total: bool = False,
    folded: bool = False,
    **given: Any,
) -> Table:
    """Return a table of ``words.yaml``: under each heading what stands there for a row, its places filled by its keys.

    Rows that are given by name have it as ``name``, and what is no mapping as ``value``. Under no heading stands the
    row's ``bar``. ``columns`` are more of them, in place of ``*``.
    """
    said = texts("tables", name)
    if isinstance(rows, Mapping):
        rows = ({"name": name, **(row if isinstance(row, Mapping) else {"value": row})} for name, row in rows.items())
    named: dict[str, str] = {}
    for heading, text in said["columns"].items():
        named |= columns or {} if heading == "*" else {fill(heading, given): text}
    made = (tuple(fill(text, row) if head else row["bar"] for head, text in named.items()) for row in rows)
    return Table(fill(said["caption"], given), tuple(named), tuple(made), total, folded)


def share_of(value: float, whole: float) -> float:
    """Return a part as a share of its whole, 0 of nothing."""
    return value / whole if whole else 0.0
