"""How a cost spreads over recordings, classes, steps and cores, as plain values of report.json."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from hw_model.program.chip_program import ChipProgram
from locsnn_compile.verification.matching import Match

Document = dict[str, Any]
FloatArray = npt.NDArray[np.float64]
BINS = 64
"""Most bins of steps that a course over time is given in."""


def spread(each: FloatArray) -> Document:
    """Return least, median, 99th percentile and most of a cost of recordings."""
    return {
        "min": float(each.min()),
        "p50": float(np.median(each)),
        "p99": float(np.quantile(each, 0.99)),
        "max": float(each.max()),
    }


def worst(each: FloatArray, match: Match, unit: str) -> Document:
    """Return the recording that costs most, and its class where there are labels."""
    number = int(each.argmax())
    label = None if match.labels is None else int(match.labels[number])
    return {"recording": number, "class": label, unit: float(each[number])}


def by_class(each: FloatArray, match: Match, unit: str) -> list[Document] | None:
    """Return a cost of recordings by class; None without labels."""
    if match.labels is None:
        return None
    rows = []
    for label in np.unique(match.labels).tolist():
        its = each[match.labels == label]
        spread = {"min": float(its.min()), "mean": float(its.mean()), "max": float(its.max())}
        rows.append({"class": label, "recordings": len(its), **{f"{end}_{unit}": x for end, x in spread.items()}})
    return rows


def course(by_step: FloatArray) -> Document:
    """Add up values (steps,) in at most :data:`BINS` bins of equal length, but for the last."""
    length = max(1, -(-len(by_step) // BINS))
    return {"bin_steps": length, "bins": np.add.reduceat(by_step, np.arange(0, len(by_step), length)).tolist()}


def tile(program: ChipProgram, slot: int) -> Document:
    """Return where a core is on the board."""
    column, row = program.chip.tile_of(slot)
    return {"slot": slot, "tile": [column, row]}
