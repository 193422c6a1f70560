"""What a network trained on the chip's arithmetic is made of: registers and synapse formats, no float but its scale.

Nothing here imports torch, so that the compiler can read these numbers without it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hw_model.arithmetic.fixed_point import WeightGrid, weight_grid
from locsnn_compile.network.chip_neurons import ChipNeuron


@dataclass(frozen=True)
class RegisterWidths:
    """Widths of registers in bits, the sign not counted."""

    charge_bits: int = 21
    current_bits: int = 23
    voltage_bits: int = 23


USUAL_REGISTERS = RegisterWidths()
"""Those of the chips that ship."""
TRAINED_BITS = range(9, 30)
"""Widths that networks are trained on: no sum on the way needs more than 32 bits."""


@dataclass(frozen=True, eq=False)
class ChipPopulation:
    """A population on the chip, and the synapses onto it.

    - ``neuron``: all neurons of it have the same integers, and one decay of current and voltage.
    - ``exponent`` and ``weight_bits``: format of the incoming weights, positive and negative ones apart.
    - ``scale``: register units of a potential of 1 in the float network; ``unit``: the float weight of a mantissa of 1.
    """

    neuron: ChipNeuron
    exponent: int
    weight_bits: int
    scale: float
    unit: float

    @property
    def grid(self) -> WeightGrid:
        """The magnitudes that a mantissa may have."""
        return weight_grid(self.weight_bits, "excitatory")


@dataclass(frozen=True)
class ChipNumbers:
    """A network's populations, the strategy they are laid out by, and the chip whose arithmetic they follow."""

    target: str
    strategy: str
    populations: Mapping[str, ChipPopulation]
    registers: RegisterWidths = USUAL_REGISTERS
