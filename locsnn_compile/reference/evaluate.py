"""The reference: a network evaluated with numpy alone, float neurons in float64, on-grid ones in int64.

Populations that feed each other in a circle are stepped together; all others one after the other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import networkx as nx
import numpy as np
import numpy.typing as npt

import hw_model as hw
from hw_model.description.chip import Registers
from hw_model.engine.trace import ByteArray
from locsnn_compile.network.chip_neurons import ChipCuba, ChipProjection, ChipSrm
from locsnn_compile.network.matrices import Matrix, charge, values_of, with_values
from locsnn_compile.network.network import Network, Population, Projection
from locsnn_compile.network.neurons import Cuba, FloatArray, SoftCuba, SrmAlpha
from locsnn_compile.reference.float_neurons import CubaSteps, SoftCubaSteps, SrmSteps
from locsnn_compile.reference.integer_neurons import ChipCubaSteps, ChipSrmSteps, effective_weights

Potentials = npt.NDArray[Any]
"""float64 of float neurons; of on-grid ones int64, in units of the registers."""


@dataclass(frozen=True, eq=False)
class ReferenceResult:
    """``spikes[name]`` (batch, steps, n) for views and populations; ``potential[name]`` likewise, if asked for."""

    spikes: dict[str, ByteArray]
    potential: dict[str, Potentials]
    scores: FloatArray
    """Class scores (batch, classes)."""

    @property
    def prediction(self) -> npt.NDArray[np.int64]:
        """Class with the highest score, the first of equals, (batch,)."""
        return np.asarray(self.scores.argmax(axis=1), dtype=np.int64)


def decided(scores: FloatArray) -> npt.NDArray[np.int64]:
    """Return the class with the highest score, the first of equals; -1 where all scores (..., classes) tie."""
    tied = (scores == scores[..., :1]).all(axis=-1)
    return np.where(tied, -1, scores.argmax(axis=-1))


class NeuronSteps(Protocol):
    """The state of a population's neurons, (batch, n)."""

    def step(self, arriving: Any) -> tuple[npt.NDArray[np.bool_], Potentials]:
        """Take the weights that arrive; return spikes and the potential that decided them."""


def evaluate(
    network: Network, recordings: ByteArray, *, potentials: bool = False, registers: Registers | None = None
) -> ReferenceResult:
    """Evaluate recordings (batch, steps, channels), of the network's own steps and channels.

    ``registers`` are those that on-grid populations wrap and clip in, by default those of ``loihi-sim``.
    """
    registers = registers or hw.chip("loihi-sim").registers
    spikes: dict[str, ByteArray] = {view.name: view.play(recordings) for view in network.views}
    potential: dict[str, Potentials] = {}
    for together in evaluation_order(network):
        _evaluate_together(network, together, spikes, potential if potentials else None, registers)
    read: dict[str, Potentials] = {}
    if network.readout.potentials_from is not None:
        for population in network.populations:
            if population.name in network.readout.populations:
                _evaluate_together(network, (population,), dict(spikes), read, registers)
    return ReferenceResult(spikes, potential, network.readout.scores(spikes, read))


def evaluation_order(network: Network) -> list[tuple[Population, ...]]:
    """Return the populations, sources first; those in a circle of projections together, in network order."""
    graph = nx.DiGraph()
    graph.add_nodes_from(population.name for population in network.populations)
    graph.add_edges_from((p.source, p.target) for p in network.projections if p.source in graph)
    circles = list(nx.strongly_connected_components(graph))
    rank = {name: i for i, members in enumerate(circles) for name in members}
    order = nx.DiGraph()
    order.add_nodes_from(range(len(circles)))
    order.add_edges_from((rank[a], rank[b]) for a, b in graph.edges if rank[a] != rank[b])
    return [
        tuple(p for p in network.populations if p.name in circles[i])
        for i in nx.lexicographical_topological_sort(order, key=lambda i: _first(network, circles[i]))
    ]


def _first(network: Network, names: Iterable[str]) -> int:
    return min(i for i, population in enumerate(network.populations) if population.name in names)


def _evaluate_together(
    network: Network,
    together: tuple[Population, ...],
    spikes: dict[str, ByteArray],
    potential: dict[str, Potentials] | None,
    registers: Registers,
) -> None:
    """Step populations that depend on each other; add their spikes, and potentials where they are wanted."""
    batch = len(next(iter(spikes.values())))
    steps = next(spikes[view.name].shape[1] for view in network.views if view.axis == together[0].axis)
    names = {population.name for population in together}
    arriving: dict[str, Potentials] = {}
    inner: list[tuple[str, Potentials, int, Matrix]] = []
    for population in together:
        dtype = np.int64 if population.on_grid else np.float64
        dendrites = population.neuron.dendrites if isinstance(population.neuron, ChipSrm) else 1
        arriving[population.name] = np.zeros((batch, steps, dendrites * population.size), dtype=dtype)
        for projection in network.into(population.name):
            first = population.size * (projection.dendrite if isinstance(projection, ChipProjection) else 0)
            entrance = arriving[population.name][:, :, first : first + population.size]
            for delay, weights in _by_delay(projection):
                if projection.source in names:
                    inner.append((projection.source, entrance, delay, weights))
                elif delay + 1 < steps:
                    sent = charge(spikes[projection.source], weights)
                    entrance[:, delay + 1 :] += sent[:, : steps - delay - 1]
    state = {p.name: _steps(p, registers, batch) for p in together}
    for p in together:
        spikes[p.name] = np.zeros((batch, steps, p.size), dtype=np.uint8)
        if potential is not None:
            potential[p.name] = np.empty((batch, steps, p.size), dtype=arriving[p.name].dtype)
    for step in range(steps):
        for source, entrance, delay, weights in inner:
            if step > delay:
                entrance[:, step] += charge(spikes[source][:, step - 1 - delay], weights)
        for name in arriving:
            fired, seen = state[name].step(arriving[name][:, step])
            spikes[name][:, step] = fired
            if potential is not None:
                potential[name][:, step] = seen


def _by_delay(projection: Projection | ChipProjection) -> list[tuple[int, Matrix]]:
    """Return a projection's weights in parts of one delay each; integers as effective weights."""
    weights = effective_weights(projection) if isinstance(projection, ChipProjection) else projection.weights
    delay = np.asarray(projection.delay)
    if delay.ndim == 0:
        return [(int(delay), weights)]
    values = values_of(weights)
    return [(int(d), with_values(weights, np.where(delay == d, values, 0))) for d in np.unique(delay)]


def _steps(population: Population, registers: Registers, batch: int) -> NeuronSteps:
    neuron = population.neuron
    if isinstance(neuron, SrmAlpha):
        return SrmSteps(neuron, batch, population.size)
    if isinstance(neuron, Cuba):
        return CubaSteps(neuron, batch, population.size)
    if isinstance(neuron, SoftCuba):
        return SoftCubaSteps(neuron, batch, population.size)
    if isinstance(neuron, ChipCuba):
        return ChipCubaSteps(neuron, registers, batch)
    return ChipSrmSteps(neuron, registers, batch)
