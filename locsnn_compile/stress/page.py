"""The rows as a page of Markdown, between marks in a text that people wrote."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import hw_model as hw
from hw_model.io.files import replace_file
from locsnn_compile.errors import InputError
from locsnn_compile.report.format import agreed, count, plural, short
from locsnn_compile.report.renderers.markdown import line, text
from locsnn_compile.stress.cases import LEADS
from locsnn_compile.stress.plots import pictures
from locsnn_compile.stress.row import VERDICTS, Drift, Measured, Row

BEGIN, END = "<!-- stress: begin -->", "<!-- stress: end -->"
PICTURES = "images"
"""Folder of the pictures, beside the page."""
_NEW = f"# Numerical stress\n\n{BEGIN}\n{END}\n"
_NONE = "-"


def write_page(path: Path, rows: Sequence[Row], chip: hw.Chip) -> None:
    """Write the rows between the marks of a page, or to a new page, and its pictures beside it."""
    where = f"page {path.name!r}"
    before, after = _around(path, where)
    drawn = {f"{path.stem}-{name}": picture for name, picture in pictures(rows).items()}
    body = "\n\n".join(
        [_summary(rows, chip), *(f"![{_alt(name)}]({PICTURES}/{name})" for name in drawn), *_groups(rows)]
    )
    try:
        (path.parent / PICTURES).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            where, "its folder cannot be made", measured=error.strerror or "", fix="Give a file that can be written."
        ) from None
    for name, picture in drawn.items():
        replace_file(path.parent / PICTURES / name, picture, where)
    replace_file(path, f"{before}{BEGIN}\n{body}\n{END}{after}".encode(), where)


def check_page(path: Path) -> None:
    """Refuse a page that could not be written to, before hours of work are."""
    _around(path, f"page {path.name!r}")


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
    counted = {group: Counter(row.verdict for row in rows if row.case.group == group) for group in groups}
    everything = Counter(row.verdict for row in rows)
    lines = [line(["", "rows", *VERDICTS]), line(["---", *["---:"] * (1 + len(VERDICTS))])]
    lines += [
        line([name, count(sum(found.values())), *(count(found[verdict]) for verdict in VERDICTS)])
        for name, found in [*((_linked(group), counted[group]) for group in groups), ("**all**", everything)]
    ]
    return f"{plural(len(rows), 'row')} on {text(chip.name)}.\n\n" + "\n".join(lines)


def _groups(rows: Sequence[Row]) -> list[str]:
    parts = []
    for group in dict.fromkeys(row.case.group for row in rows):
        mine = [row for row in rows if row.case.group == group]
        long = [(row, row.drift) for row in mine if row.drift is not None]
        parts += [f"## {_title(group)}", LEADS[group], _table(mine)]
        if long:
            parts.append(_long_table(long))
    return parts


def _table(rows: Sequence[Row]) -> str:
    head = ["case", "strategy", "verdict", "spikes: float, chip", "equal", "otherwise", "error", "bound", "because"]
    lines = [line(head), line(["---"] * 3 + ["---:"] * 5 + ["---"])]
    for row in rows:
        why = text("; ".join(row.causes)) or _NONE
        figures = [_NONE] * 5 if row.measured is None else _figures(row.measured)
        lines.append(line([text(row.case.name), row.case.strategy, row.verdict, *figures, why]))
    return "\n".join(lines)


def _figures(m: Measured) -> list[str]:
    spikes = m.spikes
    return [
        f"{count(spikes.reference_spikes)}, {count(spikes.chip_spikes)}",
        agreed(spikes.agreement, _NONE),
        f"{count(m.otherwise)} of {count(m.decisions)}",
        _thresholds(m.error),
        _thresholds(m.bound),
    ]


def _thresholds(value: float) -> str:
    """Return a magnitude with two digits, or whole where it is large."""
    return count(value) if value >= 100 else short(value)


def _long_table(rows: Sequence[tuple[Row, Drift]]) -> str:
    head = ["long run", "strategy", "steps", "spikes: float, chip", "equal, first tenth", "last tenth"]
    head += ["error, first tenth", "last tenth", "bound"]
    lines = [line(head), line(["---"] * 2 + ["---:"] * 7)]
    for row, drift in rows:
        both = [sum(match.reference_spikes for match in drift.spikes), sum(match.chip_spikes for match in drift.spikes)]
        errors = (
            [_NONE] * 3 if drift.error is None else [short(e) for e in (drift.error[0], drift.error[-1], drift.bound)]
        )
        cells = [text(row.case.name), row.case.strategy, count(drift.steps), ", ".join(count(n) for n in both)]
        cells += [agreed(drift.spikes[i].agreement, _NONE) for i in (0, -1)]
        lines.append(line([*cells, *errors]))
    return "\n".join(lines)


def _title(group: str) -> str:
    return text(group[0].upper() + group[1:])


def _linked(group: str) -> str:
    return f"[{text(group)}](#{group.replace(' ', '-')})"


def _alt(name: str) -> str:
    return name.removesuffix(".svg").replace("-", " ")
