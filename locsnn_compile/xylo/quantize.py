"""Round a network of leaky neurons to the integers of a Xylo.

Before: ``XyloParts``, in float.
After:  ``QuantizedXylo``: dashes, 8-bit weights with one shift per group of synapses, thresholds and biases.

A *dash* d is a decay as the chip stores it: a register loses 2^-d of itself per step. For each neuron, with w its
weights, T its threshold and b its bias in the network's units:

    dash        the integer nearest to -log2(decay), for current and potential
    s           127 2^level / largest |w|, or less if s T / g or s b / g would exceed 16 bits
    g           peak of the float neuron's response to a spike, divided by the peak of the chip's
    weight      round(s w / 2^shift), with the smallest shift for which all weights of the group fit 8 bits
    threshold   floor(s T / g) + 1 for v > T, and ceil(s T / g) for v >= T
    bias        round(s b / g - drift)

s is the scale: how many units of the chip's registers a weight of 1 becomes. Decays are rounded down on the chip, which
raises the potential by the *drift* per step on average; the bias makes up for that.

A higher ``level`` makes decays more exact, since a register can lose only whole units, but leaves less room in it.
Hidden neurons and outputs each take the highest level at which no current, and no potential at its upper end, can
saturate while every source sends at most one spike per step, as in the float network. If even level 0 does not
guarantee that, it is used, and saturations are counted when the program is played.

The drift is that of registers in motion. Its correction also lowers the potential at rest, from 0 to -drift 2^dash. To
limit that, the correction is at most what lowers it by a sixteenth of the threshold.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import xylo, xylo_inverse
from hw_model.values import FloatArray, IntArray
from hw_model.xylo.network import XyloNetwork, XyloPopulation
from hw_model.xylo.range import reach_of_hidden, reach_of_outputs
from locsnn_compile.xylo.parts import XyloNeurons, XyloParts, neurons_of
from locsnn_compile.xylo.quantized import QuantizedXylo, XyloScales
from locsnn_compile.xylo.synapses import GroupedWeights, add_weights, no_weights

MOST_LEVEL = 8
"""The highest level: a weight of 127 * 2^8 still fits a register of 16 bits."""
_REST_SHARE = 1 / 16
"""How far below 0 a potential may rest, as a share of the threshold. Chosen by hand."""
_PEAK_STEPS = 4096
"""In how many steps the peak of a response is searched. Chosen by hand: even the slowest neurons peak earlier."""
_ROUNDING = 1e-9
"""The rounding error of a logarithm that must not raise a shift by one bit."""


FloatWeights = GroupedWeights[FloatArray]


def quantize_xylo(parts: XyloParts) -> QuantizedXylo:
    """Return the integers of a network, with the highest levels at which nothing can saturate."""
    weights = float_weights(parts)
    onto_hidden = np.concatenate([weights.into_hidden, weights.among_hidden])
    hidden = ScaledNeurons(neurons_of(parts.hidden), onto_hidden)
    outputs = ScaledNeurons(neurons_of((parts.outputs,)), weights.into_outputs)
    # First the level of hidden neurons. Their bounds do not depend on the outputs, which get any level for now.
    hidden_scales = hidden.at(0)
    for level in range(min(MOST_LEVEL, hidden.most_level), 0, -1):
        candidate = hidden.at(level)
        quantized = _rounded(parts, weights, candidate, outputs.at(0))
        if reach_of_hidden(quantized.network).fits:
            hidden_scales = candidate
            break
    for level in range(min(MOST_LEVEL, outputs.most_level), 0, -1):
        quantized = _rounded(parts, weights, hidden_scales, outputs.at(level))
        if reach_of_outputs(quantized.network).fits:
            return quantized
    return _rounded(parts, weights, hidden_scales, outputs.at(0))


class ScaledNeurons:
    """Neurons, and the scales (n,) that their incoming ``weights`` (sources, n) allow.

    - ``usual_scale`` (n,): the scale at level 0
    - ``largest_scale`` (n,): the scale beyond which a threshold or a bias would exceed 16 bits
    """

    def __init__(self, neurons: XyloNeurons, weights: FloatArray) -> None:
        self.neurons = neurons
        self.gain = gain_of(neurons)
        largest_weight = np.abs(weights).max(axis=0, initial=0.0)
        largest_constant = np.maximum(neurons.threshold, np.abs(neurons.bias))
        # A neuron without inputs has no weights to keep exact, so its threshold or bias sets the scale.
        scaled_to_max = np.where(largest_weight > 0, largest_weight, largest_constant / self.gain)
        self.usual_scale = xylo.WEIGHT_MAX / scaled_to_max
        # One unit is left, because a threshold for v > T is stored one unit higher.
        self.largest_scale = (xylo.STATE_MAX - 1) * self.gain / largest_constant

    def at(self, level: int) -> XyloScales:
        """Return the scales of a level, limited by ``largest_scale``."""
        current = np.minimum(self.usual_scale * 2.0**level, self.largest_scale)
        return XyloScales(current=current, potential=current / self.gain, level=level)

    @property
    def most_level(self) -> int:
        """The highest level that no neuron's threshold or bias limits, so that all keep the full bits of weights."""
        octaves = math.log2(float(np.min(self.largest_scale / self.usual_scale)))
        return max(0, math.floor(octaves))


