"""Round a network of leaky neurons to the integers of a Xylo.

Before: ``XyloParts``, in float.
After:  ``QuantizedXylo``: dashes, weights of 8 bits with a shift a group, thresholds and biases.

For each neuron, with w its weights, T its threshold and b its bias in the network's units:

    dash        the nearest to -log2(decay), for current and potential
    s           127 2^level / largest |w|, or less where s T / g or s b / g would leave 16 bits
    g           peak of the float neuron's response to a spike over that of the chip's
    weight      round(s w / 2^shift), with the least shift for which all of its group fit 8 bits
    threshold   floor(s T / g) + 1 for v > T, and ceil(s T / g) for v >= T
    bias        round(s b / g - drift); decays are rounded down, which adds the drift in a step

A higher ``level`` makes decays more exact, as a register loses whole units, and leaves less room in
it. Hidden neurons and outputs each take the highest level at which no current, and no potential
upwards, can saturate while every source sends once in a step, as in the float network. Where even
level 0 gives no such proof, saturations are counted only.

The drift is that of registers in motion. It also moves the potential at rest, from 0 down to
-drift 2^dash; more than a sixteenth of the threshold is not given away for it.
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
"""127 * 2^8 still fits a register of 16 bits."""
_REST_SHARE = 1 / 16
"""How far below 0 a potential may rest, as a share of the threshold."""
_PEAK_STEPS = 4096
_ROUNDING = 1e-9


FloatWeights = GroupedWeights[FloatArray]


def quantize_xylo(parts: XyloParts) -> QuantizedXylo:
    """Return the integers of a network."""
    weights = float_weights(parts)
    onto_hidden = np.concatenate([weights.into_hidden, weights.among_hidden])
    hidden = ScaledNeurons(neurons_of(parts.hidden), onto_hidden)
    outputs = ScaledNeurons(neurons_of((parts.outputs,)), weights.into_outputs)
    for level in range(min(MOST_LEVEL, hidden.most_level), 0, -1):
        of_hidden = hidden.at(level)
        if reach_of_hidden(_rounded(parts, weights, of_hidden, outputs.at(0)).network).fits:
            break
    else:
        of_hidden = hidden.at(0)
    for level in range(min(MOST_LEVEL, outputs.most_level), 0, -1):
        quantized = _rounded(parts, weights, of_hidden, outputs.at(level))
        if reach_of_outputs(quantized.network).fits:
            return quantized
    return _rounded(parts, weights, of_hidden, outputs.at(0))


class ScaledNeurons:
    """Neurons (n,) and how their incoming ``weights`` (sources, n) can be scaled.

    - ``wanted`` (n,): the scale at level 0
    - ``most`` (n,): the scale beyond which a threshold or a bias would leave its 16 bits
    """

    def __init__(self, neurons: XyloNeurons, weights: FloatArray) -> None:
        self.neurons = neurons
        self.gain = gain_of(neurons)
        largest = np.abs(weights).max(axis=0, initial=0.0)
        held = np.maximum(neurons.threshold, np.abs(neurons.bias))
        # Neurons that hear nothing have no weights to keep exact.
        self.wanted = xylo.WEIGHT_MAX / np.where(largest > 0, largest, held / self.gain)
        # One unit is left for a threshold that must be passed.
        self.most = (xylo.STATE_MAX - 1) * self.gain / held

    def at(self, level: int) -> XyloScales:
        """Return the scales of a level."""
        current = np.minimum(self.wanted * 2.0**level, self.most)
        return XyloScales(current=current, potential=current / self.gain, level=level)

    @property
    def most_level(self) -> int:
        """The highest level that costs no neuron a bit of its weights: thresholds still fit."""
        octaves = math.log2(float(np.min(self.most / self.wanted)))
        return max(0, math.floor(octaves))


def float_weights(parts: XyloParts) -> FloatWeights:
    """Add up the projections of a network by the group of synapses that they become."""
    weights: FloatWeights = no_weights(parts, np.float64)
    for projection in parts.network.projections:
        dense = np.asarray(projection.held @ np.eye(projection.held.shape[1])).T
        add_weights(weights, parts, projection, dense)
    return weights


def gain_of(neurons: XyloNeurons) -> FloatArray:
    """Return the peak of each float neuron's response to a spike over the chip's, (n,)."""
    dash_syn = xylo_inverse.nearest_dash(neurons.decay_u)
    dash_mem = xylo_inverse.nearest_dash(neurons.decay_v)
    columns = zip(
        neurons.decay_u.tolist(),
        neurons.decay_v.tolist(),
        dash_syn.tolist(),
        dash_mem.tolist(),
        strict=True,
    )
    return np.array([_gain(*column) for column in columns])


@lru_cache(maxsize=4096)
def _gain(decay_u: float, decay_v: float, dash_syn: int, dash_mem: int) -> float:
    if dash_syn == 0:  # hears nothing: its current stays 0 on both sides
        return 1.0
    return float_peak(decay_u, decay_v) / xylo_inverse.peak_response(dash_syn, dash_mem)


def float_peak(decay_u: float, decay_v: float) -> float:
    """Return the highest potential of a float neuron after a charge of 1 at rest.

    i(0) = 1, i(t) = (1 - decay_u) i(t - 1);  v(t) = (1 - decay_v) v(t - 1) + i(t)
    """
    kept_i = 1.0 - decay_u
    kept_v = 1.0 - decay_v
    t = np.arange(_PEAK_STEPS, dtype=np.float64)
    if math.isclose(kept_i, kept_v, rel_tol=1e-9):
        v = (t + 1) * kept_i**t
    else:
        v = (kept_i ** (t + 1) - kept_v ** (t + 1)) / (kept_i - kept_v)
    return float(v.max())


def _rounded(
    parts: XyloParts, weights: FloatWeights, of_hidden: XyloScales, of_outputs: XyloScales
) -> QuantizedXylo:
    hidden = _population(neurons_of(parts.hidden), of_hidden)
    outputs = _population(neurons_of((parts.outputs,)), of_outputs)
    into_hidden = _integers(weights.into_hidden * of_hidden.current)
    among_hidden = _integers(weights.among_hidden * of_hidden.current)
    into_outputs = _integers(weights.into_outputs * of_outputs.current)
    network = XyloNetwork(
        hidden=hidden,
        outputs=outputs,
        weights_in=into_hidden.mantissas[:, :, None],
        weights_hidden=among_hidden.mantissas[:, :, None],
        weights_out=into_outputs.mantissas,
        shift_in=into_hidden.shift,
        shift_hidden=among_hidden.shift,
        shift_out=into_outputs.shift,
    )
    return QuantizedXylo(parts, network, of_hidden, of_outputs)


def _population(neurons: XyloNeurons, scales: XyloScales) -> XyloPopulation:
    threshold = neurons.threshold * scales.potential
    passed = np.where(neurons.strict, np.floor(threshold) + 1, np.ceil(threshold))
    dash_syn = xylo_inverse.nearest_dash(neurons.decay_u)
    dash_mem = xylo_inverse.nearest_dash(neurons.decay_v)
    given_away = _REST_SHARE * passed * xylo.share_lost(dash_mem)
    drift = np.minimum(xylo_inverse.rounding_drift(dash_syn, dash_mem), given_away)
    bias = neurons.bias * scales.potential - drift
    return XyloPopulation(
        dash_syn=dash_syn[:, None],
        dash_mem=dash_mem,
        threshold=passed.astype(np.int64),
        bias=np.rint(bias).astype(np.int64),
    )


class Shifted(NamedTuple):
    """Weights of a group of synapses: ``mantissas << shift``."""

    mantissas: IntArray
    shift: int


def _integers(scaled: FloatArray) -> Shifted:
    """Round weights in units of the registers to 8 bits, by the least shift that holds them."""
    largest = float(np.abs(scaled).max(initial=0.0))
    octaves = math.log2(max(largest, 1.0) / xylo.WEIGHT_MAX)
    # A scale was made to fit its largest weight; floats must not cost a bit.
    shift = max(0, math.ceil(octaves - _ROUNDING))
    mantissas = np.rint(scaled / 2.0**shift)
    clipped = np.clip(mantissas, -xylo.WEIGHT_MAX, xylo.WEIGHT_MAX)
    return Shifted(clipped.astype(np.int64), shift)
