"""The plain engine of SpiNNaker: slow, obvious, and the standard that the compiled engine has to equal.

:mod:`hw_model.arithmetic.spinnaker` says what a neuron computes in a step. This module says in which order populations
are updated and spikes are processed: every step updates all populations, then processes the spikes, which add weights
to the ring buffers of later steps.
"""

from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import spinnaker
from hw_model.arithmetic.spinnaker import State, Step
from hw_model.errors import InputError
from hw_model.spinnaker.network import RECEPTORS, SpinnakerNetwork, SpinnakerPopulation
from hw_model.values import AnyArray, ByteArray, IntArray, Shown


class SpinnakerResult(Shown):
    """What the n neurons of a phase did in T steps, one population after the other.

    - ``spikes`` (T, n): 0 or 1
    - ``potential`` (T, n): V as it is compared with the threshold
    - ``v`` (T, n), ``current`` (T, n, receptors), ``refractory`` (T, n): registers after each step. (A board records V
      as it is before the step.)
    - ``events``: how often each of :data:`hw_model.arithmetic.spinnaker.EVENTS`, such as a wrap, happened
    """

    spikes: ByteArray
    potential: IntArray
    v: IntArray
    current: IntArray
    refractory: IntArray
    events: dict[str, int]


class PhaseRows(NamedTuple):
    """The input of T steps.

    - ``spikes`` (T, lines): 0 or 1
    - ``lateness`` (T, lines + n): by how many steps, 0..15, cores are late to process the spike that each source sends
      in each step; None if they are never late
    """

    spikes: ByteArray
    lateness: IntArray | None


class Synapse(NamedTuple):
    """A synapse of a source, onto a ``neuron`` of the population with index ``target`` in the phase."""

    target: int
    neuron: int
    receptor: int
    weight: int
    delay: int


def play_reference(
    network: SpinnakerNetwork, phase: str, spikes: AnyArray, lateness: AnyArray | None = None
) -> SpinnakerResult:
    """Play rows to a phase from rest; the arguments are those of :class:`PhaseRows`."""
    rows = checked_rows(network, phase, spikes, lateness)
    run = _Run(network, phase)
    result = empty_result(network, phase, len(rows.spikes), run.events)
    late_steps = rows.lateness
    if late_steps is None:
        sources = network.lines_of(phase) + network.neurons_of(phase)
        late_steps = np.zeros((len(rows.spikes), sources), dtype=np.int64)
    for t, row in enumerate(rows.spikes):
        # Neurons are updated before the spikes of this step are processed, so even a spike with the shortest delay
        # acts in the next step.
        steps = run.step(t)
        result.spikes[t] = np.concatenate([step.fired for step in steps])
        result.potential[t] = np.concatenate([step.potential for step in steps])
        result.v[t] = np.concatenate([step.state.v for step in steps])
        result.current[t] = np.concatenate([step.state.current for step in steps])
        result.refractory[t] = np.concatenate([step.state.refractory for step in steps])
        sent = np.concatenate([row, result.spikes[t]])
        run.send(t, sent, late_steps[t])
        run.deliver(t)
    return result


def checked_rows(
    network: SpinnakerNetwork, phase: str, spikes: AnyArray, lateness: AnyArray | None
) -> PhaseRows:
    """Return rows as integers; raise ``InputError`` for anything that :class:`PhaseRows` may not have."""
    rows = np.asarray(spikes)
    lines = network.lines_of(phase)
    has_the_lines = rows.ndim == 2 and rows.shape[1] == lines
    if not has_the_lines or not np.isin(rows, (0, 1)).all():
        measured = f"{rows.shape} against (rows, {lines})"
        fix = "Give a row of 0 and 1 for each step."
        raise InputError("input spikes", "they do not fit the lines", measured=measured, fix=fix)
    if lateness is None:
        return PhaseRows(rows.astype(np.uint8), lateness=None)
    late_steps = np.asarray(lateness)
    shape = (len(rows), lines + network.neurons_of(phase))
    in_range = (late_steps >= 0) & (late_steps <= spinnaker.LATENESS_MAX)
    if late_steps.shape != shape or not in_range.all():
        measured = f"{late_steps.shape} against {shape}"
        fix = f"Give 0..{spinnaker.LATENESS_MAX} for each source and step."
        raise InputError("lateness", "it does not fit the sources", measured=measured, fix=fix)
    return PhaseRows(rows.astype(np.uint8), late_steps.astype(np.int64))


