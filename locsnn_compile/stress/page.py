"""What stress came to, between marks on a page that people wrote; all rows are a CSV file next to it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import hw_model as hw
from hw_model.io.files import replace_file
from locsnn_compile.errors import InputError
from locsnn_compile.report.figures.flat import csv_bytes, flatten
from locsnn_compile.report.format import count, plural
from locsnn_compile.report.renderers.markdown import line, text
from locsnn_compile.stress.cases import LEADS
from locsnn_compile.stress.document import stress_document
from locsnn_compile.stress.plots import pictures
from locsnn_compile.stress.row import VERDICTS, Row, by_verdict

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
    drawn = {f"{path.stem}-{name}": picture for name, picture in pictures(rows).items()}
    table = path.with_suffix(TABLE)
    said = f"Every row with its figures is in [{table.name}]({table.name})."
    body = "\n\n".join([_summary(rows, chip), said, *(f"![{_alt(name)}]({PICTURES}/{name})" for name in drawn)])
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


def _alt(name: str) -> str:
    return name.removesuffix(".svg").replace("-", " ")
