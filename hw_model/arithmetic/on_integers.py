"""The operations of :mod:`hw_model.arithmetic.loihi` on int64 arrays: with them, its step is the plain engine."""

import numpy as np

from hw_model.arithmetic.fixed_point import clip, half_range, kept, wrap
from hw_model.values import BoolArray, Frozen, IntArray

FEW = 512
"""Arrays of up to this many numbers are wrapped without looking whether any needs it, which would take longer.
Chosen by hand."""


class OnIntegers(Frozen):
    """Operations for registers of q and u with these numbers of bits, plus a sign."""

    charge_bits: int
    current_bits: int

    def wrap_charge(self, q: IntArray) -> IntArray:
        """Return q within its register."""
        return _wrapped(q, self.charge_bits)

    def wrap_current(self, u: IntArray) -> IntArray:
        """Return u, or u + bias, within the register of u."""
        return _wrapped(u, self.current_bits)

    def charged(self, q: IntArray) -> IntArray:
        """Return q itself: charges are collected in the unit of u."""
        return q

    def kept(self, x: IntArray, keep: IntArray) -> IntArray:
        """Return x keep / 4096, truncated toward zero."""
        return kept(x, keep)

    def clip(self, v: IntArray, low: IntArray | int, high: IntArray | int) -> IntArray:
        """Return v within low..high."""
        return clip(v, low, high)

    def select(
        self, condition: BoolArray, chosen: IntArray | int, otherwise: IntArray | int
    ) -> IntArray:
        """Return ``chosen`` where the condition holds, else ``otherwise``."""
        return np.where(condition, chosen, otherwise)


class WithoutWraps(OnIntegers):
    """The same for compartments that are proven never to wrap.

    Without wraps every operation is monotone, so a step of lower bounds gives lower bounds of a step.
    """

    def wrap_charge(self, q: IntArray) -> IntArray:
        """Return q itself."""
        return q

    def wrap_current(self, u: IntArray) -> IntArray:
        """Return u itself."""
        return u


def _wrapped(x: IntArray, bits: int) -> IntArray:
    """Return x wrapped to a register; x itself if no number needs it."""
    half = half_range(bits)
    if x.size > FEW and -half <= x.min() and x.max() < half:
        return x  # by far the most frequent case
    return wrap(x, bits)
