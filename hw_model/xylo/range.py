"""Bound in closed form how far the registers of a network can get.

The compiler uses the bounds to choose weights with which no register saturates (:mod:`locsnn_compile.xylo.quantize`).
"""

import numpy as np

from hw_model.arithmetic import xylo, xylo_inverse
from hw_model.values import FloatArray, Frozen, IntArray
from hw_model.xylo.network import XyloNetwork, XyloPopulation


class Reach(Frozen, eq=False):
    """The largest values that the registers of n neurons can reach, arrays (n,).

    ``current`` is the largest magnitude of any of a neuron's currents, before it decays. ``potential`` is the highest
    potential, as it is compared with the threshold. There is no bound downwards: no reset stops a falling potential,
    only its leak, so such a bound would be too low to be of use.

    The bounds hold as long as every source sends at most one spike per row. A hidden neuron may send up to 31, and an
    input line may count up to 15; if something saturates then, it is counted when the program is played.
    """

    current: FloatArray
    potential: FloatArray

    @property
    def fits(self) -> bool:
        """Whether no current can saturate, and no potential at its upper end."""
        largest_current = self.current.max(initial=0.0)
        highest_potential = self.potential.max(initial=0.0)
        return bool(max(largest_current, highest_potential) <= xylo.STATE_MAX)


def reach_of_hidden(network: XyloNetwork) -> Reach:
    """Return the bounds of all hidden neurons, whose sources are inputs and hidden neurons."""
    charges_of_inputs = xylo.charge_of(network.weights_in, network.shift_in)
    charges_of_hidden = xylo.charge_of(network.weights_hidden, network.shift_hidden)
    return _reach(network.hidden, np.concatenate([charges_of_inputs, charges_of_hidden]))


def reach_of_outputs(network: XyloNetwork) -> Reach:
    """Return the bounds of all outputs, whose sources are hidden neurons."""
    # An output has one current, so the axis of currents is added with length 1.
    charges_of_hidden = xylo.charge_of(network.weights_out[:, :, None], network.shift_out)
    return _reach(network.outputs, charges_of_hidden)


def _reach(population: XyloPopulation, charges: IntArray) -> Reach:
    """Return the bounds of neurons that get ``charges`` (sources, n, currents), one row per source."""
    # In the worst case, only positive or only negative charges arrive.
    positive_sums = np.maximum(charges, 0).sum(axis=0)
    negative_sums = np.maximum(-charges, 0).sum(axis=0)
    highest_current = _largest_currents(positive_sums, population.dash_syn)
    lowest_current = _largest_currents(negative_sums, population.dash_syn)
    largest_current = np.maximum(highest_current, lowest_current)
    # A negative bias does not raise the potential.
    bias = 0 if population.bias is None else np.maximum(population.bias, 0)
    # After its spikes, a potential is below the threshold. A row then adds each current and the bias once.
    potential = population.threshold + highest_current.sum(axis=1) + bias
    return Reach(
        current=largest_current.max(axis=1),
        potential=potential.astype(np.float64),
    )


def _largest_currents(charges: IntArray, dash_syn: IntArray) -> FloatArray:
    """Return the bound of each current, (n, currents), given the charge that arrives per row; 0 if none arrives."""
    return np.where(charges > 0, xylo_inverse.largest_current(charges, dash_syn), 0.0)
