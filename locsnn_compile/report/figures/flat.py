"""From objects to values of a document, and from nested values to one list of figures."""

from __future__ import annotations

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
