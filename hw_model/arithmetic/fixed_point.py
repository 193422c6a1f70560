"""The chip's integer arithmetic: every primitive once, its exact formula in the docstring, and the grids of weights.

All values are int64 arrays holding integers that fit the chip's registers; no float enters here.
Letters: ``x`` a register value, ``d`` an effective decay in 0..4096, ``m`` a weight mantissa, ``e`` an exponent.
"""

from collections.abc import Callable
from typing import Any, Literal, get_args

import numpy as np

from hw_model.errors import InputError, check_known
from hw_model.values import BoolArray, FloatArray, Frozen, IntArray

DECAY_BITS = 12
"""An effective decay is a fraction of 2^12 = 4096: 0 keeps everything, 4096 keeps nothing."""
DECAY_ONE = 1 << DECAY_BITS
WEIGHT_SHIFT = 6
"""Weights and thresholds reach the registers multiplied by 2^6 = 64."""


def decay(x: IntArray, d: IntArray | int) -> IntArray:
    """Return ``sign(x) * ((|x| * (4096 - d)) >> 12)``: what is left of ``x``, truncated toward zero."""
    return kept(x, DECAY_ONE - np.asarray(d, dtype=np.int64))


def kept(x: IntArray, keep: IntArray | int) -> IntArray:
    """Return ``x * keep / 4096``, truncated toward zero: a shift rounds down, so what is negative is raised first."""
    product = x * keep
    below_zero = product >> 63  # all bits of a negative number, else none
    below_zero &= DECAY_ONE - 1
    product += below_zero
    product >>= DECAY_BITS
    return product


def kept_by_parts(
    x: Any, keep: Any, before: Callable[[Any, int], Any], short: Callable[[Any], Any]
) -> Any:
    """Return the same of vectors: with x = 4096 a + b no product is wider than x, or than 24 bits.

    Shifts round down; 4095 more, all bits that stand before a negative a, makes that towards 0. ``before(a, n)`` gives
    the first n bits of a, and ``short(a)`` may tell a compiler that a is a short factor: see :func:`high_part_fits`.
    """
    high = x >> DECAY_BITS
    low = x & (DECAY_ONE - 1)
    factor = keep & (2 * DECAY_ONE - 1)
    below_zero = before(high, DECAY_BITS)
    return short(high) * factor + ((low * factor + below_zero) >> DECAY_BITS)


def high_part_fits(largest: int, bits: int) -> bool:
    """Tell whether the a of every x within -largest..largest is a factor of so many bits, its sign among them."""
    return largest < DECAY_ONE << bits - 1


def half_range(bits: int) -> int:
    """Return ``2^bits``: a register of ``bits`` bits plus sign holds ``-2^bits..2^bits - 1``."""
    return 1 << bits


def wrap(x: IntArray, bits: int) -> IntArray:
    """Return ``x`` in two's complement of ``bits`` bits plus sign: ``((x + 2^bits) mod 2^(bits + 1)) - 2^bits``."""
    half = half_range(bits)
    return ((x + half) & (2 * half - 1)) - half


def clip(x: IntArray, low: IntArray | int, high: IntArray | int) -> IntArray:
    """Return ``min(max(x, low), high)``."""
    return np.minimum(np.maximum(x, low), high)


def effective_weight(m: IntArray, e: IntArray | int) -> IntArray:
    """Return ``64 * floor(m * 2^e)``, weight by weight: a negative exponent loses low bits."""
    exponent = np.asarray(e, dtype=np.int64)
    left = np.maximum(exponent, 0)
    right = np.maximum(-exponent, 0)
    return ((np.asarray(m, dtype=np.int64) << left) >> right) << WEIGHT_SHIFT


SignMode = Literal["mixed", "excitatory", "inhibitory"]
SIGN_MODES: tuple[SignMode, ...] = get_args(SignMode)
WEIGHT_BITS = (1, 2, 3, 4, 5, 6, 8)
WEIGHT_EXPONENTS = range(-8, 8)


class WeightGrid(Frozen):
    """Mantissas ``low, low + step, ..., high`` that a synapse format can hold.

    A format of ``b`` bits keeps the ``b`` high bits of an 8-bit magnitude; in mixed mode one of them is the sign:

        sign mode     step         lowest               highest
        mixed         2^(9 - b)    -256                 256 - step
        excitatory    2^(8 - b)    0                    256 - step
        inhibitory    2^(8 - b)    -(256 - step)        0
    """

    weight_bits: int
    sign_mode: SignMode
    step: int
    low: int
    high: int

    def round(self, values: FloatArray) -> IntArray:
        """Round half to even onto the grid, then clip: the one place where weights are rounded."""
        steps = np.rint(np.asarray(values, dtype=np.float64) / self.step)
        mantissas: IntArray = np.clip(steps * self.step, self.low, self.high).astype(np.int64)
        return mantissas

    def off_grid(self, mantissas: IntArray) -> BoolArray:
        """Mark the mantissas that this format cannot hold."""
        outside = (mantissas < self.low) | (mantissas > self.high)
        marked: BoolArray = outside | (mantissas % self.step != 0)
        return marked


def weight_grid(weight_bits: int, sign_mode: SignMode) -> WeightGrid:
    """Return the grid of a format; a width or sign mode that no format has is an ``InputError``."""
    if weight_bits not in WEIGHT_BITS:
        fix = "Choose one of 1, 2, 3, 4, 5, 6, 8."
        raise InputError("weight bits", f"no synapse format has {weight_bits} bits", fix=fix)
    check_known("sign mode", f"{sign_mode!r} does not exist", str(sign_mode), SIGN_MODES)
    step = 1 << (9 - weight_bits if sign_mode == "mixed" else 8 - weight_bits)
    low = {"mixed": -256, "excitatory": 0, "inhibitory": step - 256}[sign_mode]
    high = 0 if sign_mode == "inhibitory" else 256 - step
    return WeightGrid(weight_bits, sign_mode, step, low, high)
