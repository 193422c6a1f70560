"""The reference: a network evaluated with numpy only, float neurons in float64, on-grid neurons in int64.

Populations that feed each other in a circle are stepped together, all others one after the other. Weights and scales
are chosen for what the float network does on calibration recordings. The steps of each neuron model are in
``float_neurons`` and, for neurons on the grid, in ``integer_neurons``; those of a Xylo in ``xylo_neurons``.
"""

from collections.abc import Mapping
from functools import singledispatch
from typing import Any, NamedTuple, Protocol

import numpy as np

import hw_model as hw
from hw_model.description.chip import Registers
from hw_model.mapping.circles import sources_first
from hw_model.mapping.graph import winning
from hw_model.values import AnyArray, BoolArray, ByteArray, FloatArray, Frozen, IntArray
from locsnn_compile.data.recordings import Recordings, batches
from locsnn_compile.errors import InputError
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm, HostCuba
from locsnn_compile.network.network import Network, Population
from locsnn_compile.network.neurons import Cuba, Neuron, SoftCuba, SrmAlpha
from locsnn_compile.network.projections import ChipProjection, Matrix, by_delay, charge
from locsnn_compile.network.xylo_neurons import XyloNeuron
from locsnn_compile.reference.float_neurons import CubaSteps, SoftCubaSteps, SrmSteps
from locsnn_compile.reference.integer_neurons import (
    ChipCubaSteps,
    ChipSrmSteps,
    HostCubaSteps,
    effective_weights,
)
from locsnn_compile.reference.xylo_neurons import evaluate_xylo


class NeuronSteps(Protocol):
    """The state of a population's neurons, (batch, n)."""

    def step(self, arriving: Any) -> tuple[BoolArray, AnyArray]:
        """Take the weights that arrive; return the spikes, and the potential that decided them."""


@singledispatch
def steps_of(
    neuron: Neuron, batch: int, size: int, registers: Registers | None = None
) -> NeuronSteps:
    """Return neurons at rest, as registered for their model; on-grid neurons wrap and clip in ``registers``."""
    fix = "Register its state with locsnn_compile.reference.evaluate.steps_of."
    raise InputError(f"neuron {type(neuron).__name__}", "nothing says how it steps", fix=fix)


steps_of.register(SrmAlpha, SrmSteps)
steps_of.register(Cuba, CubaSteps)
steps_of.register(SoftCuba, SoftCubaSteps)
steps_of.register(ChipCuba, ChipCubaSteps)
steps_of.register(HostCuba, HostCubaSteps)
steps_of.register(ChipSrm, ChipSrmSteps)


Potentials = AnyArray
"""float64 for float neurons; int64 for on-grid neurons, in units of the registers."""


class ReferenceResult(Frozen, eq=False):
    """``spikes[name]`` (batch, steps, n) of views and populations, and their ``potential[name]``, if asked for."""

    spikes: dict[str, ByteArray]
    potential: dict[str, Potentials]
    scores: FloatArray
    """Class scores (batch, classes)."""
    tie_class: int | None = None
    """The class that is predicted where all scores tie; None: the network names none."""

    @property
    def prediction(self) -> IntArray:
        """Class with the highest score, the first of equals, (batch,)."""
        return winning(self.scores, self.tie_class)


def evaluate(
    network: Network,
    recordings: AnyArray,
    *,
    potentials: bool = False,
    registers: Registers | None = None,
) -> ReferenceResult:
    """Evaluate recordings (batch, steps, channels) with the network's own steps and channels.

    For layers on the host, they hold numbers in float64 in place of spikes.
    On-grid populations wrap and clip in ``registers``, by default those of ``loihi-sim``.
    """
    registers = registers or hw.chip("loihi-sim").registers
    spikes: dict[str, ByteArray] = {view.name: view.play(recordings) for view in network.views}
    wanted = {p.name for p in network.populations} if potentials else set(network.readout.from_step)
    potential: dict[str, Potentials] = {}
    for together in evaluation_order(network):
        if isinstance(together[0].neuron, XyloNeuron):
            potential |= evaluate_xylo(network, together, spikes)
            continue
        _evaluate_together(network, together, spikes, potential, wanted, registers)
    scores = network.readout.scores(spikes, potential)
    tie_class = network.readout.tie_class
    return ReferenceResult(spikes, potential if potentials else {}, scores, tie_class)


def evaluation_order(network: Network) -> list[tuple[Population, ...]]:
    """Return the populations, sources first; populations in a circle are together, in network order."""
    number = {population.name: i for i, population in enumerate(network.populations)}
    edges = [
        (number[p.source], number[p.target]) for p in network.projections if p.source in number
    ]
    return [
        tuple(network.populations[i] for i in circle)
        for circle in sources_first(len(number), edges)
    ]


class _Within(NamedTuple):
    """A projection between populations that are stepped together; ``entrance`` (batch, steps, n) is what it adds to."""

    source: str
    entrance: Potentials
    delay: int
    weights: Matrix


