"""The task of putting a population into integers: how carefully to round, and how large its numbers become."""

import math

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import WEIGHT_EXPONENTS, WeightGrid, weight_grid
from hw_model.description.chip import Chip
from hw_model.values import FloatArray, Frozen
from locsnn_compile.errors import TargetError
from locsnn_compile.network.chip_neurons import ChipNeuron
from locsnn_compile.network.network import Population
from locsnn_compile.network.projections import ChipProjection, Projection, row_maxima
from locsnn_compile.reference.evaluate import Calibration
from locsnn_compile.settings import Setting


class Rounding(Frozen):
    """What is done beyond rounding every weight to the nearest value of one format.

    - ``fitted_decays``: each alpha dendrite gets two decays, whose response fits the kernel best
    - ``graded``: weights of a population are in up to :data:`~locsnn_compile.passes.rounding.grades.GRADES` formats,
      each in the finest that holds it
    - ``error_aware``: the weights of a neuron are rounded together, for the least error of its potential; needs
      calibration recordings
    - ``scaled_apart``: each neuron has its own scale; needs calibration recordings
    - ``split``: the share of weights, 0 to 1, that get a second synapse for what their format cannot hold
    """

    fitted_decays: bool = False
    graded: bool = False
    error_aware: bool = False
    scaled_apart: bool = False
    split: float = 0.0


NEAREST = Rounding()
FINE = Rounding(fitted_decays=True, graded=True, error_aware=True, scaled_apart=True)


class Task(Frozen, eq=False):
    """A float population, the weights onto it, and how to round them onto a chip's ``grid``."""

    population: Population
    incoming: tuple[Projection, ...]
    chip: Chip
    grid: WeightGrid
    setting: Setting
    rounding: Rounding
    calibration: Calibration | None

    @property
    def strategy(self) -> str:
        """How SRM neurons are laid out."""
        return self.setting.strategy

    @property
    def where(self) -> str:
        """How errors name it."""
        return self.population.where

    def no_scale(self, other: str, measured: str, fix: str) -> TargetError:
        """Return the error for neurons that no threshold mantissa from 1 up would fit."""
        return TargetError(
            self.where,
            f"no scale holds both the threshold and the {other}",
            measured=measured,
            fix=fix,
        )

    @property
    def largest(self) -> FloatArray:
        """The largest magnitude of the weights onto each neuron, (n,)."""
        maxima = [np.zeros(self.population.size), *(row_maxima(p.weights) for p in self.incoming)]
        return np.asarray(np.max(maxima, axis=0))


HEADROOM = 16
"""The voltage register holds at least this many thresholds: potentials of trained networks reach that far."""
CHARGE_ROOM = 4
"""The charge register holds at least this many thresholds in a step."""
WHOLE = 1 + 1e-12
"""Factor that makes up for float rounding, which may leave a quotient slightly below a whole number."""


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
    """Return the grid of self-synapses: the chip's finest, since so few weights cost little."""
    return weight_grid(chip.registers.weight_bits[-1], "excitatory")


def largest_charge(chip: Chip) -> int:
    """Return the largest charge of one step, in units of the threshold mantissa."""
    return loihi.largest_charge(chip.registers.charge_bits)


def heaviest_weight(chip: Chip) -> float:
    """Return the largest weight of any format that the charge register holds, in units of the threshold mantissa."""
    return min(own_grid(chip).high * 2.0 ** WEIGHT_EXPONENTS[-1], largest_charge(chip))


def exponent_holding(largest: float, grid: WeightGrid) -> int:
    """Return the smallest exponent with which a format holds a weight and mantissas keep all their bits."""
    finest = 1 - grid.step.bit_length()
    return max(finest, math.ceil(math.log2(largest / grid.high))) if largest > 0 else finest


def exponent_and_threshold(
    heaviest: float, grid: WeightGrid, chip: Chip, cap: int, over: int, headroom: int
) -> tuple[int, int]:
    """Return weight exponent and largest threshold mantissa: first use all weight bits, then most of the register.

    ``heaviest`` is the largest weight in thresholds, ``cap`` a further limit of the mantissa. A threshold is
    ``over`` more than its mantissa says in the voltage register. Voltage and current registers hold ``headroom``
    thresholds; that of the charge holds :data:`CHARGE_ROOM` thresholds when the others hold :data:`HEADROOM`. Narrow
    registers hold fewer, but at least one.
    """
    registers = chip.registers
    # The largest threshold, in units of the register, of which each register holds enough.
    largest_thresholds = (
        registers.voltage_max / headroom,
        registers.half_current / headroom,
        registers.half_charge * HEADROOM / CHARGE_ROOM / headroom,
    )
    cap = min(cap, max(1, int(loihi.in_units(min(largest_thresholds)))))
    heaviest_held = heaviest_weight(chip)
    threshold_of = [
        min(grid.high * 2**e, heaviest_held) / heaviest - loihi.in_units(over)
        if heaviest
        else math.inf
        for e in range(8)
    ]
    exponent = max(
        (e for e, threshold in enumerate(threshold_of) if threshold <= cap), default=None
    )
    if exponent is not None:
        # Some weights are more thresholds than a mantissa holds: they need a larger exponent for a threshold of 1.
        exponent = next(
            (e for e in range(exponent, len(threshold_of)) if threshold_of[e] * WHOLE >= 1),
            exponent,
        )
        return exponent, min(int(threshold_of[exponent] * WHOLE), cap)
    return min(0, exponent_holding(heaviest * (cap + loihi.in_units(over)), grid)), cap


def checked_scale(
    task: Task, heaviest: float, cap: int, over: int, *, bounded: bool = False
) -> tuple[int, int]:
    """Return the result of :func:`exponent_and_threshold` for a task; ``bounded``: potentials never pass the threshold.

    Refuses a threshold mantissa below 1, with which a weight would be larger than the largest of the grid.
    """
    chip, grid, headroom = task.chip, task.grid, 1 if bounded else HEADROOM
    exponent, threshold = exponent_and_threshold(heaviest, grid, chip, cap, over, headroom)
    if threshold < 1:
        thresholds_max = min(grid.high * 2.0 ** WEIGHT_EXPONENTS[-1], heaviest_weight(chip)) / (
            1 + loihi.in_units(over)
        )
        measured = f"one weight reaches {heaviest:.3g} thresholds against {thresholds_max:.0f}"
        raise task.no_scale(
            "largest weight", measured, "Train with smaller weights, or a higher threshold."
        )
    return exponent, threshold
