"""The integer primitives of Loihi-like chips, each with its exact formula, and the grids of weights.

:mod:`hw_model.arithmetic.loihi` writes the step of a compartment with them. All values are int64 arrays of integers
that fit the chip's registers; floats only enter :meth:`WeightGrid.round`.
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
    """Return ``x * keep / 4096``, truncated toward zero.

    A shift rounds down, so 4095 is added to negative products first.
    """
    product = x * keep  # an array of its own, changed in place below: these lines run in every step
    below_zero = product >> 63  # all 64 bits set if negative, else 0
    below_zero &= DECAY_ONE - 1
    product += below_zero
    product >>= DECAY_BITS
    return product


def kept_by_parts(
    x: Any, keep: Any, before: Callable[[Any, int], Any], short: Callable[[Any], Any]
) -> Any:
    """Return what :func:`kept` returns, for vectors of 32 bits, in which x * keep would not fit.

    With x = 4096 a + b and 0 <= b < 4096, x * keep / 4096 = a * keep + b * keep / 4096, where no
    product is wider than x or than 24 bits. The shift rounds down; adding 4095 for negative x makes
    it round toward 0. Those 4095 are the highest 12 bits of a: all ones if a is negative, else 0.

    ``before(a, n)`` returns the highest n bits of a as a number. ``short(a)`` returns a, and may
    tell a compiler that it is a factor of few bits: see :func:`high_part_fits`.
    """
    high = x >> DECAY_BITS
    low = x & (DECAY_ONE - 1)
    # Changes nothing, as keep is 0..4096: it shows a compiler that the factor is short.
    factor = keep & (2 * DECAY_ONE - 1)
    below_zero = before(high, DECAY_BITS)
    return short(high) * factor + ((low * factor + below_zero) >> DECAY_BITS)


def high_part_fits(largest: int, bits: int) -> bool:
    """Return whether a of :func:`kept_by_parts` fits ``bits`` bits with its sign, for all x in -largest..largest."""
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
    # numpy shifts by negative numbers are undefined: one of the two shifts is by 0.
    left = np.maximum(exponent, 0)
    right = np.maximum(-exponent, 0)
    return ((np.asarray(m, dtype=np.int64) << left) >> right) << WEIGHT_SHIFT


SignMode = Literal["mixed", "excitatory", "inhibitory"]
SIGN_MODES: tuple[SignMode, ...] = get_args(SignMode)
"""Signs of the weights of a synapse format: both, none below 0, or none above 0."""
WEIGHT_BITS = (1, 2, 3, 4, 5, 6, 8)
"""Widths of synapse formats. The chip has no format of 7 bits."""
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
        """Return which mantissas this format cannot hold."""
        outside = (mantissas < self.low) | (mantissas > self.high)
        marked: BoolArray = outside | (mantissas % self.step != 0)
        return marked


def weight_grid(weight_bits: int, sign_mode: SignMode) -> WeightGrid:
    """Return the grid of a format. Raises ``InputError`` for a width or a sign mode that no format has."""
    if weight_bits not in WEIGHT_BITS:
        fix = "Choose one of 1, 2, 3, 4, 5, 6, 8."
        raise InputError("weight bits", f"no synapse format has {weight_bits} bits", fix=fix)
    check_known("sign mode", f"{sign_mode!r} does not exist", str(sign_mode), SIGN_MODES)
    magnitude_bits = weight_bits - 1 if sign_mode == "mixed" else weight_bits
    step = 1 << (8 - magnitude_bits)
    low = {"mixed": -256, "excitatory": 0, "inhibitory": step - 256}[sign_mode]
    high = 0 if sign_mode == "inhibitory" else 256 - step
    return WeightGrid(weight_bits, sign_mode, step, low, high)
