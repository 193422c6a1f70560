"""What a network trained on the chip's arithmetic is made of: registers and synapse formats, no float but its scale.

Nothing here imports torch, so that the compiler can read these numbers without it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hw_model.arithmetic.fixed_point import WEIGHT_SHIFT, effective_weight
from hw_model.arithmetic.weights import weight_grid


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


@dataclass(frozen=True)
class OwnSynapse:
    """A synapse from a neuron to itself: effective weight ``64 * mantissa * 2^exponent``, ``delay`` steps late."""

    mantissa: int
    exponent: int
    delay: int = 0

    @property
    def charge(self) -> int:
        """Effective weight in units of 64."""
        return int(effective_weight(np.array(self.mantissa), self.exponent)) >> WEIGHT_SHIFT


@dataclass(frozen=True)
class ChipPopulation:
    """The numbers of a population, and of the synapses onto it, on the chip.

    - ``threshold``: mantissa; ``decay``: effective, of u and v of the compartment that its inputs drive.
    - ``refractory_decay`` of u and v of the refractory dendrite; ``own``: synapses of a neuron to itself, one to the
      refractory dendrite (``dendrite``), several to the alpha dendrite (``delay-line``), or none.
    - ``refractory``: the chip's refractory count; 1 blocks no step.
    - ``exponent`` and ``weight_bits``: format of the incoming weights, positive and negative ones apart.
    - ``scale``: register units of a potential of 1 in the float network; ``unit``: the float weight of a mantissa of 1.
    """

    threshold: int
    decay: int
    refractory_decay: int
    refractory: int
    own: tuple[OwnSynapse, ...]
    exponent: int
    weight_bits: int
    scale: float
    unit: float

    @property
    def mantissa_max(self) -> int:
        """Largest magnitude of a mantissa."""
        return weight_grid(self.weight_bits, "excitatory").high

    @property
    def mantissa_step(self) -> int:
        """Distance of mantissas on the grid."""
        return weight_grid(self.weight_bits, "excitatory").step


@dataclass(frozen=True)
class ChipNumbers:
    """A network's numbers by population, the strategy they are for, and the chip whose arithmetic they follow."""

    target: str
    strategy: str
    populations: Mapping[str, ChipPopulation]
    registers: RegisterWidths = USUAL_REGISTERS
