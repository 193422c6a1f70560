"""Choose integers for leaky integrate-and-fire neurons from which a spike takes its drop.

The chip's own reset would forget what is left above the threshold, so a soma without memory stands beside a dendrite
that is never reset, and own spikes reach the dendrite through two self-synapses: the drop, and a step later what the
current's decay left of it, which takes the drop out of the current again.
"""

from __future__ import annotations

import numpy as np

from hw_model.arithmetic.fixed_point import IntArray
from hw_model.arithmetic.weights import WeightGrid
from hw_model.description.chip import Chip
from locsnn_compile.network.chip_neurons import ChipSrm, RefractoryTaps
from locsnn_compile.network.neurons import FloatArray, SoftCuba
from locsnn_compile.passes.kernels import best_gain, keeps, nearest_decays
from locsnn_compile.passes.rounding.scaling import Scaled, check_threshold, exponent_and_threshold

COARSE = 7
"""Exponent of the self-synapses that hold what one of exponent 0 does not."""
DROP_MAX = (255 << COARSE) + (1 << COARSE) - 1
"""The largest charge that two self-synapses hold exactly, in units of the threshold mantissa."""


def quantize_soft(neuron: SoftCuba, largest: FloatArray, grid: WeightGrid, chip: Chip, where: str) -> Scaled:
    """Return the neurons in integers, given the largest weight (n,) onto each; one threshold mantissa for all."""
    decay_u = nearest_decays(neuron.decay_u, f"{where}: decay_u")
    decay_v = nearest_decays(neuron.decay_v, f"{where}: decay_v")
    gain = best_gain(1 - neuron.decay_u, 1 - neuron.decay_v, keeps(decay_u), keeps(decay_v))
    heaviest = float((largest * gain / neuron.threshold).max())
    deepest = float((neuron.drop / neuron.threshold).max())
    cap = int(DROP_MAX / max(deepest, 1.0))
    exponent, threshold = exponent_and_threshold(heaviest, grid, chip, cap, 0)
    check_threshold(threshold, heaviest, grid, 0, where)
    drop = np.rint(threshold * neuron.drop / neuron.threshold).astype(np.int64)
    made = ChipSrm(decay_u, decay_v, np.full(len(drop), threshold), _taps(drop, decay_u))
    return Scaled(made, 64 * threshold / neuron.threshold, gain, exponent)


def _taps(drop: IntArray, decay_u: IntArray) -> RefractoryTaps:
    """Return the self-synapses: coarse and fine, at once and a step later; those of no neuron are left out."""
    back = np.rint(drop * keeps(decay_u)).astype(np.int64)
    rows = [
        (delay, sign * part, exponent)
        for delay, sign, charge in ((0, -1, drop), (1, 1, back))
        for part, exponent in _parts(charge)
        if part.any()
    ]
    delay, mantissa, exponent = zip(*rows, strict=True) if rows else ((), np.zeros((0, len(drop))), ())
    return RefractoryTaps(
        np.array(delay, dtype=np.int64), np.array(mantissa, dtype=np.int64), np.array(exponent, dtype=np.int64)
    )


def _parts(charge: IntArray) -> tuple[tuple[IntArray, int], tuple[IntArray, int]]:
    """Return mantissas of the coarse exponent and of 0 that add up to charges in units of the threshold mantissa."""
    coarse = np.where(charge > 255, charge >> COARSE, 0)
    return (coarse, COARSE), (charge - (coarse << COARSE), 0)
