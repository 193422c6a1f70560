"""Flatten nested figures into dotted keys, and write rows of figures as CSV."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from locsnn_compile.report.format import plain

Figures = dict[str, Any]
"""The values in nested dictionaries and lists, by dotted keys such as ``energy.by_core_pj.0.pj``, in order."""
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Beginnings of texts that a spreadsheet may run as a formula (OWASP: CSV injection)."""


def flatten(value: object, key: str = "") -> Figures:
    """Return the values in nested dictionaries and lists by dotted keys, in order; ``key`` begins all keys."""
    leaves: Figures = {}
    # A stack rather than recursion: a file may nest deeper than Python recurses. Items are pushed in
    # reverse, so that the first is taken next.
    stack = [(key, value)]
    while stack:
        key, value = stack.pop()
        if isinstance(value, dict):
            items = [(str(name), item) for name, item in value.items()]
        elif isinstance(value, list):
            items = [(str(index), item) for index, item in enumerate(value)]
        else:
            leaves[key] = value
            continue
        prefix = f"{key}." if key else ""
        stack += [(prefix + name, item) for name, item in reversed(items)]
    return leaves


def csv_bytes(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Return rows as CSV with a column for each key of any row, in order of first use; nothing for no rows."""
    if not rows:
        return b""
    # A dictionary rather than a set, because it keeps the order.
    columns = dict.fromkeys(key for row in rows for key in row)
    return table_bytes(columns, ([row.get(key) for key in columns] for row in rows))


def table_bytes(columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> bytes:
    """Return CSV for a spreadsheet or a script; texts are on one line, and none can run as a formula."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue().encode()


def _cell(value: Any) -> Any:
    """Return a value as the CSV writer takes it; a leading apostrophe makes a spreadsheet read a text as text."""
    if not isinstance(value, str):
        return value
    line = plain(value)
    return f"'{line}" if line.startswith(_FORMULA) else line
