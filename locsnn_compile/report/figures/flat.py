"""Nested values as one list of figures, and rows of figures as a table."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from locsnn_compile.report.format import plain

Figures = dict[str, Any]
"""Leaves by dotted keys, in order."""
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""A spreadsheet may read a text that begins with one of these as a formula."""


def flatten(value: object, key: str = "") -> Figures:
    """Return the leaves of nested dictionaries and lists by dotted keys, in order."""
    leaves: Figures = {}
    waiting = [(key, value)]
    while waiting:
        key, value = waiting.pop()
        if isinstance(value, dict):
            items = [(str(name), item) for name, item in value.items()]
        elif isinstance(value, list):
            items = [(str(index), item) for index, item in enumerate(value)]
        else:
            leaves[key] = value
            continue
        waiting += [(f"{key}.{name}" if key else name, item) for name, item in reversed(items)]
    return leaves


def csv_bytes(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Return rows as a table with a column for each key of any row; nothing for no rows."""
    columns = dict.fromkeys(key for row in rows for key in row)
    return (
        table_bytes(columns, ([row.get(key) for key in columns] for row in rows)) if rows else b""
    )


def table_bytes(columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> bytes:
    """Return a table for a spreadsheet or a script; texts are on one line and never formulas."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue().encode()


def _cell(value: Any) -> Any:
    line = plain(value) if isinstance(value, str) else ""
    return f"'{line}" if line.startswith(_FORMULA) else line or value
