"""The spike response kernels, sampled once a step, in their recursive form (SLAYER's SRMALPHA; Kang et al. 2022)."""

from __future__ import annotations

import math

from locsnn_compile.models.description import NeuronParameters


def psp_recursion(tau: float) -> tuple[float, float]:
    """Return (decay, gain) of eps(k) = gain * k * decay^(k - 1), the recursive form of the alpha kernel."""
    decay = math.exp(-1.0 / tau)
    return decay, math.e * decay / tau


def refractory_recursion(neuron: NeuronParameters) -> tuple[float, float]:
    """Return (decay, gain) of nu(k) = gain * k * decay^(k - 1), the recursive form of the refractory kernel.

    decay = exp(-1 / tau_ref) and gain = -scale_ref * theta * e * decay / tau_ref: the same numbers as
    nu(k) = -scale_ref * theta * (k / tau_ref) exp(1 - k / tau_ref), with two state variables and no cut tail.
    """
    decay = math.exp(-1.0 / neuron.tau_ref)
    return decay, -neuron.scale_ref * neuron.theta * math.e * decay / neuron.tau_ref
