"""The integers from which SpiNNaker's are made.

A network is first rounded to the integers of ``loihi-sim``, and these are then lowered. Two limits of
that chip do not hold, for ring buffers take longer delays, and neurons rest longer, than its registers.
"""

from dataclasses import replace
from functools import cache

import hw_model as hw
from hw_model.description.chip import Chip
from hw_model.spinnaker.chips import SpinnakerChip

_SOURCE = hw.chip("loihi-sim")
_DELAY_MAX = (1 << 12) - 2
"""Steps. SpiNNaker's delay is one more, and has to fit into 2^12 slots of a ring buffer."""
_REFRACTORY_MAX = (1 << 15) - 1
"""Steps of 1 ms, well below the 65,536 ms at which s16.15 ends."""
REGISTERS = replace(_SOURCE.registers, delay_max=_DELAY_MAX, refractory_max=_REFRACTORY_MAX)


@cache
def grid_of(chip: SpinnakerChip) -> Chip:
    """Return the chip for whose integers a network is rounded, under the name of a SpiNNaker."""
    return replace(_SOURCE, name=chip.name, registers=REGISTERS)
