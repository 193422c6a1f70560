"""Tables of figures: cells that sum up several seeds, Markdown, and CSV files.

Training all networks takes many hours and is done in parts. So a table is laid over the one that is already in its file: a cell
from more seeds replaces one from fewer, and what was not run stays.
"""

from __future__ import annotations

import csv
import re
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from result_rows import SEEDS

RunFigures = Mapping[tuple[str, str], Mapping[int, Mapping[str, Any]]]
"""The figures of all runs that there are: (data set, row) -> seed -> figure by name."""

Table = tuple[Sequence[str], Sequence[Sequence[str]]]
"""Head and rows."""

NOT_RUN = "not run"


def spread(values: Sequence[float], digits: int = 3) -> str:
    """Return mean and sample standard deviation; also the number of values if they are not all five seeds."""
    if not values:
        return NOT_RUN
    deviation = f" ± {statistics.stdev(values):.{digits}f}" if len(values) > 1 else ""
    return f"{statistics.mean(values):.{digits}f}{deviation}{of_seeds(len(values))}"


def of_seeds(count: int) -> str:
    """Return a note on how many seeds a figure is from, empty if from all."""
    return "" if count == len(SEEDS) else f" ({count} of {len(SEEDS)} seeds)"


def column(found: RunFigures, dataset: str, row: str, key: str) -> list[float]:
    """Return a figure of every seed that has it."""
    return [float(f[key]) for f in found.get((dataset, row), {}).values() if f.get(key) is not None]


def markdown(table: Table) -> str:
    """Return a table as Markdown, its first column to the left."""
    head, rows = table
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " ---: |" * (len(head) - 1)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def write_table(path: Path, table: Table) -> None:
    """Write a table as CSV."""
    head, rows = table
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([head, *rows])


def read_table(path: Path) -> Table | None:
    """Return the table of a file, None if there is no such file."""
    if not path.exists():
        return None
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    return head, rows


def merged(table: Table, table_before: Table | None) -> Table:
    """Lay a table over the one from before, if both have the same head; rows with the same first cell are one row.

    Rows that were not made again stay, and so do cells from more seeds.
    """
    head, rows = table
    if table_before is None or list(table_before[0]) != list(head):
        return table
    old = {row[0]: list(row) for row in table_before[1]}
    new = {
        row[0]: [_laid(mine, was) for mine, was in zip(row, old.get(row[0], row), strict=True)]
        for row in rows
    }
    # New rows are in the order of the study; if there are old rows besides, theirs is kept and further rows follow.
    order = new if old.keys() <= new.keys() else old | new
    return head, [new.get(name, old.get(name, [])) for name in order]


def _laid(cell: str, cell_before: str) -> str:
    """Return the cell that comes from more seeds."""
    return cell_before if seeds_of(cell) < seeds_of(cell_before) else cell


def seeds_of(cell: str) -> int:
    """Return how many seeds a cell is from."""
    if cell == NOT_RUN:
        return 0
    note = re.search(rf"\((\d) of {len(SEEDS)} seeds\)", cell)
    return int(note[1]) if note else len(SEEDS)
