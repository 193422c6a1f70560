"""Measure how well the chip's integers fit the kernels of a float neuron.

One input spike, and one own spike, are played to the integer neurons, and the responses are compared with the kernels.
"""

import math
from functools import singledispatch

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
    return KernelFit(*_leaky_input(neuron, scaled, registers), *_soft_drop(neuron, scaled, registers))


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
    slowest = float((1 - neuron.decay_v).max())
    lags = np.arange(_steps(-1.0 / math.log(slowest)) if 0 < slowest < 1 else _steps(slowest * STEPS_MAX))[:, None]
    wanted = -neuron.drop * scaled.scale * (1 - neuron.decay_v) ** lags
    return _errors(own_spike_response(scaled.neuron, registers, len(lags)), wanted, neuron.threshold * scaled.scale)


def _leaky_input(neuron: Leaky, scaled: Scaled, registers: Registers) -> tuple[float, float]:
    """Return the errors of the response to one input spike that brings each neuron to its threshold.

    Where that takes more charge than a step can hold, as it may for outputs that never spike, it is the largest charge.
    """
    slowest = float(np.maximum(1 - neuron.decay_u, 1 - neuron.decay_v).max())
    steps = _steps(-1.0 / math.log(slowest)) if 0 < slowest < 1 else _steps(slowest * STEPS_MAX)
    current, response = np.ones(len(neuron.threshold)), np.zeros((steps, len(neuron.threshold)))
    for step in range(steps):
        response[step] = (1 - neuron.decay_v) * response[step - 1] + current
        current = (1 - neuron.decay_u) * current
    theta = neuron.threshold * scaled.scale
    most = ((1 << registers.charge_bits) - 1) / scaled.gain
    weight = np.minimum(theta / response.max(axis=0), most)
    found = input_response(scaled.neuron, _whole(scaled.gain * weight), registers, steps)
    return _errors(found, weight * response, theta)


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
    return float(np.abs(difference).max()), math.sqrt(float(((difference**2).sum(axis=0) / energy).max()))
