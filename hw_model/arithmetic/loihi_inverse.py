"""Convert numbers of a trained network to settings of :mod:`hw_model.arithmetic.loihi`, for the compiler.

A trained neuron loses a share 0..1 of u and of v in each step; a decay is this share in 4096ths. A *unit* is the
smallest charge of a synapse that is not 0: 64 counts of a register. Docstrings say where truncation is ignored.
"""

from typing import TYPE_CHECKING

import numpy as np

from hw_model.arithmetic.fixed_point import DECAY_ONE, WEIGHT_SHIFT
from hw_model.arithmetic.loihi import Value, keep_of, threshold_of, voltage_minima
from hw_model.values import FloatArray, IntArray

if TYPE_CHECKING:
    from hw_model.description.chip import Registers


def decay_of(keep: Value) -> Value:
    """Return the decay that keeps ``keep`` 4096ths."""
    return DECAY_ONE - keep


def decay_of_share(lost: Value) -> Value:
    """Return the decay, not rounded, that loses a share in each step."""
    return lost * DECAY_ONE


def nearest_decay(lost: FloatArray) -> IntArray:
    """Return the decays nearest to the shares lost per step, ties to even: 4096 for a share of 1."""
    decays: IntArray = np.rint(decay_of_share(lost)).astype(np.int64)
    return decays


def share_lost(decay: Value) -> Value:
    """Return the share that a decay loses per step, ignoring truncation."""
    return decay / DECAY_ONE


def share_kept(decay: Value) -> Value:
    """Return the share that a decay keeps per step, ignoring truncation."""
    return keep_of(decay) / DECAY_ONE


def settled_gain(decay: Value) -> Value:
    """Return where a register settles under an input of 1 per step, ignoring truncation: each step then loses 1."""
    return DECAY_ONE / decay


def largest_bias(registers: "Registers") -> int:
    """Return the largest bias, in counts of a register, whose negative can be stored as well."""
    return registers.bias_mantissa_max << registers.bias_exponent_max


def deepest_minimum(depth: float, registers: "Registers") -> int:
    """Return the lowest vmin of a core that is not below ``-depth``, in counts of v.

    There always is one, as vmin can be 0.
    """
    return min(vmin for vmin in voltage_minima(registers) if vmin >= -depth)


def least_to_spike(mantissa: Value) -> Value:
    """Return the lowest v that spikes at a threshold."""
    return threshold_of(mantissa) + 1


def bits_of_unit(exponent: int) -> int:
    """Return n such that 2^exponent units are 2^n counts of a register."""
    return WEIGHT_SHIFT + exponent


def exponent_of_bits(bits: int) -> int:
    """Return n such that 2^bits counts of a register are 2^n units."""
    return bits - WEIGHT_SHIFT
