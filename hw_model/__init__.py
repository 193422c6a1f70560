"""A Loihi-like chip: its arithmetic and limits, programs for it, and a simulator that counts.

It knows nothing of training, and imports neither torch nor the compiler.
"""

from hw_model.builder import ProgramBuilder
from hw_model.chip import Chip, chip, chip_names
from hw_model.cost import energy_pj, latency
from hw_model.counts import Counts
from hw_model.errors import InputError, LocsnnError, TargetError
from hw_model.program import ChipProgram
from hw_model.program_file import load_program
from hw_model.simulate import SimulationResult, simulate

__all__ = [
    "Chip",
    "ChipProgram",
    "Counts",
    "InputError",
    "LocsnnError",
    "ProgramBuilder",
    "SimulationResult",
    "TargetError",
    "chip",
    "chip_names",
    "energy_pj",
    "latency",
    "load_program",
    "simulate",
]
