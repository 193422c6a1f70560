"""A Loihi-like chip: its arithmetic and limits, programs for it, and a simulator that counts.

It knows nothing of training, and imports neither torch nor the compiler.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hw_model._lazy import lazy_names

if TYPE_CHECKING:
    from hw_model.accounting.cost import energy_pj, latency
    from hw_model.description.chip import Chip, chip, chip_names, priced_by
    from hw_model.description.counts import Counts
    from hw_model.engine.probes import Probe
    from hw_model.errors import InputError, LocsnnError, TargetError
    from hw_model.program.builder import ProgramBuilder
    from hw_model.program.chip_program import ChipProgram
    from hw_model.program.read import load_program
    from hw_model.range_proof import prove_range
    from hw_model.simulation import SimulationResult, simulate
    from hw_model.streaming.early_stop import calibrate_margin, stop_at_margin, stop_when_proven, timestep_scores
    from hw_model.streaming.session import Session

__all__ = [
    "Chip",
    "ChipProgram",
    "Counts",
    "InputError",
    "LocsnnError",
    "Probe",
    "ProgramBuilder",
    "Session",
    "SimulationResult",
    "TargetError",
    "calibrate_margin",
    "chip",
    "chip_names",
    "energy_pj",
    "latency",
    "load_program",
    "priced_by",
    "prove_range",
    "simulate",
    "stop_at_margin",
    "stop_when_proven",
    "timestep_scores",
]

__getattr__ = lazy_names(
    __name__,
    {
        "Chip": "hw_model.description.chip",
        "ChipProgram": "hw_model.program.chip_program",
        "Counts": "hw_model.description.counts",
        "InputError": "hw_model.errors",
        "LocsnnError": "hw_model.errors",
        "Probe": "hw_model.engine.probes",
        "ProgramBuilder": "hw_model.program.builder",
        "Session": "hw_model.streaming.session",
        "SimulationResult": "hw_model.simulation",
        "TargetError": "hw_model.errors",
        "calibrate_margin": "hw_model.streaming.early_stop",
        "stop_at_margin": "hw_model.streaming.early_stop",
        "stop_when_proven": "hw_model.streaming.early_stop",
        "timestep_scores": "hw_model.streaming.early_stop",
        "chip": "hw_model.description.chip",
        "chip_names": "hw_model.description.chip",
        "energy_pj": "hw_model.accounting.cost",
        "latency": "hw_model.accounting.cost",
        "load_program": "hw_model.program.read",
        "priced_by": "hw_model.description.chip",
        "prove_range": "hw_model.range_proof",
        "simulate": "hw_model.simulation",
    },
)


def __dir__() -> list[str]:
    """Return the names to complete, those that are not imported yet among them."""
    return sorted({*globals(), *__all__})
