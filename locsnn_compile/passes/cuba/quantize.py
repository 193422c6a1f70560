"""Choose integers for leaky integrate-and-fire neurons: one threshold for all, a scale for each."""

from __future__ import annotations

import math

import numpy as np

from hw_model.arithmetic.fixed_point import IntArray
from hw_model.arithmetic.weights import WeightGrid
from hw_model.description.chip import Chip
from locsnn_compile.errors import TargetError
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.neurons import Cuba, FloatArray
from locsnn_compile.passes.kernels import best_gain, keeps, nearest_decays
from locsnn_compile.passes.rounding.scaling import HEADROOM, Scaled, check_threshold, exponent_and_threshold


def quantize_cuba(
    neuron: Cuba,
    largest: FloatArray,
    grid: WeightGrid,
    chip: Chip,
    where: str,
    room: float = math.inf,
    *,
    bounded: bool = False,
) -> Scaled:
    """Return the neurons in integers, given the largest weight (n,) onto each.

    All get the threshold mantissa T and the scale ``64 T / threshold``, or ``(64 T + 1) / threshold`` for the rule
    ``>=``: the comparison is then exact for every neuron, and a core needs one threshold profile for all. T is at most
    ``room``, unless the weights would lose bits by it. Potentials that are ``bounded`` by the threshold need no more
    than one threshold of the voltage register, and T is at most ``room`` whatever it costs in bits.
    """
    size = len(neuron.threshold)
    decay_u = nearest_decays(neuron.decay_u, f"{where}: decay_u")
    decay_v = nearest_decays(neuron.decay_v, f"{where}: decay_v")
    gain = best_gain(1 - neuron.decay_u, 1 - neuron.decay_v, keeps(decay_u), keeps(decay_v))
    # A bias acts on the voltage alone; what it settles at is kept.
    bias = neuron.bias * np.divide(decay_v / 4096, neuron.decay_v, out=np.ones(size), where=neuron.decay_v > 0)
    over = 1 if neuron.rule == ">=" else 0
    heaviest = float((largest * gain / neuron.threshold).max())
    strongest = float((np.abs(bias) / neuron.threshold).max())
    bias_max = ((1 << chip.registers.bias_mantissa_bits) - 1) << chip.registers.bias_exponent_max
    lossless = 0.0 if bounded else grid.high / max(heaviest, 1e-9)
    mantissa_max = int(min(chip.registers.threshold_mantissa_max, max(room, lossless)))
    _check_bias(strongest, bias_max / 128, where)
    cap = int(min(bias_max / strongest / 64 - 1, mantissa_max)) if strongest else mantissa_max
    exponent, threshold = exponent_and_threshold(heaviest, grid, chip, cap, over, 1 if bounded else HEADROOM)
    check_threshold(threshold, heaviest, grid, chip, over, where)
    scale = (64 * threshold + over) / neuron.threshold
    bias_mantissa, bias_exponent = _bias(bias * scale, chip)
    made = ChipCuba.of(
        size,
        decay_u=decay_u,
        decay_v=decay_v,
        threshold=threshold,
        bias_mantissa=bias_mantissa,
        bias_exponent=bias_exponent,
        refractory=neuron.refractory,
    )
    return Scaled(made, scale, gain, exponent)


def _check_bias(strongest: float, limit: float, where: str) -> None:
    """Refuse biases, the largest given in thresholds, beside which no threshold mantissa of 1 or more is left."""
    if strongest > limit:
        raise TargetError(
            where,
            "no scale holds both the threshold and the largest bias",
            measured=f"one bias reaches {strongest:.6g} thresholds against {limit:.0f}",
            fix="Train with smaller biases, or a higher threshold.",
        )


def _bias(values: FloatArray, chip: Chip) -> tuple[IntArray, IntArray]:
    """Round to mantissas (n,) times powers of two, the smallest that hold them."""
    most = (1 << chip.registers.bias_mantissa_bits) - 1
    exponent = np.zeros(len(values), dtype=np.int64)
    for i, value in enumerate(np.abs(values)):
        exponent[i] = max(0, math.ceil(math.log2(value / most))) if value > most else 0
    mantissa = np.clip(np.rint(values / 2.0**exponent), -most, most).astype(np.int64)
    return mantissa, exponent
