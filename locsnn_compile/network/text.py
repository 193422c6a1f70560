"""The two levels of networks as stable text, for people to read and for golden tests to compare.

There is one line per view, population and projection. Usual values (no bias, no floor, whole kernels, no delay) are
left out.
"""

from functools import singledispatch

import numpy as np

from hw_model.mapping.graph import Axis
from hw_model.program.text import array_text, ended
from hw_model.values import FloatArray, IntArray
from locsnn_compile.errors import counted
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipSrm, Refractory
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import Cuba, Leaky, Neuron, SoftCuba, SrmAlpha
from locsnn_compile.network.projections import ChipProjection, Matrix, Projection, values_of
from locsnn_compile.network.quantized import KernelFit, QuantizedNetwork, QuantizedPopulation


def network_text(network: Network) -> str:
    """Return the text of a Network."""
    step_seconds = "" if network.step_seconds is None else f" of {network.step_seconds:g} s"
    return ended(
        [
            f"network {network.name}: {network.channels} channels, "
            f"{network.steps} steps{step_seconds}",
            *(_view(view, network) for view in network.views),
            *(_population(population) for population in network.populations),
            *(_projection(projection) for projection in network.projections),
        ]
    )


def quantized_text(quantized: QuantizedNetwork) -> str:
    """Return the text of a QuantizedNetwork."""
    lines = [f"quantized {quantized.network.name}"]
    for population in quantized.populations:
        lines += _quantized_population(population)
    lines += [_projection(projection) for projection in quantized.projections]
    return ended(lines)


def _view(view: InputView, network: Network) -> str:
    text = (
        f"  input {view.name}: {view.lines} lines "
        f"over {network.steps_of(view.phase)} {view.axis} steps"
    )
    if view.walk is not None:
        text += f", walk {array_text(view.walk)}"
    if view.together != 1:
        text += f", {view.together} together"
    if view.silence:
        text += f", {view.silence} steps of silence"
    if view.align_events is not None:
        text += f", from the first step with {view.align_events} or more events on"
    return text


def _population(population: Population) -> str:
    neurons = neuron_text(population.neuron, population.axis)
    return f"  population {population.name}: {population.size} {neurons}"


def _quantized_population(quantized: QuantizedPopulation) -> list[str]:
    population = quantized.population
    neurons = neuron_text(quantized.neuron, population.axis)
    scale = _number_text(quantized.scale)
    fit = quantized.fit
    return [
        f"  population {population.name}: {neurons}, scale {scale}",
        *([] if fit is None else [_kernel_fit(quantized.strategy, fit)]),
    ]


def _kernel_fit(strategy: str, fit: KernelFit) -> str:
    own_spike = ""
    if fit.refractory_max is not None:
        own_spike = f"; own spike {fit.refractory_max:.3g} at most, {fit.refractory_rms:.3g} rms"
    return (
        f"    kernel fit, {strategy}: input {fit.input_max:.3g} at most, "
        f"{fit.input_rms:.3g} rms{own_spike}"
    )


def _projection(projection: Projection | ChipProjection) -> str:
    ends = f"  weights {projection.source} -> {projection.target}: "
    delay = _delay_text(projection.delay)
    if isinstance(projection, Projection):
        return f"{ends}{_matrix_text(projection.weights)}{delay}"
    dendrite = f", dendrite {projection.dendrite}" if projection.dendrite else ""
    return (
        f"{ends}{projection.weight_bits}-bit, signs {projection.signs}, "
        f"exponent {projection.exponent}, mantissa {_matrix_text(projection.mantissa)}"
        f"{delay}{dendrite}"
    )


@singledispatch
def neuron_text(n: Neuron, axis: Axis) -> str:
    """Return the text of neurons along an axis; for a model without its own text, its name and numbers."""
    # The size of 1 only affects the shapes of parameters, which are not shown.
    rows = (f"{name} {_number_text(values)}" for name, values, *_ in n.parameters(1))
    return f"{type(n).__name__} neurons along {axis}, {', '.join(rows)}"


