"""A Loihi-like chip: its arithmetic and limits, programs for it, and a simulator that counts.

It knows nothing of training, and imports neither torch nor the compiler.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hw_model.lazy import lazy_names

if TYPE_CHECKING:
    from hw_model.builder import ProgramBuilder
    from hw_model.chip_description import Chip, chip, chip_names, priced_by
    from hw_model.cost import energy_pj, latency
    from hw_model.counts import Counts
    from hw_model.early_stop import calibrate_margin, stop_at_margin, stop_when_proven, timestep_scores
    from hw_model.errors import InputError, LocsnnError, TargetError
    from hw_model.probes import Probe
    from hw_model.program import ChipProgram
    from hw_model.program_file import load_program
    from hw_model.range_proof import prove_range
    from hw_model.session import Session
    from hw_model.simulation import SimulationResult, simulate

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
        "Chip": "hw_model.chip_description",
        "ChipProgram": "hw_model.program",
        "Counts": "hw_model.counts",
        "InputError": "hw_model.errors",
        "LocsnnError": "hw_model.errors",
        "Probe": "hw_model.probes",
        "ProgramBuilder": "hw_model.builder",
        "Session": "hw_model.session",
        "SimulationResult": "hw_model.simulation",
        "TargetError": "hw_model.errors",
        "calibrate_margin": "hw_model.early_stop",
        "stop_at_margin": "hw_model.early_stop",
        "stop_when_proven": "hw_model.early_stop",
        "timestep_scores": "hw_model.early_stop",
        "chip": "hw_model.chip_description",
        "chip_names": "hw_model.chip_description",
        "energy_pj": "hw_model.cost",
        "latency": "hw_model.cost",
        "load_program": "hw_model.program_file",
        "priced_by": "hw_model.chip_description",
        "prove_range": "hw_model.range_proof",
        "simulate": "hw_model.simulation",
    },
)


def __dir__() -> list[str]:
    """Return the names to complete, those that are not imported yet among them."""
    return sorted({*globals(), *__all__})
