"""``locsnn stress -o``: write the results into a page of the documentation.

The page is a Markdown file written by people. It has two marks, comments that a reader does not see, and
what lies between them is replaced: a table of verdicts, and pictures. All rows are in a CSV file next to
the page.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Formatter
from typing import Any

import hw_model as hw
from hw_model.io.files import replace_file
from hw_model.texts.templates import yaml_table
from locsnn_compile.errors import InputError
from locsnn_compile.report.content import Curve
from locsnn_compile.report.figures.flat import csv_bytes, flatten
from locsnn_compile.report.format import count, plural
from locsnn_compile.report.pictures.chart import Panel, draw
from locsnn_compile.report.renderers.markdown import line, text
from locsnn_compile.stress.cases import LEADS
from locsnn_compile.stress.row import VERDICTS, Drift, Row, by_verdict, stress_document

BEGIN = "<!-- stress: begin -->"
END = "<!-- stress: end -->"
PICTURES = "images"
"""Folder of the pictures, next to the page."""
TABLE = ".csv"
"""Suffix of the table of all rows, which has the page's name."""
_PICTURES_BY_CASE: Mapping[str, Any] = yaml_table(__package__, "pictures.yaml")
"""Pictures over the cases of a group, by the ends of their names; the file says what they draw."""
_LONG_RUNS = "long-runs.svg"
"""The end of the name of the picture of long runs."""
_NEW_PAGE = f"# Numerical stress\n\n{BEGIN}\n{END}\n"


def write_page(path: Path, rows: Sequence[Row], chip: hw.Chip) -> None:
    """Write the summary between the marks of a page, or to a new page; pictures and rows go next to it."""
    where = f"page {path.name!r}"
    before, after = _text_around_marks(path, where)
    pictures = {f"{path.stem}-{name}": picture for name, picture in _pictures(rows).items()}
    table = path.with_suffix(TABLE)
    table_sentence = f"Every row with its figures is in [{table.name}]({table.name})."
    picture_links = []
    for name in pictures:
        alternative_text = Path(name).stem.replace("-", " ")
        picture_links.append(f"![{alternative_text}]({PICTURES}/{name})")
    body = "\n\n".join([_summary(rows, chip), table_sentence, *picture_links])
    (path.parent / PICTURES).mkdir(parents=True, exist_ok=True)
    for name, picture in pictures.items():
        replace_file(path.parent / PICTURES / name, picture, where)
    table_rows = [flatten(row) for row in stress_document(rows, chip)["rows"]]
    replace_file(table, csv_bytes(table_rows), where)
    # The page last: it never names a file that is not there.
    replace_file(path, f"{before}{BEGIN}\n{body}\n{END}{after}".encode(), where)


def check_page(path: Path) -> None:
    """Refuse a page that cannot be written, before the rows are played for minutes."""
    where = f"page {path.name!r}"
    if path.suffix == TABLE:
        raise InputError(
            where,
            "the table next to the page has this name",
            fix="Give the page another, such as .md.",
        )
    _text_around_marks(path, where)
    if path.exists():
        return
    # Files with the names of a new page's files are somebody else's.
    pictures = [f"{PICTURES}/{path.stem}-{name}" for name in (*_PICTURES_BY_CASE, _LONG_RUNS)]
    for name in (path.with_suffix(TABLE).name, *pictures):
        if (path.parent / name).exists():
            what = f"{name!r} next to it would be replaced, but belongs to no page"
            raise InputError(where, what, fix="Give the page another name.")


def _text_around_marks(path: Path, where: str) -> tuple[str, str]:
    """Return the text before and after the marks of a page, or of a new page if it does not exist."""
    try:
        page = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        page = _NEW_PAGE
    except (OSError, UnicodeDecodeError) as error:
        measured = getattr(error, "strerror", "") or "not text"
        raise InputError(
            where, "it cannot be read", measured=measured, fix="Give a text file."
        ) from None
    if page.count(BEGIN) != 1 or page.count(END) != 1 or page.index(BEGIN) > page.index(END):
        fix = f"Put the lines {BEGIN} and {END} there, or give a new file."
        raise InputError(where, "it has no place for the table", fix=fix)
    return page[: page.index(BEGIN)], page[page.index(END) + len(END) :]


