"""The two levels of networks as stable text, for people to read and for golden tests to compare."""

import math
from functools import singledispatch

import numpy as np

from hw_model.mapping.graph import Axis
from hw_model.program.text import array_text
from hw_model.values import FloatArray, IntArray
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipSrm, Refractory
from locsnn_compile.network.network import Network
from locsnn_compile.network.neurons import Cuba, Leaky, Neuron, SoftCuba, SrmAlpha
from locsnn_compile.network.projections import ChipProjection, Projection, values_of
from locsnn_compile.network.quantized import KernelFit, QuantizedNetwork


def network_text(network: Network) -> str:
    """Return the text of a Network."""
    seconds = "" if network.step_seconds is None else f" of {network.step_seconds:g} s"
    lines = [f"network {network.name}: {network.channels} channels, {network.steps} steps{seconds}"]
    for view in network.views:
        walk = "" if view.walk is None else f", walk {array_text(view.walk)}"
        walk += "" if view.together == 1 else f", {view.together} together"
        walk += "" if view.silence == 0 else f", {view.silence} steps of silence"
        walk += "" if view.align_events is None else f", from the first step with {view.align_events} or more events on"
        lines.append(
            f"  input {view.name}: {view.lines} lines over {network.steps_of(view.phase)} {view.axis} steps{walk}"
        )
    lines += [f"  population {p.name}: {p.size} {neuron_text(p.neuron, p.axis)}" for p in network.populations]
    lines += [f"  weights {_projection_text(projection)}" for projection in network.projections]
    return "\n".join(lines) + "\n"


def quantized_text(quantized: QuantizedNetwork) -> str:
    """Return the text of a QuantizedNetwork."""
    lines = [f"quantized {quantized.network.name}"]
    for q in quantized.populations:
        lines.append(
            f"  population {q.population.name}: {neuron_text(q.neuron, q.population.axis)}, "
            f"scale {_number_text(q.scale)}"
        )
        if q.fit is not None:
            lines.append(f"    kernel fit, {q.strategy}: {_fit_text(q.fit)}")
    lines += [f"  weights {_projection_text(p)}" for p in quantized.projections]
    return "\n".join(lines) + "\n"


@singledispatch
def neuron_text(n: Neuron, axis: Axis) -> str:
    """Return the text of neurons along an axis; for a model without its own text, its name and numbers."""
    rows = (f"{name} {_number_text(values)}" for name, values, *_ in n.parameters(1))
    return f"{type(n).__name__} neurons along {axis}, {', '.join(rows)}"


@neuron_text.register
def _(n: SrmAlpha, axis: Axis) -> str:
    cut = "" if math.isinf(n.eps_taps) else f", kernels cut after {n.eps_taps:g} and {n.nu_taps:g}"
    return (
        f"SRM neurons along {axis}, theta {n.theta:g}, tau_sr {n.tau_sr:g}, tau_ref {n.tau_ref:g}, "
        f"scale_ref {n.scale_ref:g}{cut}"
    )


@neuron_text.register
def _(n: Cuba, axis: Axis) -> str:
    bias = f"bias {_number_text(n.bias)}, " if n.bias.any() else ""
    return (
        f"LIF neurons along {axis}, {_decays_text(n)}, threshold {n.rule} {_number_text(n.threshold)}, {bias}"
        f"refractory {array_text(n.refractory)}"
    )


@neuron_text.register
def _(n: SoftCuba, axis: Axis) -> str:
    threshold, drop = _number_text(n.threshold), _number_text(n.drop)
    return f"LIF neurons along {axis}, {_decays_text(n)}, threshold > {threshold}, a spike takes {drop}"


@neuron_text.register
def _(n: ChipCuba, axis: Axis) -> str:
    mantissa, exponent = array_text(n.bias_mantissa), array_text(n.bias_exponent)
    bias = f"bias {mantissa} * 2^{exponent}, " if n.bias_mantissa.any() else ""
    return (
        f"integer LIF neurons along {axis}, {_decays_text(n)}, threshold {array_text(n.threshold)}, {bias}"
        f"refractory {array_text(n.refractory)}"
    )


@neuron_text.register
def _(n: ChipSrm, axis: Axis) -> str:
    return (
        f"integer SRM neurons along {axis}, {_decays_text(n)}, threshold {array_text(n.threshold)}, "
        f"{_refractory_text(n.refractory)}{f', {n.dendrites} dendrites of each kind' if n.dendrites > 1 else ''}"
    )


def _decays_text(n: Leaky | ChipNeuron) -> str:
    return f"decay_u {_number_text(n.decay_u)}, decay_v {_number_text(n.decay_v)}"


def _refractory_text(part: Refractory) -> str:
    taps = zip(part.delay.tolist(), part.mantissa, part.exponent.tolist(), strict=True)
    weights = [(f"{array_text(mantissa)} * 2^{exponent}", delay) for delay, mantissa, exponent in taps]
    if part.decay is not None:
        return f"refractory dendrite of decay {array_text(part.decay)} and weight {weights[0][0]}"
    after = [f"{weight} after {delay}" for weight, delay in weights]
    return f"{len(weights)} refractory taps: {', '.join(after) or 'none'}"


def _fit_text(fit: KernelFit) -> str:
    text = f"input {fit.input_max:.3g} at most, {fit.input_rms:.3g} rms"
    if fit.refractory_max is None:
        return text
    return f"{text}; own spike {fit.refractory_max:.3g} at most, {fit.refractory_rms:.3g} rms"


def _projection_text(p: Projection | ChipProjection) -> str:
    values = values_of(p.held)
    text = (f"{len(values)} entries " if values.ndim == 1 else "") + array_text(values)
    if isinstance(p, ChipProjection):
        text = f"{p.weight_bits}-bit, signs {p.signs}, exponent {p.exponent}, mantissa {text}"
    delay = f", delay {array_text(np.asarray(p.delay))}" if np.any(p.delay) else ""
    entrance = f", dendrite {p.dendrite}" if p.dendrite else ""
    return f"{p.source} -> {p.target}: {text}{delay}{entrance}"


def _number_text(values: FloatArray | IntArray) -> str:
    low, high = values.min(), values.max()
    return f"{low:g}" if low == high else array_text(values)
