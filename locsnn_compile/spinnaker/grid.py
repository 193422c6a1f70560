"""The integer grid to which networks are rounded before they are lowered to SpiNNaker.

A network is first rounded to the integers of ``loihi-sim``, so that the passes for that chip can be used; these
integers are then lowered to SpiNNaker's. Two limits of ``loihi-sim`` are raised, since SpiNNaker allows longer delays
and longer refractory periods.
"""

from dataclasses import replace
from functools import cache

import hw_model as hw
from hw_model.description.chip import Chip
from hw_model.spinnaker.chips import SpinnakerChip

_SOURCE = hw.chip("loihi-sim")
_DELAY_MAX = (1 << 12) - 2
"""The longest delay in steps. In SpiNNaker's count a delay is one more, and must be below 2^12, the most slots of a
ring buffer."""
_REFRACTORY_MAX = (1 << 15) - 1
"""The longest refractory period in steps of 1 ms, well below 65,536 ms, where the number format s16.15 ends."""
REGISTERS = replace(_SOURCE.registers, delay_max=_DELAY_MAX, refractory_max=_REFRACTORY_MAX)


@cache
def grid_of(chip: SpinnakerChip) -> Chip:
    """Return the chip description for rounding: that of ``loihi-sim`` with raised limits, named as the SpiNNaker chip.

    Errors during rounding thus name the chip that the user asked for.
    """
    return replace(_SOURCE, name=chip.name, registers=REGISTERS)
