"""Decays on the chip's grid, and the gain that best compensates for their rounding.

A compartment that keeps the share a of its current and b of its voltage per step responds to a charge of 1 with
``h(m) = sum over i = 0..m of a^i b^(m-i)``, m steps after the charge arrived; if a = b, this is
``(m + 1) a^m``. Rounding a and b to the chip's decays changes this response. Weights are multiplied by a *gain*, which
brings the response of the chip as near to that of the float neuron as one factor can.
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
"""A kernel with a smaller factor is 0 from the first step on for all purposes; its square would underflow."""


class Decays(NamedTuple):
    """Effective decays of an alpha dendrite, and how near its response is to a kernel.

    The ``gain`` minimises the squared error. The ``error`` is what remains: the root of the summed squares of the
    difference, divided by the root of the summed squares of the kernel.
    """

    u: int
    v: int
    gain: float
    error: float


def one_decay(tau: float, where: str) -> Decays:
    """Return the decay nearest to exp(-1 / tau) for both registers.

    The chip responds to a spike with ``gain * k * b^(k-1)``, where b is the share that it keeps. The kernel is
    ``c * k * a^(k-1)``, where ``a = exp(-1 / tau)`` and ``c = e * a / tau``. With ``<x, y>`` for the sum over all k of
    the product of two responses, the best gain and its squared error are those of a projection:

        gain = <kernel, chip> / <chip, chip>
        error^2 = 1 - <kernel, chip>^2 / (<chip, chip> <kernel, kernel>)

    A kernel that has faded before the first step has gain 0 and no error.
    """
    a, c = alpha_recursion(tau)
    decay = round(decay_of_share(1.0 - a))
    if decay == 0:
        # 4096 / tau rounds to at least 1 up to this time constant.
        longest_tau = 2 * DECAYS.high - 1
        raise _never_fades(where, f"{tau:g} steps against at most {longest_tau}")
    b = share_kept(decay)
    if c < FADED:
        return Decays(decay, decay, gain=0.0, error=0.0)
    chip_chip = _energy(b * b)
    kernel_chip = c * _energy(a * b)
    kernel_kernel = c * c * _energy(a * a)
    square_error = 1.0 - kernel_chip * kernel_chip / (chip_chip * kernel_kernel)
    # Float rounding can leave the error of a perfect fit slightly negative.
    error = math.sqrt(max(0.0, square_error))
    return Decays(decay, decay, gain=kernel_chip / chip_chip, error=error)


FURTHEST_FROM_MEAN = 64
"""Largest distance of two decays from their mean, when pairs are tried for one kernel; chosen by hand."""


@lru_cache(maxsize=64)
def two_decays(tau: float, where: str) -> Decays:
    """Return the two decays whose response fits an alpha kernel best.

    The best pair is the one whose least-squares gain leaves the least error. The response depends mostly on the mean of
    the two decays, and lasts a little longer the further apart they are, so pairs are a finer grid than single decays.
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
    # As in one_decay: sums of products of the responses of kernel and chip, here for every pair.
    chip_chip = _overlap(keep_u, keep_v, keep_u, keep_v)
    kernel_chip = c * _overlap(keep, keep, keep_u, keep_v)
    kernel_kernel = _overlap(keep, keep, keep, keep)
    square_errors = 1.0 - kernel_chip**2 / (chip_chip * c * c * kernel_kernel)
    errors = np.sqrt(np.maximum(0.0, square_errors))
    # Nine decimals: float noise must not decide ties, which go to the first pair.
    best = int(np.argmin(np.round(errors, 9)))
    gain = float(kernel_chip[best] / chip_chip[best])
    return Decays(int(u[best]), int(v[best]), gain, float(errors[best]))


def _pairs_around(exact: float) -> tuple[IntArray, IntArray]:
    """Return pairs ``u <= v`` of decays whose mean is within 2 of the ``exact`` decay, which may be a fraction.

    The pairs are ordered by their distance ``v - u``, then by their sum.
    """
    distances = np.arange(2 * FURTHEST_FROM_MEAN + 1)
    # All sums within 4 of twice the exact decay; one more at the upper end makes up for floor().
    sums = math.floor(2 * exact) + np.arange(-4, 6)
    distance, total = (axis.ravel() for axis in np.meshgrid(distances, sums, indexing="ij"))
    # u and v are whole numbers only if sum and distance are both even or both odd.
    are_whole = (distance + total) % 2 == 0
    u = (total[are_whole] - distance[are_whole]) // 2
    v = (total[are_whole] + distance[are_whole]) // 2
    # A decay of 0 would never fade.
    exist = (u > DECAYS.low) & (v <= DECAYS.high)
    return u[exist], v[exist]


def nearest_decays(fractions: FloatArray, where: str) -> IntArray:
    """Return the effective decays (n,) nearest to the fractions lost per step.

    Raises ``TargetError`` if a fraction above 0 becomes a decay of 0, which would never fade.
    """
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

    Here a and b are the shares that the float neuron keeps of current and voltage, c and d those of the chip. The gain
    minimises the squared error over all m. If a compartment keeps all of its current or voltage, that sum is infinite:
    then the gain makes both responses settle at the same value, which is ``1 / (1 - the smaller share)`` without it. If
    a compartment keeps all of both, nothing is rounded, and the gain is 1.
    """
    fades = (np.maximum(a, b) < 1) & (np.maximum(c, d) < 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = _overlap(a, b, c, d) / _overlap(c, d, c, d)
        ratio_of_settled = (1 - np.minimum(c, d)) / (1 - np.minimum(a, b))
    settles = np.minimum(a, b) < 1
    return np.where(fades, gain, np.where(settles, ratio_of_settled, 1.0))


def own_charges(response: FloatArray, keep: FloatArray | float) -> FloatArray:
    """Return the charges (lags, n) that make a dendrite respond with ``response`` (lags, n).

    The dendrite is two first-order filters that keep the same share ``keep``, so the charges are the response filtered
    by their inverse, ``(1 - keep z^-1)^2``.
    """
    two_lags_of_rest = np.zeros_like(response, shape=(2, response.shape[1]))
    shifted = np.concatenate((two_lags_of_rest, response))
    one_before = shifted[1:-1]
    two_before = shifted[:-2]
    return response - 2 * keep * one_before + keep**2 * two_before


def kernel(tau: float, k: FloatArray) -> FloatArray:
    """Return the alpha kernel ``(k / tau) * exp(1 - k / tau)``, whose peak is 1 at k = tau."""
    return k / tau * np.exp(1.0 - k / tau)


def _overlap(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Return the sum over all m of ``h(m)`` of a and b times ``h(m)`` of c and d, in closed form."""
    return (1 - a * b * c * d) / ((1 - a * c) * (1 - a * d) * (1 - b * c) * (1 - b * d))


def _energy(r: float) -> float:
    """Return the sum over k = 1, 2, ... of ``k^2 r^(k-1)``, which is ``(1 + r) / (1 - r)^3``.

    With ``r = a b``, this is the sum of the products of ``k a^(k-1)`` and ``k b^(k-1)``.
    """
    return (1.0 + r) / (1.0 - r) ** 3


def _never_fades(where: str, measured: str) -> TargetError:
    what = "the decay rounds to 0, so the potential would never decay"
    return TargetError(
        where, what, measured=measured, fix="Use a shorter time constant or a longer step."
    )
