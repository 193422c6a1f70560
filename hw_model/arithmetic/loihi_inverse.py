"""From numbers of a trained network to settings of :mod:`hw_model.arithmetic.loihi`.

A trained neuron loses a share 0..1 of u and of v in each step; a decay says this share in 4096ths. A *unit* is the
least charge that a weight can be: 64 counts of a register. Functions say where they leave truncation out.
"""

from typing import TYPE_CHECKING

import numpy as np

from hw_model.arithmetic.fixed_point import DECAY_ONE, WEIGHT_SHIFT
from hw_model.arithmetic.loihi import Value, keep_of, threshold_of, voltage_minima
from hw_model.values import FloatArray, IntArray

if TYPE_CHECKING:
    from hw_model.description.chip import Registers


def decay_of(keep: Value) -> Value:
    """Return the decay that keeps so many of 4096 parts."""
    return DECAY_ONE - keep


def decay_of_share(lost: Value) -> Value:
    """Return which decay, if fractions could be held, loses a share in each step."""
    return lost * DECAY_ONE


def nearest_decay(lost: FloatArray) -> IntArray:
    """Return the decays nearest to the shares that a step loses, ties to even: 4096 for a share of 1."""
    decays: IntArray = np.rint(decay_of_share(lost)).astype(np.int64)
    return decays


def share_lost(decay: Value) -> Value:
    """Return the share that a decay takes in a step, if nothing is truncated."""
    return decay / DECAY_ONE


def share_kept(decay: Value) -> Value:
    """Return the share that a decay keeps in a step, if nothing is truncated."""
    return keep_of(decay) / DECAY_ONE


def settled_gain(decay: Value) -> Value:
    """Return what a steady input of 1 settles at, if nothing is truncated: each step loses what it gains."""
    return DECAY_ONE / decay


def largest_bias(registers: "Registers") -> int:
    """Return the largest bias, in counts of a register, whose negative can be held as well."""
    return registers.bias_mantissa_max << registers.bias_exponent_max


def deepest_minimum(depth: float, registers: "Registers") -> int:
    """Return the lowest vmin that a core can hold which is not below ``-depth`` (counts of v); 0 can always be."""
    return min(vmin for vmin in voltage_minima(registers) if vmin >= -depth)


def least_to_spike(mantissa: Value) -> Value:
    """Return the least v that exceeds a threshold."""
    return threshold_of(mantissa) + 1


def bits_of_unit(exponent: int) -> int:
    """Return the power of two of 2^exponent units in counts of a register."""
    return WEIGHT_SHIFT + exponent


def exponent_of_bits(bits: int) -> int:
    """Return the power of two of 2^bits counts of a register in units."""
    return bits - WEIGHT_SHIFT
