"""Closed-form bounds of the registers of :mod:`hw_model.arithmetic.loihi`, for proofs that they cannot overflow.

:mod:`hw_model.range_proof` and the layout of the fast engine use them. Both u and v follow
``x = kept(x, decay) + drive`` from x = 0, with ``kept(x, decay)`` = x times
(4096 - decay) / 4096, truncated toward zero. Spikes and refractory steps only bring v back to 0.

Functions bound x from above. To bound x from below, bound -x with the drive negated: truncation
toward zero treats both signs alike.
"""

from functools import lru_cache

import numpy as np

from hw_model.arithmetic.fixed_point import DECAY_ONE
from hw_model.arithmetic.loihi import KEEPS_ALL, Value, keep_of
from hw_model.arithmetic.loihi_inverse import settled_gain, share_kept
from hw_model.values import BoolArray, FloatArray, IntArray


def has_fraction(x: IntArray, decay: Value) -> BoolArray:
    """Return where truncation matters: where x * keep / 4096 is not a whole number."""
    return np.asarray(np.abs(x) * keep_of(decay) % DECAY_ONE != 0)


def current_stays_below(limit: int, charge: FloatArray, decay: Value) -> BoolArray:
    """Return where u stays within -limit..limit if the charge of every step is within -charge..charge.

    In real numbers u tends to charge * 4096 / decay; truncation toward zero only lowers it.
    """
    # Not divided by the decay, which may be 0.
    return np.asarray(charge * DECAY_ONE < decay * float(limit))


def settles_at(drive: FloatArray, decays: IntArray) -> FloatArray:
    """Return the highest value of x = kept(x, decay) + d, from x = 0, if d <= drive in every step.

    ``drive`` holds whole numbers. A step takes ceil(x * decay / 4096) from x >= 0, so x grows until
    that is the drive or more. For whole numbers ceil(y) >= drive means y > drive - 1, so it settles
    at the smallest whole x above (drive - 1) * 4096 / decay. Without decay it grows for ever.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        settled = np.floor((drive - 1) * DECAY_ONE / decays) + 1
    highest_if_driven = np.where(decays == 0, np.inf, settled)
    return np.where(drive <= 0, 0.0, highest_if_driven)


def settles_untruncated(drive: FloatArray, decays: IntArray) -> FloatArray:
    """Return the value, without truncation, at which x settles under a steady drive: drive * 4096 / decay.

    Truncation may remove less from a sum than from its terms. So where answers to several drives
    are added up to a bound, each must be computed without truncation.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        # A drive of 0 settles at 0 without decay too, where the product is 0 * inf.
        settled: FloatArray = np.where(drive == 0, 0.0, drive * settled_gain(decays))
    return settled


@lru_cache(maxsize=4096)
def largest_answers(decay_u: int, decay_v: int, period: int) -> tuple[float, float]:
    """Return the largest u and v, without truncation, if a charge of 1 arrives every ``period`` steps.

    Let a and b be the shares that u and v keep in a step, and p the period. m steps after a single
    charge of 1, u is a^m, and v is h(m) = sum over i = 0..m of a^i b^(m-i), which is

        (a^(m+1) - b^(m+1)) / (a - b), or (m+1) a^m where a = b.

    With all earlier charges, v is the sum over k >= 0 of h(m + k p), a geometric series:

        (a^(m+1) / (1 - a^p) - b^(m+1) / (1 - b^p)) / (a - b), or
        a^m ((m+1) / (1 - a^p) + p a^p / (1 - a^p)^2) where a = b.

    The charges repeat after p steps, so the largest v is at one of m = 0..p-1. u is largest just
    after a charge: 1 / (1 - a^p).
    """
    # A register that keeps everything grows with every charge.
    if decay_u == KEEPS_ALL:
        return np.inf, np.inf
    a = share_kept(decay_u)
    b = share_kept(decay_v)
    of_u = 1.0 / (1.0 - a**period)
    if decay_v == KEEPS_ALL:
        return of_u, np.inf
    m = np.arange(period, dtype=np.float64)
    if a == b:
        of_v = a**m * ((m + 1) * of_u + period * a**period * of_u**2)
    else:
        of_v = (a ** (m + 1) * of_u - b ** (m + 1) / (1.0 - b**period)) / (a - b)
    return of_u, float(of_v.max())
