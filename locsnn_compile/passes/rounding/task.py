"""A population to put into integers: how much trouble its rounding takes, and how large its numbers become."""

import math

import numpy as np

from hw_model.arithmetic.fixed_point import WEIGHT_EXPONENTS, WeightGrid, weight_grid
from hw_model.description.chip import Chip
from hw_model.values import FloatArray, Frozen
from locsnn_compile.errors import TargetError
from locsnn_compile.network.chip_neurons import ChipNeuron
from locsnn_compile.network.network import Population
from locsnn_compile.network.projections import ChipProjection, Projection, row_maxima
from locsnn_compile.reference.evaluate import Calibration


class Rounding(Frozen):
    """What is done beyond rounding every weight to the nearest of one format.

    ``fitted_decays``: two decays an alpha dendrite, those whose response fits the kernel best. ``graded``: weights of a
    population in up to :data:`~locsnn_compile.passes.rounding.grades.GRADES` formats, each in the finest that holds it.
    What needs calibration recordings: ``error_aware`` rounds the weights of a neuron together, for the least error of
    its potential; ``scaled_apart`` gives neurons scales of their own. ``split``: the share of weights, 0 to 1, that get
    a second synapse for what their format cannot hold.
    """

    fitted_decays: bool = False
    graded: bool = False
    error_aware: bool = False
    scaled_apart: bool = False
    split: float = 0.0


NEAREST = Rounding()
FINE = Rounding(fitted_decays=True, graded=True, error_aware=True, scaled_apart=True)


class Task(Frozen, eq=False):
    """A float population, the weights onto it, and how they are to be rounded for a chip: onto a ``grid``."""

    population: Population
    incoming: tuple[Projection, ...]
    chip: Chip
    grid: WeightGrid
    strategy: str
    rounding: Rounding
    calibration: Calibration | None

    @property
    def where(self) -> str:
        """How errors name it."""
        return f"population {self.population.name!r}"

    def no_scale(self, other: str, measured: str, fix: str) -> TargetError:
        """Return the error of neurons for which no threshold mantissa of 1 or more is left."""
        what = f"no scale holds both the threshold and the {other}"
        return TargetError(self.where, what, measured=measured, fix=fix)

    @property
    def largest(self) -> FloatArray:
        """The largest weight onto each neuron, (n,)."""
        maxima = [np.zeros(self.population.size), *(row_maxima(p.weights) for p in self.incoming)]
        return np.asarray(np.max(maxima, axis=0))


HEADROOM = 16
"""The voltage register holds at least this many thresholds: potentials of trained networks go that far."""
CHARGE_ROOM = 4
"""The charge register holds at least this many thresholds in a step."""
WHOLE = 1 + 1e-12
"""A quotient that float rounding left this little below a whole number is that number."""


class Scaled(Frozen, eq=False):
    """Neurons in integers, and how weights onto them are rounded.

    A potential of 1 is ``scale`` (n,) in the registers; a weight of 1 is an effective weight of ``gain * scale``, in a
    format of this ``exponent``.
    """

    neuron: ChipNeuron
    scale: FloatArray
    gain: FloatArray
    exponent: int


Rounded = tuple[Scaled, list[list[ChipProjection]]]
"""Neurons in integers, and the projections that each projection onto them becomes."""


def own_grid(chip: Chip) -> WeightGrid:
    """Return the grid of self-synapses: the chip's finest, since one weight a population costs little."""
    return weight_grid(chip.registers.weight_bits[-1], "excitatory")


def largest_charge(chip: Chip) -> int:
    """Return the largest charge of a step, in units of the threshold mantissa."""
    return (1 << chip.registers.charge_bits) // 64 - 1


def heaviest_weight(chip: Chip) -> float:
    """Return the largest weight of any format that the charge register holds, in units of the threshold mantissa."""
    return min(own_grid(chip).high * 2.0 ** WEIGHT_EXPONENTS[-1], largest_charge(chip))


def exponent_holding(largest: float, grid: WeightGrid) -> int:
    """Return the smallest exponent with which a format holds a weight and no mantissa loses bits."""
    finest = 1 - grid.step.bit_length()
    return max(finest, math.ceil(math.log2(largest / grid.high))) if largest > 0 else finest


def exponent_and_threshold(
    heaviest: float, grid: WeightGrid, chip: Chip, cap: int, over: int, headroom: int
) -> tuple[int, int]:
    """Return weight exponent and largest threshold mantissa: all weight bits in use, then most of the register.

    ``heaviest``: the largest weight in thresholds. ``cap``: a limit of the mantissa besides those of the registers. A
    threshold stands for ``64 * mantissa + over`` in the voltage register, which holds ``headroom`` of them, as the
    current register does; that of a step's charge holds :data:`CHARGE_ROOM` where the others hold :data:`HEADROOM`.
    Narrow registers hold fewer, but one.
    """
    registers = chip.registers
    room = (
        registers.voltage_max / headroom,
        (1 << registers.current_bits) / headroom,
        (1 << registers.charge_bits) * HEADROOM / CHARGE_ROOM / headroom,
    )
    cap = min(cap, max(1, int(min(room) / 64)))
    most = heaviest_weight(chip)
    fits = [min(grid.high * 2**e, most) / heaviest - over / 64 if heaviest else math.inf for e in range(8)]
    exponent = max((e for e, threshold in enumerate(fits) if threshold <= cap), default=None)
    if exponent is not None:
        return exponent, int(fits[exponent] * WHOLE)
    return min(0, exponent_holding(heaviest * (cap + over / 64), grid)), cap


def checked_scale(task: Task, heaviest: float, cap: int, over: int, *, bounded: bool = False) -> tuple[int, int]:
    """Return what :func:`exponent_and_threshold` does for a task; ``bounded``: potentials stay below the threshold.

    Refuses a threshold mantissa of less than 1: then a weight is heavier than the grid's largest next to it.
    """
    chip, grid, headroom = task.chip, task.grid, 1 if bounded else HEADROOM
    exponent, threshold = exponent_and_threshold(heaviest, grid, chip, cap, over, headroom)
    if threshold < 1:
        most = min(grid.high * 2.0 ** WEIGHT_EXPONENTS[-1], heaviest_weight(chip)) / (1 + over / 64)
        measured = f"one weight reaches {heaviest:.3g} thresholds against {most:.0f}"
        raise task.no_scale("largest weight", measured, "Train with smaller weights, or a higher threshold.")
    return exponent, threshold
