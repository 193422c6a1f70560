"""From objects to values of a document, from nested values to one list of figures, from rows of them to a table."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

Figures = dict[str, Any]
"""Leaves by dotted keys, in order."""


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
    if not rows:
        return b""
    made = io.StringIO()
    writer = csv.DictWriter(made, dict.fromkeys(key for row in rows for key in row), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return made.getvalue().encode()
