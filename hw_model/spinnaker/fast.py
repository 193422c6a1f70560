"""The compiled engine of SpiNNaker: the page of its arithmetic on single numbers, step after step.

The formulas are those of :mod:`hw_model.arithmetic.spinnaker`, compiled. Here is only the order of
turns, as in :mod:`hw_model.spinnaker.reference`, which this engine equals in every register and
every count.
"""

from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import spinnaker
from hw_model.engine.compiled import compiled
from hw_model.engine.formulas import CompiledPage
from hw_model.spinnaker.network import RECEPTORS, SpinnakerNetwork, SpinnakerPopulation
from hw_model.spinnaker.reference import SpinnakerResult, checked_rows, empty_result
from hw_model.values import AnyArray, IntArray

# Where each count lies among those of :data:`hw_model.arithmetic.spinnaker.EVENTS`: the loops count
# by index, as numba has no mapping that would be fast.
RING_WRAPS = spinnaker.EVENTS.index("ring_wraps")
CURRENT_WRAPS = spinnaker.EVENTS.index("current_wraps")
POTENTIAL_WRAPS = spinnaker.EVENTS.index("potential_wraps")
SATURATED_WEIGHTS = spinnaker.EVENTS.index("saturated_weights")
LATE_SYNAPSES = spinnaker.EVENTS.index("late_synapses")


class Neurons(NamedTuple):
    """n neurons of a phase: ``synapse_*`` and ``shifts`` (n, receptors), all others (n,).

    Formats are those of :class:`hw_model.arithmetic.spinnaker.Parameters` and of its ``Constants``;
    ``slots`` are those of the ring buffer of a neuron's core.
    """

    v_rest: IntArray
    v_reset: IntArray
    v_thresh: IntArray
    i_offset: IntArray
    resistance: IntArray
    membrane_decay: IntArray
    synapse_decay: IntArray
    synapse_init: IntArray
    refractory_steps: IntArray
    shifts: IntArray
    slots: IntArray


class Synapses(NamedTuple):
    """Synapses of a phase in the order they act in.

    Those of source s are ``first[s]`` to before ``first[s + 1]``; ``first`` is (sources + 1,), all
    others are (synapses,). Sources are lines, then neurons. ``delay`` is in steps.
    """

    first: IntArray
    target: IntArray
    receptor: IntArray
    weight: IntArray
    delay: IntArray


class SynapsesBySource(NamedTuple):
    """Synapses in any order, with the number of the source of each; arrays are (synapses,)."""

    source: IntArray
    target: IntArray
    receptor: IntArray
    weight: IntArray
    delay: IntArray


class Registers(NamedTuple):
    """V and refractory steps (n,), currents (n, receptors), ring buffers (slots, n, receptors)."""

    v: IntArray
    current: IntArray
    refractory: IntArray
    ring: IntArray


class PhaseArrays(NamedTuple):
    """All that the loops have of a phase; of these, they write ``registers`` only."""

    neurons: Neurons
    synapses: Synapses
    registers: Registers


class Recorded(NamedTuple):
    """What the loops write: spikes of all sources (rows, sources), and registers (rows, n, ..).

    Spikes of lines, the first sources, stand there from the beginning, and are read only.
    """

    sent: AnyArray
    potential: IntArray
    v: IntArray
    current: IntArray
    refractory: IntArray


class Lateness(NamedTuple):
    """By how many steps spikes come late, (rows, sources), and the largest of these.

    If no spike is late, ``steps`` is empty, and is not read.
    """

    steps: IntArray
    largest: int


_PAGE = CompiledPage(spinnaker, __name__)
_wrap = _PAGE.compiled(spinnaker.wrap)
_charged = _PAGE.compiled(spinnaker.charged)
_drive_of = _PAGE.compiled(spinnaker.drive_of)
_goal_of = _PAGE.compiled(spinnaker.goal_of)
_approached = _PAGE.compiled(spinnaker.approached)
_faded = _PAGE.compiled(spinnaker.faded)
_slot_of = _PAGE.compiled(spinnaker.slot_of)
_comes_too_late = _PAGE.compiled(spinnaker.comes_too_late)
_collected = _PAGE.compiled(spinnaker.collected)
_RECEPTORS = spinnaker.RECEPTORS
_EXCITATORY = spinnaker.EXCITATORY
_INHIBITORY = spinnaker.INHIBITORY