def _evaluate_together(
    network: Network,
    together: tuple[Population, ...],
    spikes: dict[str, ByteArray],
    potential: dict[str, Potentials],
    wanted: set[str],
    registers: Registers,
) -> None:
    """Step populations that depend on each other; add their spikes, and the potentials of those in ``wanted``."""
    batch = len(next(iter(spikes.values())))
    steps = next(
        spikes[view.name].shape[1] for view in network.views if view.phase == together[0].phase
    )
    names = {population.name for population in together}
    arriving: dict[str, Potentials] = {}
    within: list[_Within] = []
    for population in together:
        dtype = np.int64 if population.on_grid else np.float64
        entrances = population.neuron.dendrites * population.size
        arriving[population.name] = np.zeros((batch, steps, entrances), dtype=dtype)
        within += _take_charges(network, population, names, spikes, arriving[population.name])
    state = {p.name: steps_of(p.neuron, batch, p.size, registers) for p in together}
    for p in together:
        spikes[p.name] = np.zeros((batch, steps, p.size), dtype=np.uint8)
        if p.name in wanted:
            potential[p.name] = np.empty((batch, steps, p.size), dtype=arriving[p.name].dtype)
    for step in range(steps):
        for source, entrance, delay, weights in within:
            if step > delay:
                entrance[:, step] += charge(spikes[source][:, step - 1 - delay], weights)
        for name in arriving:
            fired, seen = state[name].step(arriving[name][:, step])
            spikes[name][:, step] = fired
            if name in wanted:
                potential[name][:, step] = seen


def _take_charges(
    network: Network,
    population: Population,
    together: set[str],
    spikes: Mapping[str, ByteArray],
    arriving: Potentials,
) -> list[_Within]:
    """Add what known spikes send to a population to ``arriving`` (batch, steps, dendrites * n), and return the rest.

    Projections of populations that are stepped ``together`` with it are left: their spikes are not known yet.
    """
    steps = arriving.shape[1]
    within = []
    for projection in network.into(population.name):
        first = population.size * projection.dendrite
        entrance = arriving[:, :, first : first + population.size]
        whole = projection.held
        if isinstance(projection, ChipProjection):
            whole = effective_weights(projection)
        for delay, weights in by_delay(whole, projection.delay):
            if projection.source in together:
                within.append(_Within(projection.source, entrance, delay, weights))
            elif delay + 1 < steps:
                sent = charge(spikes[projection.source], weights)
                entrance[:, delay + 1 :] += sent[:, : steps - delay - 1]
    return within


def score_spread(network: Network, recordings: Recordings) -> float:
    """Return the mean standard deviation of class scores on recordings of its own steps and channels."""
    scores = evaluate(network, recordings.spikes).scores
    return float(scores.std(axis=1).mean())


SAMPLES = 256
"""Largest number of recordings that are used, evenly spaced: with more, agreement on others hardly improves."""


REMEMBERED_BITS = 1 << 31
"""Most spikes and silences that are kept: 256 MB."""


class FloatRuns:
    """What a float network does on recordings: it plays each batch once, and its spikes are kept as bits.

    Recordings (samples, steps, channels) have the network's own steps and channels. Where they have
    more than :data:`REMEMBERED_BITS` spikes and silences, nothing is kept, and they are played anew.
    """

    def __init__(self, network: Network, recordings: ByteArray, registers: Registers) -> None:
        self._network = network
        self._recordings = recordings
        self._registers = registers
        self._spikes: dict[int, dict[str, ByteArray]] = {}
        self._scores: dict[int, FloatArray] = {}
        lines = sum(view.lines * network.steps_of(view.phase) for view in network.views)
        neurons = sum(p.size * network.steps_of(p.phase) for p in network.populations)
        self._remembers = len(recordings) * (lines + neurons) <= REMEMBERED_BITS

    def batch(self, rows: slice) -> ReferenceResult:
        """Return what the network does on the recordings of a batch."""
        first = rows.start
        if first in self._spikes:
            return self._remembered(first)
        result = evaluate(self._network, self._recordings[rows], registers=self._registers)
        if self._remembers:
            self._spikes[first] = {
                name: np.packbits(spikes, axis=2) for name, spikes in result.spikes.items()
            }
            self._scores[first] = result.scores
        return result

    def _remembered(self, first: int) -> ReferenceResult:
        network = self._network
        width = {view.name: view.lines for view in network.views}
        width |= {population.name: population.size for population in network.populations}
        spikes = {
            name: np.unpackbits(bits, axis=2, count=width[name])
            for name, bits in self._spikes[first].items()
        }
        return ReferenceResult(spikes, {}, self._scores[first], network.readout.tie_class)


class Calibration(Frozen, eq=False):
    """``spikes[name]`` (samples, steps, n) of views and populations, and ``potential[name]`` of populations."""

    samples: int
    source: str
    spikes: Mapping[str, ByteArray]
    potential: Mapping[str, FloatArray]


def calibrate(network: Network, recordings: Recordings, registers: Registers) -> Calibration:
    """Evaluate the float network on at most :data:`SAMPLES` recordings of its own steps and channels."""
    count = len(recordings.spikes)
    chosen = np.unique(np.linspace(0, count - 1, min(count, SAMPLES)).astype(np.int64))
    played = recordings.spikes[chosen]
    results = [
        evaluate(network, played[rows], potentials=True, registers=registers)
        for rows in batches(len(played))
    ]
    spikes = {
        name: np.concatenate([result.spikes[name] for result in results])
        for name in results[0].spikes
    }
    potential = {
        name: np.concatenate([result.potential[name] for result in results])
        for name in results[0].potential
    }
    return Calibration(len(played), recordings.source, spikes, potential)