def empty_result(
    network: SpinnakerNetwork, phase: str, rows: int, events: dict[str, int]
) -> SpinnakerResult:
    """Return a result with arrays of zeros for this number of rows."""
    neurons = network.neurons_of(phase)
    return SpinnakerResult(
        spikes=np.zeros((rows, neurons), dtype=np.uint8),
        potential=np.zeros((rows, neurons), dtype=np.int64),
        v=np.zeros((rows, neurons), dtype=np.int64),
        current=np.zeros((rows, neurons, spinnaker.RECEPTOR_COUNT), dtype=np.int64),
        refractory=np.zeros((rows, neurons), dtype=np.int64),
        events=events,
    )


class _Run:
    """The state of a phase: its neurons, and the spikes that wait for a core to process them."""

    def __init__(self, network: SpinnakerNetwork, phase: str) -> None:
        self.populations = [_Neurons(item) for item in network.populations_of(phase)]
        self.synapses = synapses_by_source(network, phase)
        # waiting[t] lists the spikes that are processed in step t, each as the step that sent it and its source.
        self.waiting: dict[int, list[tuple[int, int]]] = {}
        self.events = dict.fromkeys(spinnaker.EVENTS, 0)

    def step(self, t: int) -> list[Step]:
        """Run step t of every population."""
        steps = [population.step(t) for population in self.populations]
        for step in steps:
            for name, count in step.wraps.items():
                self.events[name] += count
        return steps

    def send(self, t: int, sent: IntArray, lateness: IntArray) -> None:
        """Queue the spikes (sources,) of step t for the steps in which they are processed."""
        for source in np.flatnonzero(sent).tolist():
            processed_step = t + int(lateness[source])
            self.waiting.setdefault(processed_step, []).append((t, source))

    def deliver(self, t: int) -> None:
        """Process the spikes that are queued for step t; those that were sent earlier come first."""
        for sent, source in self.waiting.pop(t, []):
            for synapse in self.synapses[source]:
                population = self.populations[synapse.target]
                self._add(population, synapse, sent, lateness=t - sent)

    def _add(self, neurons: "_Neurons", synapse: Synapse, sent: int, lateness: int) -> None:
        """Add the weight of a synapse to the slot of the step in which it is due, unless that step has begun."""
        slots = neurons.population.slots
        if spinnaker.comes_too_late(lateness, synapse.delay, slots):
            self.events["late_synapses"] += 1
            return
        slot = spinnaker.slot_of(sent, synapse.delay, slots)
        entry = (slot, synapse.neuron, synapse.receptor)
        before = int(neurons.ring[entry])
        after = spinnaker.collected(before, synapse.weight)
        neurons.ring[entry] = after
        if after != before + synapse.weight:
            self.events["saturated_weights"] += 1


class _Neurons:
    """The registers of a population; the ring buffers of its cores are one array (slots, neurons, receptors)."""

    def __init__(self, population: SpinnakerPopulation) -> None:
        size = population.size
        self.population = population
        self.shifts = np.array(population.shifts)
        self.ring = np.zeros((population.slots, size, spinnaker.RECEPTOR_COUNT), dtype=np.int64)
        self.state = State(
            v=population.parameters.v_init.copy(),
            current=np.zeros((size, spinnaker.RECEPTOR_COUNT), dtype=np.int64),
            refractory=np.zeros(size, dtype=np.int64),
        )

    def step(self, t: int) -> Step:
        """Run step t, with the weights that the slot of this step holds, and clear the slot."""
        population = self.population
        slot = self.ring[t % population.slots]
        step = spinnaker.step(
            population.parameters, population.constants, self.shifts, self.state, slot
        )
        # `slot` is a view, so this clears the ring buffer.
        slot[:] = 0
        self.state = step.state
        return step


def synapses_by_source(network: SpinnakerNetwork, phase: str) -> list[list[Synapse]]:
    """Return the synapses of every source of a phase, lines first; those of one source are in the order they act."""
    first_source = network.sources_of(phase)
    targets = [population.name for population in network.populations_of(phase)]
    neurons = network.neurons_of(phase)
    synapses: list[list[Synapse]] = [[] for _ in range(network.lines_of(phase) + neurons)]
    for projection in network.projections_of(phase):
        target = targets.index(projection.target)
        receptor = RECEPTORS.index(projection.receptor)
        for source, neuron, weight, delay in zip(
            (first_source[projection.source] + projection.source_index).tolist(),
            projection.target_index.tolist(),
            projection.weight.tolist(),
            projection.delay.tolist(),
            strict=True,
        ):
            synapses[source].append(Synapse(target, neuron, receptor, weight, delay))
    return synapses
