"""The plain engine of SpiNNaker: in which order populations and spikes take their turns in a step.

What a neuron does in its turn is said in :mod:`hw_model.arithmetic.spinnaker`. Slow and obvious.
"""

from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import spinnaker
from hw_model.arithmetic.spinnaker import State, Step
from hw_model.errors import InputError
from hw_model.spinnaker.network import RECEPTORS, SpinnakerNetwork, SpinnakerPopulation
from hw_model.values import AnyArray, ByteArray, IntArray, Shown


class SpinnakerResult(Shown):
    """What T rows do to the n neurons of a phase, population after population.

    ``spikes`` (T, n) are 0 or 1, ``potential`` (T, n) V as the threshold saw it; ``v`` (T, n),
    ``current`` (T, n, receptors) and ``refractory`` (T, n) are registers after each step. What a
    board records of V is that before the step. ``events`` counts what
    :data:`hw_model.arithmetic.spinnaker.EVENTS` names.
    """

    spikes: ByteArray
    potential: IntArray
    v: IntArray
    current: IntArray
    refractory: IntArray
    events: dict[str, int]


class PhaseRows(NamedTuple):
    """Spikes of input lines, and by how many steps a core is behind with those of each source.

    ``spikes`` (T, lines) are 0 or 1; ``lateness`` (T, lines + n), 0..15, or None where no core is
    ever behind.
    """

    spikes: ByteArray
    lateness: IntArray | None


class Synapse(NamedTuple):
    """A synapse of a source; ``target`` is the place of its population among those of the phase."""

    target: int
    neuron: int
    receptor: int
    weight: int
    delay: int


def play_reference(
    network: SpinnakerNetwork, phase: str, spikes: AnyArray, lateness: AnyArray | None = None
) -> SpinnakerResult:
    """Play rows to a phase from rest, as :class:`PhaseRows` takes them."""
    rows = checked_rows(network, phase, spikes, lateness)
    run = _Run(network, phase)
    result = empty_result(network, phase, len(rows.spikes), run.events)
    late_steps = rows.lateness
    if late_steps is None:
        sources = network.lines_of(phase) + network.neurons_of(phase)
        late_steps = np.zeros((len(rows.spikes), sources), dtype=np.int64)
    for t, row in enumerate(rows.spikes):
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
    """Return rows as integers; ``InputError`` for others than :class:`PhaseRows` may have."""
    rows = np.asarray(spikes)
    lines = network.lines_of(phase)
    has_the_lines = rows.ndim == 2 and rows.shape[1] == lines
    if not has_the_lines or not np.isin(rows, (0, 1)).all():
        measured = f"{rows.shape} against (rows, {lines})"
        fix = "Give a row of 0 and 1 for each step."
        raise InputError("input spikes", "they do not fit the lines", measured=measured, fix=fix)
    if lateness is None:
        return PhaseRows(rows.astype(np.uint8), None)
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
    """Return room for so many rows."""
    neurons = network.neurons_of(phase)
    return SpinnakerResult(
        spikes=np.zeros((rows, neurons), dtype=np.uint8),
        potential=np.zeros((rows, neurons), dtype=np.int64),
        v=np.zeros((rows, neurons), dtype=np.int64),
        current=np.zeros((rows, neurons, spinnaker.RECEPTORS), dtype=np.int64),
        refractory=np.zeros((rows, neurons), dtype=np.int64),
        events=events,
    )


class _Run:
    """Neurons of a phase, and the spikes that wait for a core to process them."""

    def __init__(self, network: SpinnakerNetwork, phase: str) -> None:
        self.populations = [_Neurons(item) for item in network.populations_of(phase)]
        self.synapses = synapses_by_source(network, phase)
        # By the step in which they are processed: the step that sent a spike, and its source.
        self.waiting: dict[int, list[tuple[int, int]]] = {}
        self.events = dict.fromkeys(spinnaker.EVENTS, 0)

    def step(self, t: int) -> list[Step]:
        """Take step t of every population."""
        steps = [population.step(t) for population in self.populations]
        for step in steps:
            for name, count in step.wraps.items():
                self.events[name] += count
        return steps

    def send(self, t: int, sent: IntArray, lateness: IntArray) -> None:
        """Let the spikes (sources,) of step t wait for the step in which they are processed."""
        for source in np.flatnonzero(sent).tolist():
            processed_step = t + int(lateness[source])
            self.waiting.setdefault(processed_step, []).append((t, source))

    def deliver(self, t: int) -> None:
        """Process the spikes that have waited for step t: those that were sent first come first."""
        for sent, source in self.waiting.pop(t, []):
            for synapse in self.synapses[source]:
                population = self.populations[synapse.target]
                self._add(population, synapse, sent, lateness=t - sent)

    def _add(self, neurons: "_Neurons", synapse: Synapse, sent: int, lateness: int) -> None:
        """Add the weight of a synapse to the slot for its step, unless that has begun."""
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
    """Registers of a population; its ring buffers, (slots, neurons, receptors), as one."""

    def __init__(self, population: SpinnakerPopulation) -> None:
        size = population.size
        self.population = population
        self.shifts = np.array(population.shifts)
        self.ring = np.zeros((population.slots, size, spinnaker.RECEPTORS), dtype=np.int64)
        self.state = State(
            v=population.parameters.v_init.copy(),
            current=np.zeros((size, spinnaker.RECEPTORS), dtype=np.int64),
            refractory=np.zeros(size, dtype=np.int64),
        )

    def step(self, t: int) -> Step:
        """Take step t, which empties its slot."""
        population = self.population
        slot = self.ring[t % population.slots]
        step = spinnaker.step(
            population.parameters, population.constants, self.shifts, self.state, slot
        )
        slot[:] = 0  # a view of the ring buffer
        self.state = step.state
        return step


def synapses_by_source(network: SpinnakerNetwork, phase: str) -> list[list[Synapse]]:
    """Return the synapses of every source of a phase, lines first, in the order they act in."""
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
