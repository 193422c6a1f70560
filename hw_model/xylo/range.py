"""How far registers of a network can get, in closed form."""

import numpy as np

from hw_model.arithmetic import xylo, xylo_inverse
from hw_model.values import FloatArray, Frozen, IntArray
from hw_model.xylo.network import XyloNetwork, XyloPopulation


class Reach(Frozen, eq=False):
    """The largest magnitudes that neurons (n,) can reach while each source sends at most one spike in each row.

    Sources may send more: what then saturates is counted when the program is played. ``current`` is the largest of a
    neuron's currents, before it decays; ``potential`` is upwards, as the threshold sees it. A potential below 0 goes
    further down than is of use to know: nothing but its leak stops it.
    """

    current: FloatArray
    potential: FloatArray

    @property
    def fits(self) -> bool:
        """Whether no current, and no potential upwards, can saturate."""
        highest = max(self.current.max(initial=0.0), self.potential.max(initial=0.0))
        return bool(highest <= xylo.STATE_MAX)


def reach_of_hidden(network: XyloNetwork) -> Reach:
    """Return how far the registers of hidden neurons can get."""
    inputs = xylo.charge_of(network.weights_in, network.shift_in)
    spikes = xylo.charge_of(network.weights_hidden, network.shift_hidden)
    return _reach(network.hidden, np.concatenate([inputs, spikes]))


def reach_of_outputs(network: XyloNetwork) -> Reach:
    """Return how far the registers of outputs can get."""
    # Outputs have one current: the last axis is that of currents.
    spikes = xylo.charge_of(network.weights_out[:, :, None], network.shift_out)
    return _reach(network.outputs, spikes)


def _reach(population: XyloPopulation, charges: IntArray) -> Reach:
    """Return the reach of neurons onto which ``charges`` (sources, n, currents) fall."""
    upwards = np.maximum(charges, 0).sum(axis=0)
    downwards = np.maximum(-charges, 0).sum(axis=0)
    highest = _largest_currents(upwards, population.dash_syn)
    lowest = _largest_currents(downwards, population.dash_syn)
    bias = 0 if population.bias is None else np.maximum(population.bias, 0)
    # What is left after spikes lies below the threshold, and a row adds each current once.
    potential = population.threshold + highest.sum(axis=1) + bias
    return Reach(np.maximum(highest, lowest).max(axis=1), potential.astype(np.float64))


def _largest_currents(charges: IntArray, dash_syn: IntArray) -> FloatArray:
    """Return bounds (n, currents), 0 for a current onto which nothing falls."""
    return np.where(charges > 0, xylo_inverse.largest_current(charges, dash_syn), 0.0)
