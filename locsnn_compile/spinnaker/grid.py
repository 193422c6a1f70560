"""The integers from which SpiNNaker's are made: those of ``loihi-sim``, whose limits do not all hold here."""

from dataclasses import replace
from functools import cache

import hw_model as hw
from hw_model.description.chip import Chip
from hw_model.spinnaker.chips import SpinnakerChip

_SOURCE = hw.chip("loihi-sim")
REGISTERS = replace(_SOURCE.registers, delay_max=(1 << 12) - 2, refractory_max=(1 << 15) - 1)
"""Ring buffers hold longer delays, and neurons rest longer, than on ``loihi-sim``."""


@cache
def grid_of(chip: SpinnakerChip) -> Chip:
    """Return the chip for whose integers a network is rounded, under the name of a SpiNNaker."""
    return replace(_SOURCE, name=chip.name, registers=REGISTERS)
