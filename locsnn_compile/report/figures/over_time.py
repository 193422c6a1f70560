"""What report.json says of predictions while a recording plays, and of where it could stop."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from hw_model.program.chip_program import ChipProgram
from locsnn_compile.verification.over_time import LeftOut, OverTime, savings

_POINTS = 50
"""Steps of a recording whose figures are kept, evenly spread, the last among them."""
_ORDER = ("together", "time", "location", "time_weighted")


def over_time_entry(found: OverTime | LeftOut, program: ChipProgram, step_seconds: float | None) -> dict[str, Any]:
    """Return ``over_time``; where nothing was followed, only why."""
    if isinstance(found, LeftOut):
        return {"left_out": found.reason}
    steps = len(next(iter(found.right.values())))
    kept = np.unique(np.ceil(np.arange(1, _POINTS + 1) * steps / _POINTS).astype(np.int64))
    return {
        "recordings": list(found.recordings),
        "recordings_available": found.available,
        "right_is": "the label" if found.labelled else "the prediction after the last step",
        "psi": found.psi,
        "step_seconds": step_seconds,
        "steps": kept.tolist(),
        "right": {name: found.right[name][kept - 1].tolist() for name in _ORDER if name in found.right},
        "proven_stop": asdict(savings(program, found.proven)),
    }
