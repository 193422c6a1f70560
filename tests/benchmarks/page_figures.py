"""Figures as the pages of the benchmarks write them: tables, times, shares, ratios, and who was measured."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

Found = dict[str, Any]
GOALS: dict[str, dict[str, float]] = {
    "small": {"nengo-loihi": 1000, "sanafe": 200, "lava-dl": 40},
    "large": {"nengo-loihi": 100, "sanafe": 300, "lava-dl": 8},
}
"""How many times faster than a peer's first mode the engine is to be."""

LIMIT_GOAL = 0.5


def table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Return a table whose columns but the first few are numbers."""
    rule = ["---"] * left + ["---:"] * (len(head) - left)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [head, rule, *rows])


def made_by(what: str) -> str:
    """Return the sentence that says how a section's figures are made alone."""
    return f"Made by `pytest tests/benchmarks/{what} -m bench`."


def times(seconds: float) -> str:
    """Return microseconds with about three digits."""
    microseconds = seconds * 1e6
    return f"{microseconds:,.1f}" if microseconds < 1000 else f"{microseconds:,.0f}"


def percent(share: float, digits: int = 0) -> str:
    """Return a share as it is printed everywhere."""
    return f"{share * 100:.{digits}f} %"


def ratio(value: float) -> str:
    """Return a ratio with about two digits."""
    return f"{value:,.1f}" if value < 20 else f"{value:,.0f}"


def own(record: Found) -> Found:
    """Return our engine's row: a batch."""
    row: Found = record["rows"][0]
    return row


def peer(record: Found, tool: str) -> Found | None:
    """Return the row of a peer's first mode, if it was there."""
    return next((row for row in record["rows"] if row["tool"] == tool), None)


def limit_seconds(record: Found) -> float:
    """Return what adding rows takes, by the faster of the two kernels."""
    return float(min(record["limits"]["plain"], record["limits"]["rows"]))


def line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return start and slope of the line with the least squares of relative errors; the start is at least 0."""
    scaled = np.stack([1 / y, x / y], axis=1)
    (start, slope), *_ = np.linalg.lstsq(scaled, np.ones(len(y)), rcond=None)
    if start < 0:
        return 0.0, float((x / y).sum() / ((x / y) ** 2).sum())
    return float(start), float(slope)
