"""Kernels cut as slayerPytorch cuts them, in a network that has their full tails.

A cut kernel is the full one minus a delayed copy of its tail, and the tail of an alpha kernel is made of two alpha
kernels: with K taps kept (lags 0..K-1), ``a`` the decay, and lag k >= K,

    k a^(k-1)  =  K a^(K-1) * j a^(j-1) at j = k - K + 1   -   (K - 1) a^K * j a^(j-1) at j = k - K

So a synapse is followed by two others of delays K - 1 and K, with ``-K a^(K-1)`` and ``(K - 1) a^K`` times its weight.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

from locsnn_compile.network.network import Network
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.verification.error_budget.twin import Twin, TwinSynapses

CUT = 0.01
"""slayerPytorch ends a kernel at the first lag beyond tau at which its magnitude is below this."""


def kept_taps(tau: float, peak: float = 1.0) -> int:
    """Return the taps that slayerPytorch keeps of ``peak * (k / tau) * exp(1 - k / tau)``, lag 0 included."""
    return next(k for k in itertools.count() if k > tau and abs(peak) * (k / tau) * math.exp(1.0 - k / tau) < CUT)


def has_tails(network: Network) -> bool:
    """Return whether any population has kernels to cut."""
    return any(isinstance(population.neuron, SrmAlpha) for population in network.populations)


def with_cut_tails(twin: Twin, network: Network) -> Twin:
    """Return a float twin of SRM populations whose kernels end where slayerPytorch ends them."""
    cuts: dict[str, tuple[int, float]] = {}
    for population in network.populations:
        neuron, name = population.neuron, population.name
        if isinstance(neuron, SrmAlpha):
            cuts[f"{name}/dendrite"] = kept_taps(neuron.tau_sr), neuron.tau_sr
            if neuron.scale_ref:
                cuts[f"{name}/refractory"] = kept_taps(neuron.tau_ref, neuron.scale_ref * neuron.theta), neuron.tau_ref
    return replace(twin, synapses=tuple(made for s in twin.synapses for made in _cut(s, cuts)))


def _cut(synapses: TwinSynapses, cuts: dict[str, tuple[int, float]]) -> tuple[TwinSynapses, ...]:
    # Second dendrites have the kernels of the first.
    target = synapses.target.removesuffix("_2")
    if target not in cuts:
        return (synapses,)
    taps, tau = cuts[target]
    a = math.exp(-1.0 / tau)
    tail = ((taps - 1, -taps * a ** (taps - 1)), (taps, (taps - 1) * a**taps))
    return (
        synapses,
        *(replace(synapses, weights=synapses.weights * x, delay=synapses.delay + d) for d, x in tail),
    )
