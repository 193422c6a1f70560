"""Nested values of a document as one list of figures."""

from __future__ import annotations

from typing import Any

Figures = dict[str, Any]
"""Leaves by dotted keys, in order."""


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
