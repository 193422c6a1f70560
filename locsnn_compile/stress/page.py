"""What stress came to, between marks on a page that people wrote; all rows are a CSV file next to it."""

from collections.abc import Callable, Sequence
from pathlib import Path

import hw_model as hw
from hw_model.io.files import replace_file
from locsnn_compile.errors import InputError
from locsnn_compile.report.content import Curve
from locsnn_compile.report.figures.flat import csv_bytes, flatten
from locsnn_compile.report.format import count, plural
from locsnn_compile.report.pictures.chart import Panel, draw
from locsnn_compile.report.renderers.markdown import line, text
from locsnn_compile.settings import NATIVE
from locsnn_compile.stress.bounds import SOURCES, Source
from locsnn_compile.stress.cases import LEADS
from locsnn_compile.stress.row import VERDICTS, Drift, Measured, Row, by_verdict, stress_document

BEGIN, END = "<!-- stress: begin -->", "<!-- stress: end -->"
PICTURES = "images"
"""Folder of the pictures, next to the page."""
TABLE = ".csv"
"""Ending of the table of all rows, which has the page's name."""
_NEW = f"# Numerical stress\n\n{BEGIN}\n{END}\n"


def write_page(path: Path, rows: Sequence[Row], chip: hw.Chip) -> None:
    """Write the summary between the marks of a page, or to a new page; its pictures and its rows go next to it."""
    where = f"page {path.name!r}"
    before, after = _around(path, where)
    drawn = {f"{path.stem}-{name}": picture for name, picture in _pictures(rows).items()}
    table = path.with_suffix(TABLE)
    said = f"Every row with its figures is in [{table.name}]({table.name})."
    shown = (f"![{Path(name).stem.replace('-', ' ')}]({PICTURES}/{name})" for name in drawn)
    body = "\n\n".join([_summary(rows, chip), said, *shown])
    try:
        (path.parent / PICTURES).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            where, "its folder cannot be made", measured=error.strerror or "", fix="Give a file that can be written."
        ) from None
    for name, picture in drawn.items():
        replace_file(path.parent / PICTURES / name, picture, where)
    figures = [flatten(row) for row in stress_document(rows, chip)["rows"]]
    replace_file(table, csv_bytes(figures), where)
    replace_file(path, f"{before}{BEGIN}\n{body}\n{END}{after}".encode(), where)


def check_page(path: Path) -> None:
    """Refuse a page that could not be written to, before hours of work are."""
    where = f"page {path.name!r}"
    if path.suffix == TABLE:
        raise InputError(where, "the table next to the page has this name", fix="Give the page another, such as .md.")
    _around(path, where)


def _around(path: Path, where: str) -> tuple[str, str]:
    """Return what stands before and after the marks; of a page that does not exist, of a new one."""
    try:
        page = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        page = _NEW
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            where, "it cannot be read", measured=getattr(error, "strerror", "") or "not text", fix="Give a text file."
        ) from None
    if page.count(BEGIN) != 1 or page.count(END) != 1 or page.index(BEGIN) > page.index(END):
        raise InputError(
            where, "it has no place for the table", fix=f"Put the lines {BEGIN} and {END} there, or give a new file."
        )
    return page[: page.index(BEGIN)], page[page.index(END) + len(END) :]


def _summary(rows: Sequence[Row], chip: hw.Chip) -> str:
    groups = list(dict.fromkeys(row.case.group for row in rows))
    parts = [(text(group), [row for row in rows if row.case.group == group], LEADS[group]) for group in groups]
    lines = [line(["group", "rows", *VERDICTS, "what it tries"]), line(["---", *["---:"] * 5, "---"])]
    lines += [
        line([name, count(len(part)), *map(count, by_verdict(part).values()), lead])
        for name, part, lead in [*parts, ("**all**", rows, "")]
    ]
    return f"{plural(len(rows), 'row')} on {text(chip.name)}.\n\n" + "\n".join(lines)


def _pictures(rows: Sequence[Row]) -> dict[str, bytes]:
    """Return the pictures by the end of their names; one that has nothing to show is left out."""
    made = {
        "time-constants.svg": _time_constants(rows),
        "weights.svg": _weights(rows),
        "long-runs.svg": _long_runs(rows),
    }
    return {name: picture for name, picture in made.items() if picture is not None}


def _time_constants(rows: Sequence[Row]) -> bytes | None:
    figures: dict[str, Callable[[Measured], float]] = {
        "error found": lambda m: m.error_thresholds,
        "bound": lambda m: m.bound_thresholds,
    }
    figures |= {f"of it {source}": _bound_by(source) for source in SOURCES}
    panels = [
        Panel(
            f"{strategy}: error in thresholds",
            "time constant, steps",
            tuple(_curve(name, rows, "time constants", strategy, figure) for name, figure in figures.items()),
        )
        for strategy in ("dendrite", NATIVE)
    ]
    return _drawn("Error of potentials by time constant, same spikes on both sides", panels)


def _bound_by(source: Source) -> Callable[[Measured], float]:
    return lambda m: m.bound_parts_thresholds[source]


def _weights(rows: Sequence[Row]) -> bytes | None:
    group = "weights against the threshold"

    def curves(of: Callable[[Measured], float]) -> tuple[Curve, ...]:
        return tuple(_curve(strategy, rows, group, strategy, of) for strategy in ("dendrite", NATIVE))

    x_label = "weights, times those the threshold is made for"
    panels = [
        Panel(
            "share of weights that round to 0", x_label, curves(lambda m: m.weights.lost / m.weights.of), y_log=False
        ),
        Panel("wraps and clips", x_label, curves(lambda m: m.wraps + m.clips), y_log=False),
    ]
    return _drawn("Weights over twelve orders of magnitude, one threshold", panels)


def _long_runs(rows: Sequence[Row]) -> bytes | None:
    named = {
        f"{row.case.name}, {row.case.strategy}": row.drift
        for row in rows
        if row.drift is not None and row.drift.error is not None and row.case.strategy != "delay-line"
    }
    errors = tuple(_by_tenth(name, drift, 1.0) for name, drift in named.items())
    shares = tuple(_by_tenth(name, drift, drift.bound) for name, drift in named.items() if drift.bound)
    panels = [
        Panel("largest error of each tenth, thresholds", "step", errors, x_log=False),
        Panel("the same as a share of its bound", "step", shares, x_log=False, y_log=False),
    ]
    return _drawn("Neurons below the threshold in a long run", panels)


def _by_tenth(name: str, drift: Drift, unit: float) -> Curve:
    """Return the errors of a long run over a unit, at the end of each tenth."""
    assert drift.error is not None
    tenth = drift.steps / len(drift.error)
    return Curve(name, tuple(((i + 1) * tenth, error / unit) for i, error in enumerate(drift.error)))


def _curve(label: str, rows: Sequence[Row], group: str, strategy: str, figure: Callable[[Measured], float]) -> Curve:
    points = tuple(
        (row.case.x, figure(row.measured))
        for row in rows
        if row.case.group == group
        and row.case.strategy == strategy
        and row.case.x is not None
        and row.measured is not None
    )
    return Curve(label, points)


def _drawn(title: str, panels: Sequence[Panel]) -> bytes | None:
    return draw(title, panels) if any(curve.points for panel in panels for curve in panel.curves) else None
