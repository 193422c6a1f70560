"""The spike response kernels, sampled once a step (SLAYER's SRMALPHA; Kang et al. 2022, eq. 2 and 3)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from locsnn_compile.models.description import NeuronParameters


def alpha_kernel(tau: float, steps: int) -> NDArray[np.float64]:
    """Return ``(k / tau) exp(1 - k / tau)`` for k = 0 .. steps - 1: 0 at k = 0, 1 at k = tau; ``tau`` in
    steps.
    """
    lag = np.arange(steps, dtype=np.float64)
    return (lag / tau) * np.exp(1.0 - lag / tau)


def psp_matrix(tau: float, steps: int) -> NDArray[np.float64]:
    """Return the (steps, steps) matrix M with M[t, s] = eps(t - s) for s <= t, else 0.

    The postsynaptic potential of drives d (steps, n) is M @ d: the whole kernel, with no tap cut off.
    """
    kernel = alpha_kernel(tau, steps)
    lag = np.subtract.outer(np.arange(steps), np.arange(steps))
    return np.where(lag >= 0, kernel[np.abs(lag)], 0.0)


def refractory_recursion(neuron: NeuronParameters) -> tuple[float, float]:
    """Return (decay, gain) of nu(k) = gain * k * decay^(k - 1), the recursive form of the refractory kernel.

    decay = exp(-1 / tau_ref) and gain = -scale_ref * theta * e * decay / tau_ref: the same numbers as
    nu(k) = -scale_ref * theta * (k / tau_ref) exp(1 - k / tau_ref), with two state variables and no cut tail.
    """
    decay = math.exp(-1.0 / neuron.tau_ref)
    return decay, -neuron.scale_ref * neuron.theta * math.e * decay / neuron.tau_ref
