"""The step of :mod:`hw_model.arithmetic.loihi` on int64 arrays, in the units of the registers."""

import numpy as np

from hw_model.arithmetic.fixed_point import clip, half_range, kept, wrap
from hw_model.values import BoolArray, Frozen, IntArray

FEW = 512
"""Numbers that are wrapped in less time than it takes to look whether any has to be."""


class OnIntegers(Frozen):
    """Registers of q and of u have so many bits, and a sign."""

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
        """Return what is left of x."""
        return kept(x, keep)

    def clip(self, v: IntArray, low: IntArray | int, high: IntArray | int) -> IntArray:
        """Return v within low..high."""
        return clip(v, low, high)

    def select(
        self, condition: BoolArray, chosen: IntArray | int, otherwise: IntArray | int
    ) -> IntArray:
        """Return one where the condition holds, and the other where not."""
        return np.where(condition, chosen, otherwise)


class WithoutWraps(OnIntegers):
    """The same where nothing wraps, as a proof knows: every operation then grows with what it is given."""

    def wrap_charge(self, q: IntArray) -> IntArray:
        """Return q itself."""
        return q

    def wrap_current(self, u: IntArray) -> IntArray:
        """Return u itself."""
        return u


def _wrapped(x: IntArray, bits: int) -> IntArray:
    half = half_range(bits)
    if x.size > FEW and -half <= x.min() and x.max() < half:
        return x  # nearly always
    return wrap(x, bits)