@neuron_text.register
def _srm_alpha_text(n: SrmAlpha, axis: Axis) -> str:
    cut = ""
    if n != n.whole():
        cut = f", kernels cut after {n.eps_taps:g} and {n.nu_taps:g}"
    return (
        f"SRM neurons along {axis}, theta {n.theta:g}, tau_sr {n.tau_sr:g}, "
        f"tau_ref {n.tau_ref:g}, scale_ref {n.scale_ref:g}{cut}"
    )


@neuron_text.register
def _cuba_text(n: Cuba, axis: Axis) -> str:
    bias = f", bias {_number_text(n.bias)}" if n.biased.any() else ""
    return (
        f"LIF neurons along {axis}, {_decays_text(n)}, "
        f"threshold {n.rule} {_number_text(n.threshold)}{bias}, "
        f"refractory {array_text(n.refractory)}{_floor_text(n.floor)}"
    )


@neuron_text.register
def _soft_cuba_text(n: SoftCuba, axis: Axis) -> str:
    return (
        f"LIF neurons along {axis}, {_decays_text(n)}, threshold > {_number_text(n.threshold)}, "
        f"a spike takes {_number_text(n.drop)}{_floor_text(n.floor)}"
    )


@neuron_text.register
def _chip_cuba_text(n: ChipCuba, axis: Axis) -> str:
    bias = ""
    if n.biased.any():
        bias = f", bias {array_text(n.bias_mantissa)} * 2^{array_text(n.bias_exponent)}"
    return (
        f"integer LIF neurons along {axis}, {_decays_text(n)}, "
        f"threshold {array_text(n.threshold)}{bias}, "
        f"refractory {array_text(n.refractory)}{_vmin_text(n.vmin)}"
    )


@neuron_text.register
def _chip_srm_text(n: ChipSrm, axis: Axis) -> str:
    dendrites = f", {n.dendrites} dendrites of each kind" if n.dendrites != 1 else ""
    return (
        f"integer SRM neurons along {axis}, {_decays_text(n)}, "
        f"threshold {array_text(n.threshold)}, "
        f"{_refractory_text(n.refractory)}{dendrites}{_vmin_text(n.vmin)}"
    )


def _decays_text(n: Leaky | ChipNeuron) -> str:
    return f"decay_u {_number_text(n.decay_u)}, decay_v {_number_text(n.decay_v)}"


def _floor_text(floor: FloatArray | None) -> str:
    return "" if floor is None else f", floor {_number_text(floor)}"


def _vmin_text(vmin: IntArray | None) -> str:
    return "" if vmin is None else f", vmin {_number_text(vmin)}"


def _refractory_text(refractory: Refractory) -> str:
    taps = zip(
        refractory.delay.tolist(), refractory.mantissa, refractory.exponent.tolist(), strict=True
    )
    weights = [
        (f"{array_text(mantissa)} * 2^{exponent}", delay) for delay, mantissa, exponent in taps
    ]
    if refractory.decay is not None:
        decay = array_text(refractory.decay)
        return f"refractory dendrite of decay {decay} and weight {weights[0][0]}"
    after = [f"{weight} after {delay}" for weight, delay in weights]
    return f"{len(weights)} refractory taps: {', '.join(after) or 'none'}"


def _matrix_text(m: Matrix) -> str:
    values = values_of(m)
    stored = f"{counted(len(values), 'entry', 'entries')} " if values.ndim == 1 else ""
    return stored + array_text(values)


def _delay_text(delay: int | IntArray) -> str:
    return f", delay {array_text(np.asarray(delay))}" if np.any(delay) else ""


def _number_text(values: FloatArray | IntArray) -> str:
    """Return one number if all values are equal, and otherwise the text of the array."""
    low = values.min()
    high = values.max()
    return f"{low:g}" if low == high else array_text(values)
