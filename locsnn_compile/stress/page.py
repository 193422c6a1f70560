"""The results of stress between two marks on a page written by people, and all rows in a CSV file next to it."""

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

BEGIN, END = "<!-- stress: begin -->", "<!-- stress: end -->"
PICTURES = "images"
"""Folder of the pictures, next to the page."""
TABLE = ".csv"
"""Suffix of the table of all rows, which has the page's name."""
_BY_CASE: Mapping[str, Any] = yaml_table(__package__, "pictures.yaml")
_NEW = f"# Numerical stress\n\n{BEGIN}\n{END}\n"


def write_page(path: Path, rows: Sequence[Row], chip: hw.Chip) -> None:
    """Write the summary between the marks of a page, or to a new page; pictures and rows go next to it."""
    where = f"page {path.name!r}"
    before, after = _around(path, where)
    drawn = {f"{path.stem}-{name}": picture for name, picture in _pictures(rows).items()}
    table = path.with_suffix(TABLE)
    said = f"Every row with its figures is in [{table.name}]({table.name})."
    shown = (f"![{Path(name).stem.replace('-', ' ')}]({PICTURES}/{name})" for name in drawn)
    body = "\n\n".join([_summary(rows, chip), said, *shown])
    (path.parent / PICTURES).mkdir(parents=True, exist_ok=True)
    for name, picture in drawn.items():
        replace_file(path.parent / PICTURES / name, picture, where)
    figures = [flatten(row) for row in stress_document(rows, chip)["rows"]]
    replace_file(table, csv_bytes(figures), where)
    replace_file(path, f"{before}{BEGIN}\n{body}\n{END}{after}".encode(), where)


def check_page(path: Path) -> None:
    """Refuse a page that cannot be written, before hours of work."""
    where = f"page {path.name!r}"
    if path.suffix == TABLE:
        raise InputError(
            where,
            "the table next to the page has this name",
            fix="Give the page another, such as .md.",
        )
    _around(path, where)
    pictures = [f"{PICTURES}/{path.stem}-{name}" for name in (*_BY_CASE, "long-runs.svg")]
    for name in () if path.exists() else (path.with_suffix(TABLE).name, *pictures):
        if (path.parent / name).exists():
            what = f"{name!r} next to it would be replaced, but belongs to no page"
            raise InputError(where, what, fix="Give the page another name.")


def _around(path: Path, where: str) -> tuple[str, str]:
    """Return the text before and after the marks of a page, or of a new one if it does not exist."""
    try:
        page = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        page = _NEW
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
    groups = list(dict.fromkeys(row.case.group for row in rows))
    parts = [
        (text(group), [row for row in rows if row.case.group == group], LEADS[group])
        for group in groups
    ]
    lines = [
        line(["group", "rows", *VERDICTS, "what it tries"]),
        line(["---", *["---:"] * 5, "---"]),
    ]
    lines += [
        line([name, count(len(part)), *map(count, by_verdict(part).values()), lead])
        for name, part, lead in [*parts, ("**all**", rows, "")]
    ]
    return f"{plural(len(rows), 'row')} on {text(chip.name)}.\n\n" + "\n".join(lines)


def _pictures(rows: Sequence[Row]) -> dict[str, bytes]:
    """Return the pictures by the end of their names; empty ones are left out."""
    pictures = {name: _by_case(rows, **asked) for name, asked in _BY_CASE.items()}
    pictures["long-runs.svg"] = _long_runs(rows)
    return {name: picture for name, picture in pictures.items() if picture is not None}


def _by_case(
    rows: Sequence[Row],
    *,
    title: str,
    group: str,
    x_label: str,
    y_log: bool,
    panels: Mapping[str, Any],
) -> bytes | None:
    rows_of_group = [row for row in rows if row.case.group == group]
    curves = {
        name: tuple(_curve(label, rows_of_group, *asked) for label, asked in drawn.items())
        for name, drawn in panels.items()
    }
    return _drawn(
        title, [Panel(name, x_label, drawn, y_log=y_log) for name, drawn in curves.items()]
    )


def _long_runs(rows: Sequence[Row]) -> bytes | None:
    named = {
        f"{row.case.name}, {row.case.strategy}": row.drift
        for row in rows
        if row.drift is not None
        and row.drift.error is not None
        and row.case.strategy != "delay-line"
    }
    errors = tuple(_by_tenth(name, drift, 1.0) for name, drift in named.items())
    shares = tuple(
        _by_tenth(name, drift, drift.bound) for name, drift in named.items() if drift.bound
    )
    panels = [
        Panel("largest error of each tenth, thresholds", "step", errors, x_log=False),
        Panel("the same, as a share of its bound", "step", shares, x_log=False, y_log=False),
    ]
    return _drawn("Neurons below the threshold in a long run", panels)


def _by_tenth(name: str, drift: Drift, unit: float) -> Curve:
    """Return the errors of a long run, in a unit, at the end of each tenth."""
    assert drift.error is not None
    tenth = drift.steps / len(drift.error)
    return Curve(
        name, tuple(((i + 1) * tenth, error / unit) for i, error in enumerate(drift.error))
    )


def _curve(label: str, rows: Sequence[Row], strategy: str, figure: str) -> Curve:
    """Return a curve of a figure by its name in :class:`Measured`."""
    points = []
    for row in rows:
        if row.case.strategy != strategy or row.case.x is None or row.measured is None:
            continue
        field, _ = Formatter().get_field(f"m.{figure}", (), {"m": row.measured})
        points.append((row.case.x, float(field)))
    return Curve(label, tuple(points))


def _drawn(title: str, panels: Sequence[Panel]) -> bytes | None:
    return (
        draw(title, panels)
        if any(curve.points for panel in panels for curve in panel.curves)
        else None
    )