class FastPhase:
    """A phase laid out for the compiled loop; ``play`` may be called as often as one likes."""

    def __init__(self, network: SpinnakerNetwork, phase: str) -> None:
        self.network = network
        self.phase = phase
        populations = network.populations_of(phase)
        self.neurons = _neurons(populations)
        self.synapses = _synapses(network, phase)
        self.v_init = _joined([item.parameters.v_init for item in populations])

    def play(self, spikes: AnyArray, lateness: AnyArray | None = None) -> SpinnakerResult:
        """Play rows from rest, as :class:`hw_model.spinnaker.reference.PhaseRows` takes them."""
        rows = checked_rows(self.network, self.phase, spikes, lateness)
        steps = len(rows.spikes)
        result = empty_result(self.network, self.phase, steps, {})
        sources = len(self.synapses.first) - 1
        sent = np.zeros((steps, sources), dtype=np.uint8)
        lines = rows.spikes.shape[1]
        sent[:, :lines] = rows.spikes
        event_counts = np.zeros(len(spinnaker.EVENTS), dtype=np.int64)
        recorded = Recorded(sent, result.potential, result.v, result.current, result.refractory)
        registers = _at_rest(self.v_init, self.neurons)
        arrays = PhaseArrays(self.neurons, self.synapses, registers)
        _play(arrays, _lateness(rows.lateness), recorded, event_counts)
        result.spikes[:] = sent[:, lines:]
        result.events.update(zip(spinnaker.EVENTS, event_counts.tolist(), strict=True))
        return result


def play_fast(
    network: SpinnakerNetwork, phase: str, spikes: AnyArray, lateness: AnyArray | None = None
) -> SpinnakerResult:
    """Do what :func:`hw_model.spinnaker.reference.play_reference` does."""
    return FastPhase(network, phase).play(spikes, lateness)


def _neurons(populations: tuple[SpinnakerPopulation, ...]) -> Neurons:
    by_population = [_neurons_of(population) for population in populations]
    return Neurons(*(_joined(arrays) for arrays in zip(*by_population, strict=True)))


def _neurons_of(population: SpinnakerPopulation) -> Neurons:
    parameters = population.parameters
    size = population.size
    return Neurons(
        v_rest=parameters.v_rest,
        v_reset=parameters.v_reset,
        v_thresh=parameters.v_thresh,
        i_offset=parameters.i_offset,
        shifts=np.tile(np.array(population.shifts), (size, 1)),
        slots=np.full(size, population.slots),
        **population.constants._asdict(),
    )


def _joined(parts: list[IntArray] | tuple[IntArray, ...]) -> IntArray:
    """Return arrays as one, contiguous and of 64 bits, the kind the loops are compiled for."""
    return np.ascontiguousarray(np.concatenate(parts), dtype=np.int64)


def _synapses(network: SpinnakerNetwork, phase: str) -> Synapses:
    """Return synapses ordered by source; of one source they follow each other by projection."""
    first_source = network.sources_of(phase)
    columns = network.columns_of(phase)
    nothing = np.zeros(0, dtype=np.int64)
    # A phase may have no projection, and nothing at all cannot be joined.
    parts = [SynapsesBySource(nothing, nothing, nothing, nothing, nothing)]
    for projection in network.projections_of(phase):
        receptor = RECEPTORS.index(projection.receptor)
        parts.append(
            SynapsesBySource(
                source=first_source[projection.source] + projection.source_index,
                target=columns[projection.target].start + projection.target_index,
                receptor=np.full(len(projection.weight), receptor),
                weight=projection.weight,
                delay=projection.delay,
            )
        )
    joined = SynapsesBySource(*(_joined(arrays) for arrays in zip(*parts, strict=True)))
    # A stable order: synapses of one source stay in the order of projections.
    order = np.argsort(joined.source, kind="stable")
    sources = network.lines_of(phase) + network.neurons_of(phase)
    first = np.searchsorted(joined.source[order], np.arange(sources + 1))
    return Synapses(
        first=first.astype(np.int64),
        target=joined.target[order],
        receptor=joined.receptor[order],
        weight=joined.weight[order],
        delay=joined.delay[order],
    )


def _at_rest(v_init: IntArray, neurons: Neurons) -> Registers:
    size = len(v_init)
    return Registers(
        v=v_init.copy(),
        current=np.zeros((size, _RECEPTORS), dtype=np.int64),
        refractory=np.zeros(size, dtype=np.int64),
        ring=np.zeros((int(neurons.slots.max(initial=1)), size, _RECEPTORS), dtype=np.int64),
    )


def _lateness(steps: IntArray | None) -> Lateness:
    if steps is None:
        return Lateness(np.zeros((0, 0), dtype=np.int64), 0)
    return Lateness(np.ascontiguousarray(steps), int(steps.max(initial=0)))


