"""How well integer neurons fit the kernels of float neurons, for a section of the report.

One input spike, and one own spike, are played to the integer neurons (:mod:`locsnn_compile.reference.integer_neurons`).
Their responses are compared with the kernels of the float neurons, scaled to the units of the registers.
"""

import math
from functools import singledispatch
from typing import NamedTuple

import numpy as np

from hw_model.description.chip import Registers
from hw_model.values import FloatArray, IntArray
from locsnn_compile.network.neurons import Cuba, Leaky, Neuron, SoftCuba, SrmAlpha
from locsnn_compile.network.quantized import KernelFit
from locsnn_compile.passes.kernels import kernel
from locsnn_compile.passes.rounding.task import Scaled
from locsnn_compile.reference.integer_neurons import input_response, own_spike_response

LENGTHS = 12
"""Time constants over which responses are compared: later values are below 2e-4 of a kernel's largest value."""
STEPS_MAX = 4096
"""Largest number of steps over which responses are compared, for long or infinite memories; chosen by hand."""
FAINT = 0.5
"""A kernel whose largest value is below half a unit of the registers rounds to 0: relative errors mean nothing."""


class Errors(NamedTuple):
    """The worst neuron's largest error, and its root mean square, relative to its kernel."""

    largest: float
    rms: float


@singledispatch
def kernel_fit(neuron: Neuron, scaled: Scaled, registers: Registers) -> KernelFit | None:
    """Return the fit of the worst neuron; None for a model that has not registered a measure."""
    return None


@kernel_fit.register
def _(neuron: Cuba, scaled: Scaled, registers: Registers) -> KernelFit:
    return _fit(_leaky_input(neuron, scaled, registers))


@kernel_fit.register
def _(neuron: SoftCuba, scaled: Scaled, registers: Registers) -> KernelFit:
    of_input = _leaky_input(neuron, scaled, registers)
    return _fit(of_input, _soft_drop(neuron, scaled, registers))


@kernel_fit.register
def _(neuron: SrmAlpha, scaled: Scaled, registers: Registers) -> KernelFit:
    of_input = _alpha_input(neuron, scaled, registers)
    if neuron.scale_ref == 0 and scaled.neuron.strategy != "native":
        return _fit(of_input)
    return _fit(of_input, _alpha_refractory(neuron, scaled, registers))


def _fit(of_input: Errors, of_own_spike: Errors | None = None) -> KernelFit:
    if of_own_spike is None:
        return KernelFit(of_input.largest, of_input.rms, refractory_max=None, refractory_rms=None)
    return KernelFit(of_input.largest, of_input.rms, of_own_spike.largest, of_own_spike.rms)


def _alpha_input(neuron: SrmAlpha, scaled: Scaled, registers: Registers) -> Errors:
    """Return the errors of eps, for a weight of theta: eps peaks at 1, so the response peaks at the threshold."""
    theta = neuron.theta * scaled.scale
    k = _lags(neuron.tau_sr)
    response = input_response(scaled.neuron, _whole(scaled.gain * theta), registers, len(k))
    return _errors(response, theta * kernel(neuron.tau_sr, k), theta)


def _alpha_refractory(neuron: SrmAlpha, scaled: Scaled, registers: Registers) -> Errors:
    """Return the errors of nu."""
    theta = neuron.theta * scaled.scale
    # Taps and resets act on the filters of the input, whose memory can outlast nu.
    k = _lags(max(neuron.tau_sr, neuron.tau_ref))
    nu = -neuron.scale_ref * theta * kernel(neuron.tau_ref, k)
    response = own_spike_response(scaled.neuron, registers, len(k))
    return _errors(response, nu, theta)


def _soft_drop(neuron: SoftCuba, scaled: Scaled, registers: Registers) -> Errors:
    """Return the errors of the drop that a spike causes in the potential of neurons at rest."""
    keep_v = 1 - neuron.decay_v
    lags = np.arange(_steps_of(keep_v))[:, None]
    exact = -neuron.drop * scaled.scale * keep_v**lags
    response = own_spike_response(scaled.neuron, registers, len(lags))
    return _errors(response, exact, neuron.threshold * scaled.scale)


def _leaky_input(neuron: Leaky, scaled: Scaled, registers: Registers) -> Errors:
    """Return the errors of the response to one input spike that brings each neuron to its threshold.

    If that takes more charge than one step can hold, as it may for readout neurons that never spike, the spike brings
    the largest charge.
    """
    keep_u = 1 - neuron.decay_u
    keep_v = 1 - neuron.decay_v
    steps = _steps_of(np.maximum(keep_u, keep_v))
    size = len(neuron.threshold)
    current = np.ones(size)
    response = np.zeros((steps, size))  # of the float neuron, to a weight of 1
    for step in range(steps):
        # In step 0, row -1 is the last one, which is still 0.
        response[step] = keep_v * response[step - 1] + current
        current = keep_u * current
    theta = neuron.threshold * scaled.scale
    # In units of the registers; the gain turns a weight into a charge.
    largest_weight = (registers.half_charge - 1) / scaled.gain
    weight = np.minimum(theta / response.max(axis=0), largest_weight)
    of_chip = input_response(scaled.neuron, _whole(scaled.gain * weight), registers, steps)
    return _errors(of_chip, weight * response, theta)


def _lags(tau: float) -> FloatArray:
    """Return the lags 1, 2, ... over which a kernel of a time constant is compared, (lags, 1)."""
    return np.arange(1, _steps(tau) + 1, dtype=np.float64)[:, None]


def _steps_of(keep: FloatArray) -> int:
    """Return the number of steps to compare for neurons that keep these shares (n,) per step."""
    slowest = float(keep.max())
    if 0 < slowest < 1:
        return _steps(-1.0 / math.log(slowest))
    # A share of 1 never fades and takes the largest number of steps, a share of 0 the least.
    return _steps(slowest * STEPS_MAX)


def _steps(tau: float) -> int:
    """Return the number of steps to compare for a time constant; at least :data:`LENGTHS`."""
    return min(math.ceil(LENGTHS * tau) + LENGTHS, STEPS_MAX)


def _whole(charge: FloatArray) -> IntArray:
    """Round charges to integers."""
    return np.rint(charge).astype(np.int64)


def _errors(response: IntArray, exact: FloatArray, theta: FloatArray) -> Errors:
    """Compare responses (lags, n) with kernels (lags, n), in units of the registers.

    Errors are relative to each kernel; for a neuron whose kernel is :data:`FAINT`, they are in thresholds ``theta``.
    """
    peak = np.abs(exact).max(axis=0)
    is_faint = peak < FAINT
    unit = np.where(is_faint, theta, peak)
    difference = (response - exact) / unit
    energy = np.where(is_faint, 1.0, ((exact / unit) ** 2).sum(axis=0))
    square_error = (difference**2).sum(axis=0) / energy
    return Errors(float(np.abs(difference).max()), math.sqrt(float(square_error.max())))
