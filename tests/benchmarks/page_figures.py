"""How the pages of the benchmarks write figures: tables, times, shares and ratios; and how they find rows in the records.

A *record* is what a benchmark has measured, as ``conftest.py`` writes it: a JSON object.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

Found = dict[str, Any]
GOALS: dict[str, dict[str, float]] = {
    "small": {"nengo-loihi": 1000, "sanafe": 200, "lava-dl": 40},
    "large": {"nengo-loihi": 100, "sanafe": 300, "lava-dl": 8},
}
"""Our goals: how many times faster than a peer's first mode the engine should be."""

LIMIT_GOAL = 0.5
"""Our goal: the share of the machine's limit that the engine should reach."""


def table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Return a table; the first ``left`` columns are text, all others numbers, aligned to the right."""
    rule = ["---"] * left + ["---:"] * (len(head) - left)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [head, rule, *rows])


def made_by(what: str) -> str:
    """Return the sentence that names the command for the figures of a section."""
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
    """Return the row of a peer's first mode, None if the peer was not installed."""
    return next((row for row in record["rows"] if row["tool"] == tool), None)


def limit_seconds(record: Found) -> float:
    """Return the seconds of adding rows, by the faster of the two kernels."""
    return float(min(record["limits"]["plain"], record["limits"]["rows"]))


def line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return start and slope of the line with the least squares of relative errors; the start is at least 0."""
    # Dividing each equation start + slope x = y by y makes its error relative.
    scaled = np.stack([1 / y, x / y], axis=1)
    (start, slope), *_ = np.linalg.lstsq(scaled, np.ones(len(y)), rcond=None)
    if start < 0:
        return 0.0, float((x / y).sum() / ((x / y) ** 2).sum())
    return float(start), float(slope)
