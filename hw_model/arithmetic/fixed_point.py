"""The chip's integer arithmetic: every primitive once, its exact formula in the docstring.

All values are int64 arrays holding integers that fit the chip's registers; no float enters here.
Letters: ``x`` a register value, ``d`` an effective decay in 0..4096, ``m`` a weight mantissa, ``e`` an exponent.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]

DECAY_BITS = 12
"""An effective decay is a fraction of 2^12 = 4096: 0 keeps everything, 4096 keeps nothing."""
DECAY_ONE = 1 << DECAY_BITS
WEIGHT_SHIFT = 6
"""Weights and thresholds reach the registers multiplied by 2^6 = 64."""


def decay(x: IntArray, d: IntArray | int) -> IntArray:
    """Return ``sign(x) * ((|x| * (4096 - d)) >> 12)``: what is left of ``x``, truncated toward zero."""
    magnitude = (np.abs(x) * (DECAY_ONE - np.asarray(d, dtype=np.int64))) >> DECAY_BITS
    left: IntArray = np.sign(x) * magnitude
    return left


def wrap(x: IntArray, bits: int) -> IntArray:
    """Return ``x`` in two's complement of ``bits`` bits plus sign: ``((x + 2^bits) mod 2^(bits + 1)) - 2^bits``."""
    half = 1 << bits
    wrapped: IntArray = ((x + half) & (2 * half - 1)) - half
    return wrapped


def clip(x: IntArray, low: IntArray | int, high: IntArray | int) -> IntArray:
    """Return ``min(max(x, low), high)``."""
    clipped: IntArray = np.minimum(np.maximum(x, low), high)
    return clipped


def effective_weight(m: IntArray, e: IntArray | int) -> IntArray:
    """Return ``64 * floor(m * 2^e)``, weight by weight: a negative exponent loses low bits."""
    exponent = np.asarray(e, dtype=np.int64)
    left = np.maximum(exponent, 0)
    right = np.maximum(-exponent, 0)
    value: IntArray = ((np.asarray(m, dtype=np.int64) << left) >> right) << WEIGHT_SHIFT
    return value