def _summary(rows: Sequence[Row], chip: hw.Chip) -> str:
    """Return a Markdown table with a line for each group: how many rows have each verdict."""
    groups = list(dict.fromkeys(row.case.group for row in rows))
    number_columns = 1 + len(VERDICTS)
    lines = [
        line(["group", "rows", *VERDICTS, "what it tries"]),
        line(["---", *["---:"] * number_columns, "---"]),
    ]
    for group in groups:
        rows_of_group = [row for row in rows if row.case.group == group]
        lines.append(_count_line(text(group), rows_of_group, LEADS[group]))
    lines.append(_count_line("**all**", rows, ""))
    return f"{plural(len(rows), 'row')} on {text(chip.name)}.\n\n" + "\n".join(lines)


def _count_line(name: str, rows: Sequence[Row], lead: str) -> str:
    """Return a line of the table; ``lead`` says what the group tries."""
    return line([name, count(len(rows)), *map(count, by_verdict(rows).values()), lead])


def _pictures(rows: Sequence[Row]) -> dict[str, bytes]:
    """Return the pictures by the end of their names; empty ones are left out."""
    pictures = {
        name: _picture_by_case(rows, **description)
        for name, description in _PICTURES_BY_CASE.items()
    }
    pictures[_LONG_RUNS] = _picture_of_long_runs(rows)
    return {name: picture for name, picture in pictures.items() if picture is not None}


def _picture_by_case(
    rows: Sequence[Row],
    *,
    title: str,
    group: str,
    x_label: str,
    y_log: bool,
    panels: Mapping[str, Any],
) -> bytes | None:
    """Draw figures over the number ``x`` that a group varies; the arguments come from pictures.yaml.

    ``panels`` has, by the title of a panel and the label of a curve, the strategy and the figure.
    """
    rows_of_group = [row for row in rows if row.case.group == group]
    drawn_panels: list[Panel] = []
    for panel_title, curve_descriptions in panels.items():
        curves = tuple(
            _curve(label, rows_of_group, strategy, figure)
            for label, (strategy, figure) in curve_descriptions.items()
        )
        drawn_panels.append(Panel(panel_title, x_label, curves, y_log=y_log))
    return _drawn(title, drawn_panels)


def _picture_of_long_runs(rows: Sequence[Row]) -> bytes | None:
    """Draw the errors of long runs in thresholds, and as shares of their bounds, by tenth of the run."""
    drift_by_name: dict[str, Drift] = {}
    for row in rows:
        has_errors = row.drift is not None and row.drift.error is not None
        # Without ``delay-line``: which curves are drawn is chosen by hand.
        if has_errors and row.case.strategy != "delay-line":
            assert row.drift is not None
            drift_by_name[f"{row.case.name}, {row.case.strategy}"] = row.drift
    errors = tuple(_curve_by_tenth(name, drift, 1.0) for name, drift in drift_by_name.items())
    shares = tuple(
        _curve_by_tenth(name, drift, drift.bound)
        for name, drift in drift_by_name.items()
        if drift.bound
    )
    panels = [
        Panel("largest error of each tenth, thresholds", "step", errors, x_log=False),
        Panel("the same, as a share of its bound", "step", shares, x_log=False, y_log=False),
    ]
    return _drawn("Neurons below the threshold in a long run", panels)


def _curve_by_tenth(name: str, drift: Drift, unit: float) -> Curve:
    """Return the errors of a long run, in multiples of ``unit``, at the last step of each tenth."""
    assert drift.error is not None
    tenth_steps = drift.steps / len(drift.error)
    points = [((i + 1) * tenth_steps, error / unit) for i, error in enumerate(drift.error)]
    return Curve(name, tuple(points))


def _curve(label: str, rows: Sequence[Row], strategy: str, figure: str) -> Curve:
    """Return a figure of the rows of one strategy over their x.

    ``figure`` names it as a replacement field of ``str.format`` would: an attribute of
    :class:`Measured`, such as ``weights.share`` or ``bound_parts_thresholds[weights]``.
    """
    points = []
    for row in rows:
        if row.case.strategy != strategy or row.case.x is None or row.measured is None:
            continue
        value, _ = Formatter().get_field(f"m.{figure}", (), {"m": row.measured})
        points.append((row.case.x, float(value)))
    return Curve(label, tuple(points))


def _drawn(title: str, panels: Sequence[Panel]) -> bytes | None:
    """Return the picture; None if it would have no curve, as in a quick run."""
    has_points = any(curve.points for panel in panels for curve in panel.curves)
    return draw(title, panels) if has_points else None
