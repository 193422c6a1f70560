"""Choose integers for leaky integrate-and-fire neurons from which a spike takes its drop.

The chip's own reset would forget what is left above the threshold, so a soma without memory stands beside a dendrite
that is never reset, and own spikes reach the dendrite through two self-synapses: the drop, and a step later what the
current's decay left of it, which takes the drop out of the current again.
"""

from __future__ import annotations

import numpy as np

from hw_model.arithmetic.fixed_point import WEIGHT_EXPONENTS, IntArray, WeightGrid
from locsnn_compile.network.chip_neurons import ChipSrm, Refractory
from locsnn_compile.network.neurons import SoftCuba
from locsnn_compile.passes.kernels import keeps, rounded_decays
from locsnn_compile.passes.rounding.task import (
    Scaled,
    Task,
    check_threshold,
    exponent_and_threshold,
    exponent_holding,
    largest_charge,
    own_grid,
)


def quantize_soft(neuron: SoftCuba, task: Task) -> Scaled:
    """Return the neurons in integers, one threshold mantissa for all."""
    chip, grid, where = task.chip, task.grid, task.where
    decay_u, decay_v, gain = rounded_decays(neuron, where)
    heaviest = float((task.largest * gain / neuron.threshold).max())
    deepest = float((neuron.drop / neuron.threshold).max())
    own, coarse = own_grid(chip), _coarse(own_grid(chip))
    # The largest charge that a coarse and a fine self-synapse hold exactly, in units of the threshold mantissa.
    held = (own.high // own.step << coarse) + (1 << coarse) - 1
    cap = int(min(held, largest_charge(chip)) / max(deepest, 1.0))
    exponent, threshold = exponent_and_threshold(heaviest, grid, chip, cap, 0)
    check_threshold(threshold, heaviest, grid, chip, 0, where)
    drop = np.rint(threshold * neuron.drop / neuron.threshold).astype(np.int64)
    made = ChipSrm(decay_u, decay_v, np.full(len(drop), threshold), _taps(drop, decay_u, own))
    return Scaled(made, 64 * threshold / neuron.threshold, gain, exponent)


def _taps(drop: IntArray, decay_u: IntArray, grid: WeightGrid) -> Refractory:
    """Return the self-synapses: coarse and fine, at once and a step later; those of no neuron are left out."""
    back = np.rint(drop * keeps(decay_u)).astype(np.int64)
    rows = [
        (delay, sign * part, exponent)
        for delay, sign, charge in ((0, -1, drop), (1, 1, back))
        for part, exponent in _parts(charge, grid)
        if part.any()
    ]
    delay, mantissa, exponent = zip(*rows, strict=True) if rows else ((), np.zeros((0, len(drop))), ())
    return Refractory(
        np.array(delay, dtype=np.int64), np.array(mantissa, dtype=np.int64), np.array(exponent, dtype=np.int64)
    )


def _coarse(grid: WeightGrid) -> int:
    """Return by how much the coarse exponent is above the finest: by all bits of a weight, if exponents go so far."""
    return min(grid.weight_bits, WEIGHT_EXPONENTS[-1] - exponent_holding(0.0, grid))


def _parts(charge: IntArray, grid: WeightGrid) -> tuple[tuple[IntArray, int], tuple[IntArray, int]]:
    """Return mantissas of a coarse exponent and of the finest; they add up to charges in units of the threshold."""
    finest, shift = exponent_holding(0.0, grid), _coarse(grid)
    coarse = np.where(charge > grid.high // grid.step, charge >> shift, 0)
    return (coarse * grid.step, finest + shift), ((charge - (coarse << shift)) * grid.step, finest)
