"""The reference: a network evaluated with numpy only, float neurons in float64, on-grid neurons in int64.

:func:`evaluate` returns the spikes and class scores with which a program on the chip is compared. Populations that feed
each other in a circle are stepped together. All others are evaluated one after the other over all steps, sources first,
which is much faster. The steps of each neuron model are in ``float_neurons`` and, for neurons on the grid, in
``integer_neurons``; those of a Xylo are in ``xylo_neurons``.

:func:`calibrate` keeps what the float network does on calibration recordings, for which the passes choose weights and
scales.
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
        """Take the sum of the weights that arrive; return the spikes, and the potentials that caused them."""


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
    """What a network does on a batch of recordings.

    ``spikes[name]`` (batch, steps, n) are those of each view and population, ``potential[name]`` of the same shape the
    potentials of each population, if they were asked for.
    """

    spikes: dict[str, ByteArray]
    potential: dict[str, Potentials]
    scores: FloatArray
    """Class scores (batch, classes)."""
    tie_class: int | None = None
    """The class that is predicted if all scores tie; None if the network names no class for that."""

    @property
    def prediction(self) -> IntArray:
        """The class with the highest score, (batch,); the first of equal ones."""
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
    # Potentials take eight times the memory of spikes: without being asked, keep only those that the scores need.
    keep_potentials_of = set(network.readout.from_step)
    if potentials:
        keep_potentials_of = {population.name for population in network.populations}
    potential: dict[str, Potentials] = {}
    for circle in evaluation_order(network):
        if isinstance(circle[0].neuron, XyloNeuron):
            potential |= evaluate_xylo(network, circle, spikes)
            continue
        _evaluate_circle(network, circle, spikes, potential, keep_potentials_of, registers)
    scores = network.readout.scores(spikes, potential)
    tie_class = network.readout.tie_class
    return ReferenceResult(spikes, potential if potentials else {}, scores, tie_class)


def evaluation_order(network: Network) -> list[tuple[Population, ...]]:
    """Return the populations in circles, sources first; each circle in network order.

    Populations that feed each other, directly or through others, form a circle. Any other population is one by itself.
    """
    number = {population.name: i for i, population in enumerate(network.populations)}
    edges = [
        (number[p.source], number[p.target]) for p in network.projections if p.source in number
    ]
    return [
        tuple(network.populations[i] for i in circle)
        for circle in sources_first(len(number), edges)
    ]


class _Recurrent(NamedTuple):
    """A projection within a circle, whose charges are added step by step to ``arriving`` (batch, steps, n)."""

    source: str
    arriving: Potentials
    delay: int
    weights: Matrix


def _evaluate_circle(
    network: Network,
    circle: tuple[Population, ...],
    spikes: dict[str, ByteArray],
    potential: dict[str, Potentials],
    keep_potentials_of: set[str],
    registers: Registers,
) -> None:
    """Step the populations of a circle together; add their ``spikes``, and the potentials that are to be kept."""
    batch = len(next(iter(spikes.values())))
    # All populations of a circle are in one phase, whose steps its views have.
    steps = next(
        spikes[view.name].shape[1] for view in network.views if view.phase == circle[0].phase
    )
    names = {population.name for population in circle}
    arriving: dict[str, Potentials] = {}
    recurrent: list[_Recurrent] = []
    for population in circle:
        dtype = np.int64 if population.on_grid else np.float64
        targets = population.neuron.dendrites * population.size
        arriving[population.name] = np.zeros((batch, steps, targets), dtype=dtype)
        recurrent += _add_known_charges(
            network, population, names, spikes, arriving[population.name]
        )
    state = {p.name: steps_of(p.neuron, batch, p.size, registers) for p in circle}
    for p in circle:
        spikes[p.name] = np.zeros((batch, steps, p.size), dtype=np.uint8)
        if p.name in keep_potentials_of:
            potential[p.name] = np.empty((batch, steps, p.size), dtype=arriving[p.name].dtype)
    for step in range(steps):
        for source, arriving_at_target, delay, weights in recurrent:
            if step > delay:
                source_spikes = spikes[source][:, step - 1 - delay]
                arriving_at_target[:, step] += charge(source_spikes, weights)
        for name in arriving:
            fired, potential_of_step = state[name].step(arriving[name][:, step])
            spikes[name][:, step] = fired
            if name in keep_potentials_of:
                potential[name][:, step] = potential_of_step


def _add_known_charges(
    network: Network,
    population: Population,
    circle: set[str],
    spikes: Mapping[str, ByteArray],
    arriving: Potentials,
) -> list[_Recurrent]:
    """Add the charges of all spikes that are already known to ``arriving`` (batch, steps, dendrites * n).

    Return the projections from within the ``circle``, whose spikes are not yet known.
    """
    steps = arriving.shape[1]
    recurrent = []
    for projection in network.into(population.name):
        # The inputs of dendrite d are the d-th block of n.
        first = population.size * projection.dendrite
        at_dendrite = arriving[:, :, first : first + population.size]
        all_weights = projection.held
        if isinstance(projection, ChipProjection):
            all_weights = effective_weights(projection)
        for delay, weights in by_delay(all_weights, projection.delay):
            if projection.source in circle:
                recurrent.append(_Recurrent(projection.source, at_dendrite, delay, weights))
            elif delay + 1 < steps:
                # A spike of step t acts at step t + 1 + delay; the last ones act after the end.
                sent = charge(spikes[projection.source], weights)
                at_dendrite[:, delay + 1 :] += sent[:, : steps - delay - 1]
    return recurrent


def score_spread(network: Network, recordings: Recordings) -> float:
    """Return the mean standard deviation of class scores on recordings of its own steps and channels."""
    scores = evaluate(network, recordings.spikes).scores
    return float(scores.std(axis=1).mean())


SAMPLES = 256
"""Largest number of calibration recordings that are used, evenly spaced: with more, agreement on other recordings
hardly improves."""


REMEMBERED_BITS = 1 << 31
"""Largest number of bits, one per line or neuron and step, that are kept: 256 MB."""


class FloatRuns:
    """A cache of what a float network does on recordings, for comparing many settings of the chip with it.

    Each batch is evaluated once, and its spikes are kept as bits. Recordings (samples, steps, channels) have the
    network's own steps and channels. If their spikes would take more than :data:`REMEMBERED_BITS`, nothing is kept, and
    every batch is evaluated again.
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
        """Return the kept result of the batch that begins with recording ``first``, without potentials."""
        network = self._network
        width = {view.name: view.lines for view in network.views}
        width |= {population.name: population.size for population in network.populations}
        spikes = {
            name: np.unpackbits(bits, axis=2, count=width[name])
            for name, bits in self._spikes[first].items()
        }
        return ReferenceResult(spikes, {}, self._scores[first], network.readout.tie_class)


class Calibration(Frozen, eq=False):
    """What a float network does on calibration recordings, for which weights and scales are chosen.

    ``spikes[name]`` (samples, steps, n) are those of each view and population, ``potential[name]`` those of each
    population. ``source`` names the recordings.
    """

    samples: int
    source: str
    spikes: Mapping[str, ByteArray]
    potential: Mapping[str, FloatArray]


def calibrate(network: Network, recordings: Recordings, registers: Registers) -> Calibration:
    """Evaluate the float network on at most :data:`SAMPLES` recordings of its own steps and channels."""
    count = len(recordings.spikes)
    # Evenly spaced, because recordings of one class often follow each other.
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