def float_weights(parts: XyloParts) -> FloatWeights:
    """Return the sum of all projections of each group of synapses, as dense matrices with the source first."""
    weights: FloatWeights = no_weights(parts, np.float64)
    for projection in parts.network.projections:
        # A projection may hold a sparse matrix or a convolution: multiply by the identity to make it dense.
        dense = np.asarray(projection.held @ np.eye(projection.held.shape[1])).T
        add_weights(weights, parts, projection, dense)
    return weights


def gain_of(neurons: XyloNeurons) -> FloatArray:
    """Return g, the peak of each float neuron's response to a spike divided by the peak on the chip, (n,)."""
    dash_syn = xylo_inverse.nearest_dash(neurons.decay_u)
    dash_mem = xylo_inverse.nearest_dash(neurons.decay_v)
    decays_and_dashes = zip(
        neurons.decay_u.tolist(),
        neurons.decay_v.tolist(),
        dash_syn.tolist(),
        dash_mem.tolist(),
        strict=True,
    )
    return np.array([_gain(*of_neuron) for of_neuron in decays_and_dashes])


# Cached, since most neurons of a network have the same decays.
@lru_cache(maxsize=4096)
def _gain(decay_u: float, decay_v: float, dash_syn: int, dash_mem: int) -> float:
    """Return g of one neuron."""
    # Only neurons without inputs get dash 0, see MOST_LOST in parts.py: their current stays 0 on both sides.
    if dash_syn == 0:
        return 1.0
    return float_peak(decay_u, decay_v) / xylo_inverse.peak_response(dash_syn, dash_mem)


def float_peak(decay_u: float, decay_v: float) -> float:
    """Return the highest potential of a float neuron after a charge of 1 at rest.

    i(0) = 1, i(t) = (1 - decay_u) i(t - 1);  v(t) = (1 - decay_v) v(t - 1) + i(t)

    In closed form, with a = 1 - decay_u and b = 1 - decay_v: v(t) = (a^(t + 1) - b^(t + 1)) / (a - b).
    """
    kept_i = 1.0 - decay_u
    kept_v = 1.0 - decay_v
    t = np.arange(_PEAK_STEPS, dtype=np.float64)
    # For equal decays, the limit of the closed form: otherwise it is 0 / 0.
    if math.isclose(kept_i, kept_v, rel_tol=1e-9):
        v = (t + 1) * kept_i**t
    else:
        v = (kept_i ** (t + 1) - kept_v ** (t + 1)) / (kept_i - kept_v)
    return float(v.max())


def _rounded(
    parts: XyloParts, weights: FloatWeights, of_hidden: XyloScales, of_outputs: XyloScales
) -> QuantizedXylo:
    """Return the network rounded with these scales."""
    hidden = _population(neurons_of(parts.hidden), of_hidden)
    outputs = _population(neurons_of((parts.outputs,)), of_outputs)
    into_hidden = _integers(weights.into_hidden * of_hidden.current)
    among_hidden = _integers(weights.among_hidden * of_hidden.current)
    into_outputs = _integers(weights.into_outputs * of_outputs.current)
    network = XyloNetwork(
        hidden=hidden,
        outputs=outputs,
        # The last axis: a hidden neuron of a Xylo can have several currents; ours have one.
        weights_in=into_hidden.mantissas[:, :, None],
        weights_hidden=among_hidden.mantissas[:, :, None],
        weights_out=into_outputs.mantissas,
        shift_in=into_hidden.shift,
        shift_hidden=among_hidden.shift,
        shift_out=into_outputs.shift,
    )
    return QuantizedXylo(parts, network, of_hidden, of_outputs)


def _population(neurons: XyloNeurons, scales: XyloScales) -> XyloPopulation:
    """Return the integer parameters of neurons; the formulas are in the module's docstring."""
    exact_threshold = neurons.threshold * scales.potential
    # The chip spikes if v >= threshold.
    threshold = np.where(neurons.strict, np.floor(exact_threshold) + 1, np.ceil(exact_threshold))
    dash_syn = xylo_inverse.nearest_dash(neurons.decay_u)
    dash_mem = xylo_inverse.nearest_dash(neurons.decay_v)
    # At rest, a bias of -drift is balanced by the leak at a potential of -drift / share_lost.
    most_drift = _REST_SHARE * threshold * xylo.share_lost(dash_mem)
    drift = np.minimum(xylo_inverse.rounding_drift(dash_syn, dash_mem), most_drift)
    bias = neurons.bias * scales.potential - drift
    return XyloPopulation(
        dash_syn=dash_syn[:, None],
        dash_mem=dash_mem,
        threshold=threshold.astype(np.int64),
        bias=np.rint(bias).astype(np.int64),
    )


class Shifted(NamedTuple):
    """The weights of a group of synapses, ``mantissas << shift``."""

    mantissas: IntArray
    shift: int


def _integers(scaled: FloatArray) -> Shifted:
    """Round weights, given in units of the registers, to 8 bits, with the smallest shift that makes all of them fit."""
    largest = float(np.abs(scaled).max(initial=0.0))
    octaves = math.log2(max(largest, 1.0) / xylo.WEIGHT_MAX)
    # The scale makes the largest weight exactly 127 * 2^level, so a rounding error must not add a shift.
    shift = max(0, math.ceil(octaves - _ROUNDING))
    mantissas = np.rint(scaled / 2.0**shift)
    # -128 is not used, so that the range is symmetric.
    clipped = np.clip(mantissas, -xylo.WEIGHT_MAX, xylo.WEIGHT_MAX)
    return Shifted(clipped.astype(np.int64), shift)
