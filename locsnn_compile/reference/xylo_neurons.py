"""Neurons of a Xylo in int64, for a batch of recordings: the step of :mod:`hw_model.arithmetic.xylo`.

Spikes of one step act in the next one. A neuron can spike several times per step, so spikes are numbers, not 0 and 1.
"""

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from hw_model.arithmetic import xylo
from hw_model.values import AnyArray, ByteArray, IntArray
from locsnn_compile.network.network import Network, Population
from locsnn_compile.network.projections import ChipProjection, Matrix
from locsnn_compile.network.xylo_neurons import XyloNeuron


class XyloSteps:
    """The state of a population's neurons, (batch, n), and the charges of the spikes onto them."""

    def __init__(
        self, neuron: XyloNeuron, incoming: Sequence[ChipProjection], batch: int, size: int
    ) -> None:
        self._parameters = xylo.Parameters(
            dash_syn=neuron.dash_syn,
            dash_mem=neuron.dash_mem,
            threshold=neuron.threshold,
            bias=None,
        )
        self._most_spikes = neuron.most_spikes
        self._incoming = [(projection.source, charges_of(projection)) for projection in incoming]
        self._i = np.zeros((batch, size), dtype=np.int64)
        self._v = np.zeros((batch, size), dtype=np.int64)

    def collect(self, sent: dict[str, IntArray]) -> None:
        """Add the charges of the spikes (batch, sources) of the step before to the currents, source by source."""
        for source, charges in self._incoming:
            self._i = collected(self._i, sent[source], charges)

    def step(self) -> tuple[IntArray, IntArray]:
        """Return the numbers of spikes, and the potentials that caused them, (batch, n)."""
        p = self._parameters
        self._i = xylo.decayed(self._i, p.dash_syn)
        change = xylo.saturate(xylo.change_of(self._v, p.dash_mem, self._i))
        potential = xylo.saturate(self._v + change)
        spikes, self._v = xylo.fire(potential, p.threshold, self._most_spikes)
        return spikes, potential


def charges_of(projection: ChipProjection) -> IntArray:
    """Return what a spike of each source adds to a current, (sources, n)."""
    return xylo.charge_of(dense(projection.mantissa).T, projection.exponent)


def collected(i: IntArray, spikes: IntArray, charges: IntArray) -> IntArray:
    """Return currents (batch, n) after the charges (sources, n) of ``spikes`` (batch, sources) have been added.

    A Xylo adds spike by spike, and each addition saturates. The order matters only if an addition saturates, which
    cannot happen if the sums of all positive and of all negative charges fit the register. So only recordings in which
    they do not fit are added spike by spike, which is slow.
    """
    highest = i + spikes @ np.maximum(charges, 0)
    lowest = i + spikes @ np.minimum(charges, 0)
    result = i + spikes @ charges
    fits = (highest <= xylo.STATE_MAX) & (lowest >= xylo.STATE_MIN)
    for row in np.flatnonzero(~fits.all(axis=1)):
        currents, _ = xylo.collect(i[row, :, None], spikes[row], charges[:, :, None])
        result[row] = currents[:, 0]
    return result


def evaluate_xylo(
    network: Network, together: Sequence[Population], spikes: dict[str, ByteArray]
) -> dict[str, AnyArray]:
    """Step all populations of a circle together; add their ``spikes``, and return their potentials."""
    batch, steps, _ = spikes[network.views[0].name].shape
    neurons: dict[str, XyloSteps] = {}
    potential: dict[str, AnyArray] = {}
    for population in together:
        neuron = population.neuron
        assert isinstance(neuron, XyloNeuron)
        incoming = _in_order(network, population)
        neurons[population.name] = XyloSteps(neuron, incoming, batch, population.size)
        shape = (batch, steps, population.size)
        spikes[population.name] = np.zeros(shape, dtype=np.uint8)
        potential[population.name] = np.zeros(shape, dtype=np.int64)
    for step in range(steps):
        if step > 0:
            sent = {name: sources[:, step - 1].astype(np.int64) for name, sources in spikes.items()}
            for steps_of_population in neurons.values():
                steps_of_population.collect(sent)
        for name, steps_of_population in neurons.items():
            spikes[name][:, step], potential[name][:, step] = steps_of_population.step()
    return potential


def _in_order(network: Network, population: Population) -> list[ChipProjection]:
    """Return the projections onto a population in the order in which a Xylo adds their charges: inputs first."""
    order = [view.name for view in network.views]
    order += [source.name for source in network.populations]
    onto = [p for p in network.into(population.name) if isinstance(p, ChipProjection)]
    return sorted(onto, key=lambda projection: order.index(projection.source))


def dense(m: Matrix) -> IntArray:
    """Return a matrix of integers as an array."""
    array: IntArray = m.toarray() if sparse.issparse(m) else np.asarray(m)
    return array
