"""Programs of any arithmetic, read from their folder as their files say."""

from collections.abc import Callable, Mapping
from pathlib import Path

from hw_model.io.given import checked
from hw_model.program.chip_program import ChipProgram
from hw_model.program.read import chip_program_of
from hw_model.program.sealed import (
    CHIP_PROGRAM,
    SPINNAKER_PROGRAM,
    XYLO_PROGRAM,
    SealedPair,
    read_pair,
)
from hw_model.spinnaker.files import spinnaker_program_of
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.xylo.files import xylo_program_of
from hw_model.xylo.program import XyloProgram

AnyProgram = ChipProgram | XyloProgram | SpinnakerProgram
READERS: Mapping[object, Callable[[SealedPair], AnyProgram]] = {
    CHIP_PROGRAM: chip_program_of,
    XYLO_PROGRAM: xylo_program_of,
    SPINNAKER_PROGRAM: spinnaker_program_of,
}
"""What reads a program, by the ``format`` that its files say."""


@checked
def load_any_program(folder: str | Path) -> AnyProgram:
    """Read a program of any arithmetic; anything missing, damaged or newer is an ``InputError``."""
    pair = read_pair(Path(folder))
    return READERS.get(pair.kind, chip_program_of)(pair)
