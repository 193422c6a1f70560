"""The two levels of the network side as stable text, for people to read and for golden tests to compare."""

from __future__ import annotations

import math

import numpy as np

from hw_model.arithmetic.fixed_point import IntArray
from hw_model.mapping.graph import Axis
from hw_model.program.text import array_text
from locsnn_compile.network.chip_neurons import ChipCuba, ChipProjection, RefractoryDendrite, RefractoryTaps
from locsnn_compile.network.matrices import values_of
from locsnn_compile.network.network import Network, Neuron, Projection
from locsnn_compile.network.neurons import Cuba, FloatArray, SoftCuba, SrmAlpha
from locsnn_compile.network.quantized import KernelFit, QuantizedNetwork


def network_text(network: Network) -> str:
    """Return the text of a Network."""
    seconds = "" if network.step_seconds is None else f" of {network.step_seconds:g} s"
    lines = [f"network {network.name}: {network.channels} channels, {network.steps} steps{seconds}"]
    for view in network.views:
        walk = "" if view.walk is None else f", walk {array_text(view.walk)}"
        walk += "" if view.together == 1 else f", {view.together} together"
        walk += "" if view.silence == 0 else f", {view.silence} steps of silence"
        lines.append(
            f"  input {view.name}: {view.lines} lines over {network.steps_of(view.axis)} {view.axis} steps{walk}"
        )
    for p in network.populations:
        lines.append(f"  population {p.name}: {p.size} {_neuron_text(p.neuron, p.axis)}")
    for projection in network.projections:
        lines.append(f"  weights {_projection_text(projection)}")
    return "\n".join(lines) + "\n"


def quantized_text(quantized: QuantizedNetwork) -> str:
    """Return the text of a QuantizedNetwork."""
    lines = [f"quantized {quantized.network.name}"]
    for q in quantized.populations:
        lines.append(
            f"  population {q.population.name}: {_neuron_text(q.neuron, q.population.axis)}, "
            f"scale {_number_text(q.scale)}"
        )
        if q.fit is not None:
            lines.append(f"    kernel fit, {q.strategy}: {_fit_text(q.fit)}")
    for p in quantized.projections:
        lines.append(f"  weights {_projection_text(p)}")
    return "\n".join(lines) + "\n"


def _neuron_text(n: Neuron, axis: Axis) -> str:
    if isinstance(n, SrmAlpha):
        cut = "" if math.isinf(n.eps_taps) else f", kernels cut after {n.eps_taps:g} and {n.nu_taps:g}"
        return (
            f"SRM neurons along {axis}, theta {n.theta:g}, tau_sr {n.tau_sr:g}, tau_ref {n.tau_ref:g}, "
            f"scale_ref {n.scale_ref:g}{cut}"
        )
    decays = f"decay_u {_number_text(n.decay_u)}, decay_v {_number_text(n.decay_v)}"
    if isinstance(n, Cuba):
        bias = f"bias {_number_text(n.bias)}, " if n.bias.any() else ""
        return (
            f"LIF neurons along {axis}, {decays}, threshold {n.rule} {_number_text(n.threshold)}, {bias}"
            f"refractory {array_text(n.refractory)}"
        )
    if isinstance(n, SoftCuba):
        return (
            f"LIF neurons along {axis}, {decays}, threshold > {_number_text(n.threshold)}, a spike takes "
            f"{_number_text(n.drop)}"
        )
    if isinstance(n, ChipCuba):
        mantissa, exponent = array_text(n.bias_mantissa), array_text(n.bias_exponent)
        bias = f"bias {mantissa} * 2^{exponent}, " if n.bias_mantissa.any() else ""
        return (
            f"integer LIF neurons along {axis}, {decays}, threshold {array_text(n.threshold)}, {bias}"
            f"refractory {array_text(n.refractory)}"
        )
    return (
        f"integer SRM neurons along {axis}, {decays}, threshold {array_text(n.threshold)}, "
        f"{_refractory_text(n.refractory)}{f', {n.dendrites} dendrites of each kind' if n.dendrites > 1 else ''}"
    )


def _refractory_text(part: RefractoryDendrite | RefractoryTaps) -> str:
    if isinstance(part, RefractoryDendrite):
        return (
            f"refractory dendrite of decay {array_text(part.decay)} and weight {array_text(part.mantissa)} * "
            f"2^{part.exponent}"
        )
    taps = zip(part.delay.tolist(), part.mantissa, part.exponent.tolist(), strict=True)
    weights = [f"{array_text(mantissa)} * 2^{exponent} after {delay}" for delay, mantissa, exponent in taps]
    return f"{len(weights)} refractory taps: {', '.join(weights) or 'none'}"


def _fit_text(fit: KernelFit) -> str:
    text = f"input {fit.input_max:.3g} at most, {fit.input_rms:.3g} rms"
    if fit.refractory_max is None:
        return text
    return f"{text}; own spike {fit.refractory_max:.3g} at most, {fit.refractory_rms:.3g} rms"


def _projection_text(p: Projection | ChipProjection) -> str:
    held = p.mantissa if isinstance(p, ChipProjection) else p.weights
    entries = f"{len(values_of(held))} entries " if values_of(held).ndim == 1 else ""
    text = entries + array_text(values_of(held))
    if isinstance(p, ChipProjection):
        text = f"{p.weight_bits}-bit, signs {p.signs}, exponent {p.exponent}, mantissa {text}"
    delay = f", delay {array_text(np.asarray(p.delay))}" if np.any(p.delay) else ""
    entrance = f", dendrite {p.dendrite}" if isinstance(p, ChipProjection) and p.dendrite else ""
    return f"{p.source} -> {p.target}: {text}{delay}{entrance}"


def _number_text(values: FloatArray | IntArray) -> str:
    low, high = values.min(), values.max()
    return f"{low:g}" if low == high else array_text(values)