@compiled
def _wrapped(exact, event_counts, event):  # type: ignore[no-untyped-def]
    """Return a sum in 32 bits, and count that it wrapped if it did."""
    value = _wrap(exact)
    event_counts[event] += value != exact
    return value


@compiled
def _receive(neurons, registers, n, t, event_counts):  # type: ignore[no-untyped-def]
    """Add what has arrived for step t to the currents of neuron n, and empty its slot."""
    slot = t % neurons.slots[n]
    for r in range(_RECEPTORS):
        arrived = registers.ring[slot, n, r]
        if arrived:  # most slots are empty
            shifted = _wrapped(arrived << neurons.shifts[n, r], event_counts, RING_WRAPS)
            current_sum = _charged(registers.current[n, r], neurons.synapse_init[n, r], shifted)
            registers.current[n, r] = _wrapped(current_sum, event_counts, CURRENT_WRAPS)
            registers.ring[slot, n, r] = 0


@compiled
def _move(neurons, registers, n, event_counts):  # type: ignore[no-untyped-def]
    """Return V of neuron n as the threshold sees it, and count down its refractory steps."""
    if registers.refractory[n] > 0:
        registers.refractory[n] -= 1
        return registers.v[n]
    excitation = registers.current[n, _EXCITATORY]
    inhibition = registers.current[n, _INHIBITORY]
    drive_sum = _drive_of(excitation, inhibition, neurons.i_offset[n])
    drive = _wrapped(drive_sum, event_counts, POTENTIAL_WRAPS)
    goal_sum = _goal_of(drive, neurons.resistance[n], neurons.v_rest[n])
    goal = _wrapped(goal_sum, event_counts, POTENTIAL_WRAPS)
    distance = _wrapped(goal - registers.v[n], event_counts, POTENTIAL_WRAPS)
    v_sum = _approached(goal, distance, neurons.membrane_decay[n])
    return _wrapped(v_sum, event_counts, POTENTIAL_WRAPS)


@compiled
def _update(neurons, registers, recorded, t, event_counts):  # type: ignore[no-untyped-def]
    """Take step t of all neurons."""
    size = len(registers.v)
    first_neuron = recorded.sent.shape[1] - size
    for n in range(size):
        _receive(neurons, registers, n, t, event_counts)
        v = _move(neurons, registers, n, event_counts)
        recorded.potential[t, n] = v
        fired = v >= neurons.v_thresh[n]
        if fired:
            v = neurons.v_reset[n]
            registers.refractory[n] = neurons.refractory_steps[n]
        registers.v[n] = v
        recorded.sent[t, first_neuron + n] = fired
        recorded.v[t, n] = v
        recorded.refractory[t, n] = registers.refractory[n]
        for r in range(_RECEPTORS):
            current = _faded(registers.current[n, r], neurons.synapse_decay[n, r])
            registers.current[n, r] = current
            recorded.current[t, n, r] = current


@compiled
def _deliver(phase, source, sent, lateness, event_counts):  # type: ignore[no-untyped-def]
    """Add the weights of a source that spiked in step ``sent`` to ring buffers."""
    synapses = phase.synapses
    ring = phase.registers.ring
    for s in range(synapses.first[source], synapses.first[source + 1]):
        n = synapses.target[s]
        r = synapses.receptor[s]
        weight = synapses.weight[s]
        slots = phase.neurons.slots[n]
        if _comes_too_late(lateness, synapses.delay[s], slots):
            event_counts[LATE_SYNAPSES] += 1
            continue
        slot = _slot_of(sent, synapses.delay[s], slots)
        before = ring[slot, n, r]
        after = _collected(before, weight)
        event_counts[SATURATED_WEIGHTS] += after != before + weight
        ring[slot, n, r] = after


@compiled
def _play(phase, lateness, recorded, event_counts):  # type: ignore[no-untyped-def]
    """Play all rows of ``recorded.sent``, in which the spikes of lines stand already."""
    steps, sources = recorded.sent.shape
    for t in range(steps):
        _update(phase.neurons, phase.registers, recorded, t, event_counts)
        # Spikes that were sent first are processed first.
        for sent in range(max(0, t - lateness.largest), t + 1):
            for source in range(sources):
                if not recorded.sent[sent, source]:
                    continue
                late_steps = 0
                if lateness.largest > 0:
                    late_steps = lateness.steps[sent, source]
                if sent + late_steps == t:
                    _deliver(phase, source, sent, late_steps, event_counts)
