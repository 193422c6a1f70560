"""Neurons and weights as files of other tools see them: in floats, whichever kind of numbers a network holds."""

from collections.abc import Iterable

import numpy as np

from hw_model.arithmetic import loihi, loihi_inverse
from hw_model.values import AnyArray
from locsnn_compile.frontends.lava_dl.to_network import THRESHOLD_MAX
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.network.projections import (
    ChipProjection,
    Matrix,
    Projection,
    row_sums,
    values_of,
    with_values,
)

HELD = "program.yaml holds it, and --emit network shows it."
"""The way out for a part of a network that a format cannot hold."""


def weights_of(projection: Projection | ChipProjection) -> tuple[Matrix, float]:
    """Return weights and the factor that they stand for."""
    if isinstance(projection, ChipProjection):
        mantissas = values_of(projection.mantissa)
        units = loihi.whole_units(loihi.charge_of(mantissas, projection.exponent)).astype(
            np.float64
        )
        return with_values(projection.mantissa, units), loihi.in_registers(1.0)
    return projection.weights, 1.0


def neurons_of(neuron: Cuba | ChipCuba) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
    """Return both decays, the threshold above which it spikes, and the bias, each (n,)."""
    if isinstance(neuron, ChipCuba):
        bias = neuron.bias_mantissa * 2.0**neuron.bias_exponent
        return (
            loihi_inverse.share_lost(neuron.decay_u),
            loihi_inverse.share_lost(neuron.decay_v),
            loihi.threshold_of(neuron.threshold.astype(np.float64)),
            bias,
        )
    # Files spike only above the threshold; to spike at it as well, take the next number below.
    threshold = neuron.threshold if neuron.rule == ">" else np.nextafter(neuron.threshold, -np.inf)
    return neuron.decay_u, neuron.decay_v, threshold, neuron.bias


def may_spike(neuron: Cuba | ChipCuba, onto: Iterable[Projection | ChipProjection]) -> bool:
    """Tell whether spikes of all inputs of one sign in every step, and biases, lead a neuron above its threshold.

    The highest threshold in integers stands for neurons that must not spike.
    """
    u, v, threshold, bias = neurons_of(neuron)
    charge = sum(row_sums(weights) * factor for weights, factor in map(weights_of, onto))
    reached = (charge / np.maximum(u, 1e-99) + np.abs(bias)) / np.maximum(v, 1e-99)
    silent = isinstance(neuron, ChipCuba) and neuron.threshold >= THRESHOLD_MAX
    return bool(((reached > threshold) & ~np.asarray(silent)).any())
