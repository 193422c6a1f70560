"""How large the numbers of a population become in the chip's registers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hw_model.arithmetic.weights import WEIGHT_EXPONENTS, WeightGrid
from hw_model.description.chip import Chip
from locsnn_compile.errors import TargetError
from locsnn_compile.network.chip_neurons import ChipNeuron
from locsnn_compile.network.neurons import FloatArray

HEADROOM = 16
"""The voltage register holds at least this many thresholds: potentials of trained networks go that far."""
HEAVIEST = 255 * 2.0 ** WEIGHT_EXPONENTS[-1]
"""The largest weight of any format, in units of the threshold mantissa."""
WHOLE = 1 + 1e-12
"""A quotient that float rounding left this little below a whole number is that number."""


@dataclass(frozen=True, eq=False)
class Scaled:
    """Neurons in integers, and how weights onto them are rounded.

    A potential of 1 is ``scale`` (n,) in the registers; a weight of 1 is an effective weight of ``gain * scale``, in a
    format of this ``exponent``.
    """

    neuron: ChipNeuron
    scale: FloatArray
    gain: FloatArray
    exponent: int


def exponent_and_threshold(
    heaviest: float, grid: WeightGrid, chip: Chip, cap: int, over: int, headroom: int = HEADROOM
) -> tuple[int, int]:
    """Return weight exponent and largest threshold mantissa: all weight bits in use, then most of the register.

    ``heaviest``: the largest weight in thresholds. ``cap``: a limit of the mantissa beside that of the register. A
    threshold stands for ``64 * mantissa + over`` in the register, which holds ``headroom`` of them.
    """
    cap = min(cap, chip.registers.voltage_max // (64 * headroom))
    fits = [grid.high * 2**e / heaviest - over / 64 if heaviest else math.inf for e in range(8)]
    exponent = max((e for e, most in enumerate(fits) if most <= cap), default=0)
    return exponent, int(min(fits[exponent] * WHOLE, cap))


def check_threshold(threshold: int, heaviest: float, grid: WeightGrid, over: int, where: str) -> None:
    """Refuse a threshold mantissa of less than 1: then a weight is heavier than the grid's largest beside it."""
    if threshold < 1:
        most = grid.high * 2.0 ** WEIGHT_EXPONENTS[-1] / (1 + over / 64)
        raise TargetError(
            where,
            "no scale holds both the threshold and the largest weight",
            measured=f"one weight reaches {heaviest:.3g} thresholds against {most:.0f}",
            fix="Train with smaller weights, or a higher threshold.",
        )
