"""From objects to values of a document, from nested values to one list of figures, from rows of them to a table."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from locsnn_compile.report.format import plain

Figures = dict[str, Any]
"""Leaves by dotted keys, in order."""
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""A spreadsheet may take a text that begins with one of them for something to work out."""


def picked(found: object, *names: str) -> Figures:
    """Return attributes of an object by their names."""
    return {name: getattr(found, name) for name in names}


def flatten(value: object, key: str = "") -> Figures:
    """Return the leaves of nested dictionaries and lists by dotted keys, in order; empty ones have none."""
    found: Figures = {}
    waiting = [(key, value)]
    while waiting:
        key, value = waiting.pop()
        if isinstance(value, dict):
            items = [(str(name), item) for name, item in value.items()]
        elif isinstance(value, list):
            items = [(str(index), item) for index, item in enumerate(value)]
        else:
            found[key] = value
            continue
        waiting += [(f"{key}.{name}" if key else name, item) for name, item in reversed(items)]
    return found


def csv_bytes(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Return rows as a table with a column for each key that one of them has; of no rows, nothing."""
    columns = dict.fromkeys(key for row in rows for key in row)
    return table_bytes(columns, ([row.get(key) for key in columns] for row in rows)) if rows else b""


def table_bytes(columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> bytes:
    """Return a table for a spreadsheet or a script; a text is on one line, and never a formula."""
    made = io.StringIO()
    writer = csv.writer(made, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return made.getvalue().encode()


def _cell(value: Any) -> Any:
    line = plain(value) if isinstance(value, str) else ""
    return f"'{line}" if line.startswith(_FORMULA) else line or value
