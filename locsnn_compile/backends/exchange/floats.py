"""Give the neurons and weights of a network in floats, as files of other tools hold them.

A network may have been trained in floats, or in the integers of a chip; integers become floats in the units of the
registers.
"""

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
"""How to get a part of a network that a format cannot hold, for errors."""


def weights_of(projection: Projection | ChipProjection) -> tuple[Matrix, float]:
    """Return the weights of a projection, and the factor by which to multiply them.

    The factor is applied by the caller, since sparse and dense weights are multiplied in different places.
    """
    if isinstance(projection, ChipProjection):
        mantissas = values_of(projection.mantissa)
        units = loihi.whole_units(loihi.charge_of(mantissas, projection.exponent)).astype(
            np.float64
        )
        return with_values(projection.mantissa, units), loihi.in_registers(1.0)
    return projection.weights, 1.0


def neurons_of(neuron: Cuba | ChipCuba) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
    """Return what u and v lose in a step (shares of 1), the threshold above which v spikes, and the bias, each (n,)."""
    if isinstance(neuron, ChipCuba):
        bias = neuron.bias_mantissa * 2.0**neuron.bias_exponent
        return (
            loihi_inverse.share_lost(neuron.decay_u),
            loihi_inverse.share_lost(neuron.decay_v),
            loihi.threshold_of(neuron.threshold.astype(np.float64)),
            bias,
        )
    # In the files, a neuron spikes only above its threshold. For a neuron that spikes at its threshold as well, write
    # the next smaller float.
    threshold = neuron.threshold if neuron.rule == ">" else np.nextafter(neuron.threshold, -np.inf)
    return neuron.decay_u, neuron.decay_v, threshold, neuron.bias


def may_spike(neuron: Cuba | ChipCuba, onto: Iterable[Projection | ChipProjection]) -> bool:
    """Whether any input can lead a neuron above its threshold.

    The largest input is spikes of all sources of one sign in every step, together with the bias. A neuron in integers
    with the highest threshold counts as silent: files mark neurons that must not spike in this way.
    """
    decay_u, decay_v, threshold, bias = neurons_of(neuron)
    charge = sum(row_sums(weights) * factor for weights, factor in map(weights_of, onto))
    # A constant charge q drives u to q / decay_u, and v to (u + bias) / decay_v. Without decay, they grow for ever.
    tiny = 1e-99
    largest_u = charge / np.maximum(decay_u, tiny)
    largest_v = (largest_u + np.abs(bias)) / np.maximum(decay_v, tiny)
    is_silent = isinstance(neuron, ChipCuba) and neuron.threshold >= THRESHOLD_MAX
    return bool(((largest_v > threshold) & ~np.asarray(is_silent)).any())
