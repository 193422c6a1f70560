"""Decays on the chip's grid, and the gain that best compensates for their rounding.

A compartment that keeps a of its current and b of its voltage responds to a charge of 1 with
``h(m) = sum over i = 0..m of a^i b^(m-i)``, m steps after the charge arrived; if a = b, this is
``(m + 1) a^m``.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic.loihi import DECAYS
from hw_model.arithmetic.loihi_inverse import decay_of_share, nearest_decay, share_kept, share_lost
from hw_model.values import FloatArray, IntArray
from locsnn_compile.errors import TargetError
from locsnn_compile.network.neurons import Leaky, alpha_recursion

FADED = 1e-100
"""A kernel whose first value is smaller has faded before the first step; its squares would underflow."""


class Decays(NamedTuple):
    """Effective decays of an alpha dendrite, and how near its response is to a kernel.

    The ``gain`` minimises the squared error. The ``error`` is the root of the squared difference
    over the squared kernel, both summed over all k.
    """

    u: int
    v: int
    gain: float
    error: float


def one_decay(tau: float, where: str) -> Decays:
    """Return the decay nearest to exp(-1 / tau) for both registers.

    The chip responds to a spike with ``gain * k * b^(k-1)``, where b is the share that it keeps. The kernel is
    ``c * k * a^(k-1)``, where ``a = exp(-1 / tau)`` and ``c = e * a / tau``. A kernel that is over before the first
    step has gain 0 and no error.
    """
    a, c = alpha_recursion(tau)
    decay = round(decay_of_share(1.0 - a))
    if decay == 0:
        raise _never_fades(where, f"{tau:g} steps against at most {2 * DECAYS.high - 1}")
    b = share_kept(decay)
    if c < FADED:
        return Decays(decay, decay, 0.0, 0.0)
    own_energy = _energy(b * b)
    common_energy = c * _energy(a * b)
    kernel_energy = c * c * _energy(a * a)
    share_left = 1.0 - common_energy * common_energy / (own_energy * kernel_energy)
    return Decays(
        decay, decay, gain=common_energy / own_energy, error=math.sqrt(max(0.0, share_left))
    )


FURTHEST_FROM_MEAN = 64
"""Largest distance of two decays from their mean, when pairs are tried for one kernel."""


@lru_cache(maxsize=64)
def two_decays(tau: float, where: str) -> Decays:
    """Return the two decays whose response fits an alpha kernel best.

    The best pair is the one whose least-squares gain leaves the least error. A larger distance
    between the two makes the kernel last longer, so pairs are a finer grid than single decays.
    Ties go to the pair with the smaller distance, then to the smaller decays.
    """
    nearest = one_decay(tau, where)
    if nearest.gain == 0.0:
        return nearest
    a, c = alpha_recursion(tau)
    u, v = _pairs_around(decay_of_share(1.0 - a))
    keep_u = share_kept(u)
    keep_v = share_kept(v)
    keep = np.full(len(u), a)
    own_energy = _overlap(keep_u, keep_v, keep_u, keep_v)
    common_energy = c * _overlap(keep, keep, keep_u, keep_v)
    kernel_energy = _overlap(keep, keep, keep, keep)
    share_left = 1.0 - common_energy**2 / (own_energy * c * c * kernel_energy)
    errors = np.sqrt(np.maximum(0.0, share_left))
    best = int(np.argmin(np.round(errors, 9)))  # ties go to the first
    gain = float(common_energy[best] / own_energy[best])
    return Decays(int(u[best]), int(v[best]), gain, float(errors[best]))


def _pairs_around(exact: float) -> tuple[IntArray, IntArray]:
    """Return pairs ``u <= v`` of decays whose mean is within 2 of a decay, the nearest to each other first."""
    distances = np.arange(2 * FURTHEST_FROM_MEAN + 1)
    sums = math.floor(2 * exact) + np.arange(-4, 6)
    distance, total = (axis.ravel() for axis in np.meshgrid(distances, sums, indexing="ij"))
    are_whole = (distance + total) % 2 == 0
    u = (total[are_whole] - distance[are_whole]) // 2
    v = (total[are_whole] + distance[are_whole]) // 2
    exist = (u > DECAYS.low) & (v <= DECAYS.high)
    return u[exist], v[exist]


def nearest_decays(fractions: FloatArray, where: str) -> IntArray:
    """Return the effective decays (n,) nearest to the fractions lost per step; only a fraction of 0 may become 0."""
    decays = nearest_decay(fractions)
    too_small = fractions[(decays == 0) & (fractions > 0)]
    if len(too_small):
        measured = f"{too_small[0]:g} lost in a step against at least {share_lost(0.5):.3g}"
        raise _never_fades(where, measured)
    return decays


def rounded_decays(neuron: Leaky, where: str) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the nearest ``decay_u`` and ``decay_v``, and their best gain; each (n,)."""
    decay_u = nearest_decays(neuron.decay_u, f"{where}: decay_u")
    decay_v = nearest_decays(neuron.decay_v, f"{where}: decay_v")
    gain = best_gain(
        1 - neuron.decay_u, 1 - neuron.decay_v, share_kept(decay_u), share_kept(decay_v)
    )
    return decay_u, decay_v, gain


def best_gain(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Return, for each neuron (n,), the gain g with which ``g * h(m)`` of c and d is nearest to ``h(m)`` of a and b.

    It minimises the squared error over all m. A compartment that keeps all of its current or
    voltage never fades; for it, the final values are made equal.
    """
    fades = (np.maximum(a, b) < 1) & (np.maximum(c, d) < 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = _overlap(a, b, c, d) / _overlap(c, d, c, d)
        ratio_of_ends = (1 - np.minimum(c, d)) / (1 - np.minimum(a, b))
    has_end = np.minimum(a, b) < 1
    return np.where(fades, gain, np.where(has_end, ratio_of_ends, 1.0))


def own_charges(response: FloatArray, keep: FloatArray | float) -> FloatArray:
    """Return the charges to which a dendrite gives this response (lags, n): it is filtered by ``(1 - keep z^-1)^2``."""
    before_all = np.zeros_like(response, shape=(2, response.shape[1]))
    shifted = np.concatenate((before_all, response))
    one_before = shifted[1:-1]
    two_before = shifted[:-2]
    return response - 2 * keep * one_before + keep**2 * two_before


def kernel(tau: float, k: FloatArray) -> FloatArray:
    """Return ``(k / tau) * exp(1 - k / tau)``."""
    return k / tau * np.exp(1.0 - k / tau)


def _overlap(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Return the sum over all m of ``h(m)`` of a and b times ``h(m)`` of c and d."""
    return (1 - a * b * c * d) / ((1 - a * c) * (1 - a * d) * (1 - b * c) * (1 - b * d))


def _energy(r: float) -> float:
    """Return the sum over k = 1, 2, ... of k^2 r^(k-1), which is (1 + r) / (1 - r)^3."""
    return (1.0 + r) / (1.0 - r) ** 3


def _never_fades(where: str, measured: str) -> TargetError:
    what = "the decay rounds to 0, so the potential would never decay"
    return TargetError(
        where, what, measured=measured, fix="Use a shorter time constant or a longer step."
    )
