"""How energy and latency spread: over recordings and classes, over the steps of a phase, and over cores."""

from collections.abc import Iterable, Mapping

import numpy as np

from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import FloatArray
from locsnn_compile.report.content import Document
from locsnn_compile.verification.matching import Match

BINS = 64
"""Most bins of steps in a course over time."""


def spread(each: FloatArray, match: Match, unit: str) -> Document:
    """Return the spread of a cost over recordings, the costliest recording, and the classes, None without labels."""
    most, labels = int(each.argmax()), match.labels
    ends = {
        "min": each.min(),
        "p50": np.median(each),
        "p99": np.quantile(each, 0.99),
        "max": each.max(),
    }
    worst = {
        "recording": most,
        "class": None if labels is None else int(labels[most]),
        unit: float(each[most]),
    }
    return {
        f"over_samples_{unit}": {name: float(value) for name, value in ends.items()},
        "worst_recording": worst,
        "by_class": None
        if labels is None
        else [_of_class(c, each[labels == c], unit) for c in np.unique(labels)],
    }


def _of_class(label: int, each: FloatArray, unit: str) -> Document:
    ends = {"min": each.min(), "mean": each.mean(), "max": each.max()}
    costs = {f"{end}_{unit}": float(value) for end, value in ends.items()}
    return {"class": int(label), "recordings": len(each), **costs}


def course(by_step: FloatArray) -> Document:
    """Add up values (steps,) in at most :data:`BINS` bins, all but the last of equal length."""
    length = max(1, -(-len(by_step) // BINS))
    return {
        "bin_steps": length,
        "bins": np.add.reduceat(by_step, np.arange(0, len(by_step), length)).tolist(),
    }


def place(program: ChipProgram, core: Core) -> Document:
    """Return the number, phase and place of a core."""
    where = {"slot": core.slot, "tile": list(program.chip.tile_of(core.slot))}
    return {"core": core.number, "phase": core.phase, **where}


def by_core(program: ChipProgram, found: Mapping[str, Iterable[Document]]) -> list[Document]:
    """Return the figures of all phases, given core by core, in the order of the cores' numbers."""
    rows = [
        place(program, core) | its
        for phase, each in found.items()
        for core, its in zip(program.cores_of(phase), each, strict=True)
    ]
    return sorted(rows, key=lambda row: row["core"])
