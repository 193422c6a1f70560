"""Decays on the chip's grid, the gain that best compensates for their rounding, and how well integers fit a kernel.

A compartment that keeps a of its current and b of its voltage responds to a charge of 1 with
``h(m) = sum over i = 0..m of a^i b^(m-i)``, m steps after the charge arrived; if a = b, this is ``(m + 1) a^m``.

To measure the fit, one input spike, and one own spike, are played to the integer neurons. The responses are compared
with the kernels of the float neuron.
"""

import math
from functools import lru_cache, singledispatch
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic.loihi import DECAYS
from hw_model.arithmetic.loihi_inverse import decay_of_share, nearest_decay, share_kept, share_lost
from hw_model.description.chip import Registers
from hw_model.values import FloatArray, IntArray
from locsnn_compile.errors import TargetError
from locsnn_compile.network.neurons import Cuba, Leaky, Neuron, SoftCuba, SrmAlpha, alpha_recursion
from locsnn_compile.network.quantized import KernelFit
from locsnn_compile.passes.rounding.task import Scaled
from locsnn_compile.reference.integer_neurons import input_response, own_spike_response

FADED = 1e-100
"""A kernel whose first value is smaller has faded before the first step; its squares would underflow."""


class Decays(NamedTuple):
    """Effective decays of an alpha dendrite, the gain with which its response is nearest to a kernel, and the error.

    The gain minimises the squared error. The error is the root of the squared difference over the squared kernel, both
    summed over all k.
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
    own, cross, kernel = _energy(b * b), c * _energy(a * b), c * c * _energy(a * a)
    gain = cross / own
    return Decays(decay, decay, gain, math.sqrt(max(0.0, 1.0 - cross * cross / (own * kernel))))


SPREAD = 64
"""Largest distance of two decays from their mean, when pairs are tried for one kernel."""


@lru_cache(maxsize=64)
def two_decays(tau: float, where: str) -> Decays:
    """Return the two decays whose response fits an alpha kernel best.

    The candidates are all effective decays ``decay_u <= decay_v`` at most :data:`SPREAD` from their mean, which is
    within 2 of the decay that would be exact. The best pair is the one whose least-squares gain leaves the least
    error. A larger distance between the two makes the kernel last longer, so pairs are a finer grid than single decays.
    Ties go to the pair with the smaller distance, then to the smaller decays.
    """
    nearest = one_decay(tau, where)
    if nearest.gain == 0.0:
        return nearest
    a, c = alpha_recursion(tau)
    exact = decay_of_share(1.0 - a)
    grid = np.meshgrid(
        np.arange(2 * SPREAD + 1), math.floor(2 * exact) + np.arange(-4, 6), indexing="ij"
    )
    apart, total = (axis.ravel() for axis in grid)
    here = (apart + total) % 2 == 0
    u, v = (total[here] - apart[here]) // 2, (total[here] + apart[here]) // 2
    held = (u >= 1) & (v <= DECAYS.high)
    u, v = u[held], v[held]
    keep_u = share_kept(u)
    keep_v = share_kept(v)
    keep = np.full(len(u), a)
    own, cross = _overlap(keep_u, keep_v, keep_u, keep_v), c * _overlap(keep, keep, keep_u, keep_v)
    errors = np.sqrt(
        np.maximum(0.0, 1.0 - cross**2 / (own * c * c * _overlap(keep, keep, keep, keep)))
    )
    best = int(np.argmin(np.round(errors, 9)))
    return Decays(int(u[best]), int(v[best]), float(cross[best] / own[best]), float(errors[best]))


def nearest_decays(fractions: FloatArray, where: str) -> IntArray:
    """Return the effective decays (n,) nearest to the fractions lost per step; only a fraction of 0 may become 0."""
    decays = nearest_decay(fractions)
    lost = fractions[(decays == 0) & (fractions > 0)]
    if len(lost):
        raise _never_fades(
            where, f"{lost[0]:g} lost in a step against at least {share_lost(0.5):.3g}"
        )
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

    It minimises the squared error over all m, using
    ``sum over m of h_ab h_cd = (1 - abcd) / ((1-ac)(1-ad)(1-bc)(1-bd))``. A compartment that keeps all of its current
    or voltage never fades; for it, the final values are made equal.
    """
    fades = (np.maximum(a, b) < 1) & (np.maximum(c, d) < 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = _overlap(a, b, c, d) / _overlap(c, d, c, d)
        end = (1 - np.minimum(c, d)) / (1 - np.minimum(a, b))
    return np.where(fades, gain, np.where(np.minimum(a, b) < 1, end, 1.0))


def own_charges(response: FloatArray, keep: FloatArray | float) -> FloatArray:
    """Return the charges to which a dendrite gives this response (lags, n): it is filtered by ``(1 - keep z^-1)^2``."""
    before = np.concatenate((np.zeros_like(response, shape=(2, response.shape[1])), response))
    return response - 2 * keep * before[1:-1] + keep**2 * before[:-2]


def kernel(tau: float, k: FloatArray) -> FloatArray:
    """Return ``(k / tau) * exp(1 - k / tau)``."""
    return k / tau * np.exp(1.0 - k / tau)


def _overlap(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    return (1 - a * b * c * d) / ((1 - a * c) * (1 - a * d) * (1 - b * c) * (1 - b * d))


def _energy(r: float) -> float:
    """Return the sum over k = 1, 2, ... of k^2 r^(k-1), which is (1 + r) / (1 - r)^3."""
    return (1.0 + r) / (1.0 - r) ** 3


def _never_fades(where: str, measured: str) -> TargetError:
    what = "the decay rounds to 0, so the potential would never decay"
    return TargetError(
        where, what, measured=measured, fix="Use a shorter time constant or a longer step."
    )


LENGTHS = 12
"""Time constants over which responses are compared: later values are below 2e-4 of a kernel's largest value."""
STEPS_MAX = 4096
FAINT = 0.5
"""A kernel whose largest value is below half a unit of the registers does not exist for them."""


@singledispatch
def kernel_fit(neuron: Neuron, scaled: Scaled, registers: Registers) -> KernelFit | None:
    """Return the fit of the worst neuron; None for a model that has not registered a measure."""
    return None


@kernel_fit.register
def _(neuron: Cuba, scaled: Scaled, registers: Registers) -> KernelFit:
    return KernelFit(*_leaky_input(neuron, scaled, registers), None, None)


@kernel_fit.register
def _(neuron: SoftCuba, scaled: Scaled, registers: Registers) -> KernelFit:
    return KernelFit(
        *_leaky_input(neuron, scaled, registers), *_soft_drop(neuron, scaled, registers)
    )


@kernel_fit.register
def _(neuron: SrmAlpha, scaled: Scaled, registers: Registers) -> KernelFit:
    theta = neuron.theta * scaled.scale
    k = np.arange(1, _steps(neuron.tau_sr) + 1, dtype=np.float64)[:, None]
    # A weight of theta, whose response peaks at the threshold: eps has its largest value, 1, at tau_sr.
    found = input_response(scaled.neuron, _whole(scaled.gain * theta), registers, len(k))
    input_errors = _errors(found, theta * kernel(neuron.tau_sr, k), theta)
    if neuron.scale_ref == 0 and scaled.neuron.strategy != "native":
        return KernelFit(*input_errors, None, None)
    # Taps and resets change the filters of the input, whose memory outlasts nu.
    k = np.arange(1, _steps(max(neuron.tau_sr, neuron.tau_ref)) + 1, dtype=np.float64)[:, None]
    wanted = -neuron.scale_ref * theta * kernel(neuron.tau_ref, k)
    taken = own_spike_response(scaled.neuron, registers, len(k))
    return KernelFit(*input_errors, *_errors(taken, wanted, theta))


def _soft_drop(neuron: SoftCuba, scaled: Scaled, registers: Registers) -> tuple[float, float]:
    """Return the errors of the drop that a spike causes in the potential of neurons at rest."""
    lags = np.arange(_steps_of(1 - neuron.decay_v))[:, None]
    wanted = -neuron.drop * scaled.scale * (1 - neuron.decay_v) ** lags
    return _errors(
        own_spike_response(scaled.neuron, registers, len(lags)),
        wanted,
        neuron.threshold * scaled.scale,
    )


def _leaky_input(neuron: Leaky, scaled: Scaled, registers: Registers) -> tuple[float, float]:
    """Return the errors of the response to one input spike that brings each neuron to its threshold.

    Where that takes more charge than a step can hold, as it may for outputs that never spike, it is the largest charge.
    """
    steps = _steps_of(np.maximum(1 - neuron.decay_u, 1 - neuron.decay_v))
    current, response = np.ones(len(neuron.threshold)), np.zeros((steps, len(neuron.threshold)))
    for step in range(steps):
        response[step] = (1 - neuron.decay_v) * response[step - 1] + current
        current = (1 - neuron.decay_u) * current
    theta = neuron.threshold * scaled.scale
    most = (registers.half_charge - 1) / scaled.gain
    weight = np.minimum(theta / response.max(axis=0), most)
    found = input_response(scaled.neuron, _whole(scaled.gain * weight), registers, steps)
    return _errors(found, weight * response, theta)


def _steps_of(kept: FloatArray) -> int:
    """Return the steps for neurons of which a step keeps these shares."""
    slowest = float(kept.max())
    return _steps(-1.0 / math.log(slowest) if 0 < slowest < 1 else slowest * STEPS_MAX)


def _steps(tau: float) -> int:
    return min(math.ceil(LENGTHS * tau) + LENGTHS, STEPS_MAX)


def _whole(charge: FloatArray) -> IntArray:
    return np.rint(charge).astype(np.int64)


def _errors(found: IntArray, wanted: FloatArray, theta: FloatArray) -> tuple[float, float]:
    """Return the largest relative error and the relative root mean square; without a kernel, in thresholds."""
    peak = np.abs(wanted).max(axis=0)
    none = peak < FAINT
    size = np.where(none, theta, peak)
    difference = (found - wanted) / size
    energy = np.where(none, 1.0, ((wanted / size) ** 2).sum(axis=0))
    return float(np.abs(difference).max()), math.sqrt(
        float(((difference**2).sum(axis=0) / energy).max())
    )
