"""What the passes of all neuron models need to put one population into integers.

A :class:`Task` is the question: a float population, the weights onto it, the chip, and how carefully to round. A
:class:`Scaled` is the answer: neurons in integers, and the scale of their potential. :func:`exponent_and_threshold`
chooses this scale, by the weight exponent and the threshold mantissa.
"""

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
    """The steps beyond rounding every weight to the nearest value of one format.

    - ``fitted_decays``: each alpha dendrite gets two decays, whose response fits the kernel best
    - ``graded``: weights of a population are in up to :data:`~locsnn_compile.passes.rounding.grades.GRADES` formats,
      each weight in the finest format that holds it
    - ``error_aware``: the weights of a neuron are rounded together, so that its potential has the least error; needs
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
"""None of the further steps."""
FINE = Rounding(fitted_decays=True, graded=True, error_aware=True, scaled_apart=True)
"""All further steps except splitting, as ``locsnn-compile`` rounds."""


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
        """Return the error for neurons for which no threshold mantissa, from 1 up, fits the chip.

        ``other`` names what does not fit next to the threshold.
        """
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
"""The charge register holds at least this many thresholds in a step; chosen by hand."""
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
    """Return the smallest exponent with which a format holds a weight and no mantissa loses bits.

    ``largest`` is in units. The finest useful exponent makes one step of the grid one unit: a charge is a whole number
    of units, so finer ones would cut off low bits of mantissas.
    """
    finest = 1 - grid.step.bit_length()
    return max(finest, math.ceil(math.log2(largest / grid.high))) if largest > 0 else finest


def exponent_and_threshold(
    heaviest: float, grid: WeightGrid, chip: Chip, cap: int, over: int, headroom: int
) -> tuple[int, int]:
    """Return the weight exponent and the threshold mantissa: first use all weight bits, then most of the register.

    ``heaviest`` is the largest weight in thresholds, ``cap`` a further limit of the mantissa. In the voltage register,
    the float threshold is ``over`` more than that of the mantissa: the chip spikes above its threshold, so 1 for
    neurons that spike at theirs, and otherwise 0. Voltage and current registers hold ``headroom`` thresholds; that of
    the charge holds :data:`CHARGE_ROOM` thresholds when the others hold :data:`HEADROOM`. Narrow registers hold
    fewer, but at least one.

    A larger threshold means a larger scale, and so finer weights, until the heaviest weight exceeds its format or the
    threshold its limit. Each exponent e has the threshold at which the heaviest weight has the largest mantissa. The
    largest e whose threshold is within the limit is chosen: it uses all bits of a weight, and most of the register.
    """
    registers = chip.registers
    # The largest threshold, in units of the register, of which each register holds enough.
    largest_thresholds = (
        registers.voltage_max / headroom,
        registers.half_current / headroom,
        registers.half_charge * HEADROOM / CHARGE_ROOM / headroom,
    )
    cap = min(cap, max(1, int(loihi.in_units(min(largest_thresholds)))))
    heaviest_of_chip = heaviest_weight(chip)
    # By exponent from 0: the threshold mantissa at which the heaviest weight is the largest of the format.
    threshold_of = []
    for e in range(WEIGHT_EXPONENTS[-1] + 1):
        if heaviest:
            heaviest_of_format = min(grid.high * 2**e, heaviest_of_chip)
            threshold_of.append(heaviest_of_format / heaviest - loihi.in_units(over))
        else:
            threshold_of.append(math.inf)
    within_limit = [e for e, threshold in enumerate(threshold_of) if threshold <= cap]
    if within_limit:
        exponent = within_limit[-1]
        # Some weights are more thresholds than a mantissa holds: they need a larger exponent for a threshold of 1.
        exponent = next(
            (e for e in range(exponent, len(threshold_of)) if threshold_of[e] * WHOLE >= 1),
            exponent,
        )
        return exponent, min(int(threshold_of[exponent] * WHOLE), cap)
    # Even with exponent 0, the heaviest weight would allow a threshold above the limit: take the limit, and the
    # smallest exponent that holds the weight, which is below 0 for weights of fewer than 8 bits.
    return min(0, exponent_holding(heaviest * (cap + loihi.in_units(over)), grid)), cap


def checked_scale(
    task: Task, heaviest: float, cap: int, over: int, *, bounded: bool = False
) -> tuple[int, int]:
    """Return the result of :func:`exponent_and_threshold` for a task.

    If potentials are ``bounded`` by the threshold, registers need no headroom above it. Raises ``TargetError`` for a
    threshold mantissa below 1: even then, the heaviest weight would be larger than the largest of the grid.
    """
    chip = task.chip
    grid = task.grid
    headroom = 1 if bounded else HEADROOM
    exponent, threshold = exponent_and_threshold(heaviest, grid, chip, cap, over, headroom)
    if threshold < 1:
        largest_of_grid = min(grid.high * 2.0 ** WEIGHT_EXPONENTS[-1], heaviest_weight(chip))
        thresholds_max = largest_of_grid / (1 + loihi.in_units(over))
        measured = f"one weight reaches {heaviest:.3g} thresholds against {thresholds_max:.0f}"
        raise task.no_scale(
            "largest weight", measured, "Train with smaller weights, or a higher threshold."
        )
    return exponent, threshold
