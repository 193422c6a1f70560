"""How far registers of :mod:`hw_model.arithmetic.loihi` can go: closed forms, for proofs.

They are stated upwards, and hold downwards with signs turned. Both u and v follow
``x = kept(x, decay) + drive`` from x = 0; spikes and refractory steps only bring v back to 0.
"""

from functools import lru_cache

import numpy as np

from hw_model.arithmetic.fixed_point import DECAY_ONE
from hw_model.arithmetic.loihi import KEEPS_ALL, Value, keep_of
from hw_model.arithmetic.loihi_inverse import gain_at_rest, share_kept
from hw_model.values import BoolArray, FloatArray, IntArray


def has_fraction(x: IntArray, decay: Value) -> BoolArray:
    """Tell where truncation takes something of what a decay leaves of x."""
    return np.asarray(np.abs(x) * keep_of(decay) % DECAY_ONE != 0)


def current_stays_below(limit: int, charge: FloatArray, decay: Value) -> BoolArray:
    """Tell whether u stays within -limit..limit while every charge of a step lies within -charge..charge."""
    return np.asarray(charge * DECAY_ONE < decay * float(limit))


def settles_at(drive: FloatArray, decays: IntArray) -> FloatArray:
    """Return the highest x = kept(x, decay) + d from x = 0, where d <= drive in every step.

    That is the smallest x that loses the drive in a step, ceil(x * decay / 4096) >= drive.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        settled = np.floor((drive - 1) * DECAY_ONE / decays) + 1
    return np.where(drive <= 0, 0.0, np.where(decays == 0, np.inf, settled))


def settles_untruncated(drive: FloatArray, decays: IntArray) -> FloatArray:
    """Return the answer of the filter in real numbers to a drive in every step: drive * 4096 / decay.

    Truncation may take less from a sum than from its parts, so answers that are added up must leave it out.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        settled: FloatArray = np.where(drive == 0, 0.0, drive * gain_at_rest(decays))
    return settled


@lru_cache(maxsize=4096)
def largest_answers(decay_u: int, decay_v: int, period: int) -> tuple[float, float]:
    """Return the largest answers of u and of v, in real numbers, to a charge of 1 every ``period`` steps.

    m steps after a charge, u holds a^m of it and v holds h(m) = sum over i = 0..m of a^i b^(m-i). What is left of all
    charges before is a geometric series.
    """
    if decay_u == KEEPS_ALL:
        return np.inf, np.inf
    a, b = share_kept(decay_u), share_kept(decay_v)
    of_u = 1.0 / (1.0 - a**period)
    if decay_v == KEEPS_ALL:
        return of_u, np.inf
    m = np.arange(period, dtype=np.float64)
    if a == b:
        of_v = a**m * ((m + 1) * of_u + period * a**period * of_u**2)
    else:
        of_v = (a ** (m + 1) * of_u - b ** (m + 1) / (1.0 - b**period)) / (a - b)
    return of_u, float(of_v.max())
