"""Tables of figures: cells of several seeds, Markdown, and CSV files."""

from __future__ import annotations

import csv
import re
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from result_rows import SEEDS

Found = Mapping[tuple[str, str], Mapping[int, Mapping[str, Any]]]
"""(data set, row) -> seed -> figures."""

Table = tuple[Sequence[str], Sequence[Sequence[str]]]
"""Head and rows."""

NOT_RUN = "not run"


def spread(values: Sequence[float], digits: int = 3) -> str:
    """Return mean and sample standard deviation; how many where they are not five."""
    if not values:
        return NOT_RUN
    deviation = f" ± {statistics.stdev(values):.{digits}f}" if len(values) > 1 else ""
    return f"{statistics.mean(values):.{digits}f}{deviation}{of_seeds(len(values))}"


def of_seeds(count: int) -> str:
    """Return how many seeds a figure is of, where they are not all."""
    return "" if count == len(SEEDS) else f" ({count} of {len(SEEDS)} seeds)"


def column(found: Found, dataset: str, row: str, key: str) -> list[float]:
    """Return a figure of every seed that has it."""
    return [float(f[key]) for f in found.get((dataset, row), {}).values() if f.get(key) is not None]


def markdown(made: Table) -> str:
    """Return a table as Markdown, its first column to the left."""
    head, rows = made
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " ---: |" * (len(head) - 1)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def write_table(path: Path, made: Table) -> None:
    head, rows = made
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([head, *rows])


def kept(path: Path) -> Table | None:
    """Return the table of a file, None where there is none."""
    if not path.exists():
        return None
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    return head, rows


def merged(made: Table, before: Table | None) -> Table:
    """Lay a table over one with the same head: rows are known by their first cell, and what was not run stays."""
    head, rows = made
    if before is None or list(before[0]) != list(head):
        return made
    old = {row[0]: list(row) for row in before[1]}
    new = {
        row[0]: [_laid(mine, was) for mine, was in zip(row, old.get(row[0], row), strict=True)]
        for row in rows
    }
    order = new if old.keys() <= new.keys() else old | new
    return head, [new.get(name, old.get(name, [])) for name in order]


def _laid(mine: str, was: str) -> str:
    """Return the cell that comes from more seeds."""
    return was if seeds_of(mine) < seeds_of(was) else mine


def seeds_of(cell: str) -> int:
    if cell == NOT_RUN:
        return 0
    found = re.search(rf"\((\d) of {len(SEEDS)} seeds\)", cell)
    return int(found[1]) if found else len(SEEDS)
