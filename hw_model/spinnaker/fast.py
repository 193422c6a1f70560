"""The compiled engine of SpiNNaker, which plays a phase with numba, one neuron after the other.

The formulas are those of :mod:`hw_model.arithmetic.spinnaker`, compiled. This module says only in which order they are
applied. The plain engine, :mod:`hw_model.spinnaker.reference`, does the same in the same order; both give equal
registers and counts.
"""

from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import spinnaker
from hw_model.engine.compiled import compiled
from hw_model.engine.formulas import CompiledPage
from hw_model.spinnaker.network import RECEPTORS, SpinnakerNetwork, SpinnakerPopulation
from hw_model.spinnaker.reference import SpinnakerResult, checked_rows, empty_result
from hw_model.values import AnyArray, IntArray

# The arithmetic's EVENTS are the names of what is counted, such as wraps; they are not events of a recording. The loops
# count in an array, by these indices, since numba has no fast dictionary.
RING_WRAPS = spinnaker.EVENTS.index("ring_wraps")
CURRENT_WRAPS = spinnaker.EVENTS.index("current_wraps")
POTENTIAL_WRAPS = spinnaker.EVENTS.index("potential_wraps")
SATURATED_WEIGHTS = spinnaker.EVENTS.index("saturated_weights")
LATE_SYNAPSES = spinnaker.EVENTS.index("late_synapses")


class Neurons(NamedTuple):
    """The parameters of the n neurons of a phase: ``synapse_*`` and ``shifts`` (n, receptors), all others (n,).

    The number formats are those of ``Parameters`` and ``Constants`` in :mod:`hw_model.arithmetic.spinnaker`. ``slots``
    is the length of the ring buffer on a neuron's core, in steps.
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
    """The synapses of a phase, in the order in which they act.

    Source s has the synapses ``first[s]..first[s + 1]``; ``first`` is (sources + 1,), all other arrays are (synapses,).
    Sources are numbered: input lines first, then neurons. ``delay`` is in steps.
    """

    first: IntArray
    target: IntArray
    receptor: IntArray
    weight: IntArray
    delay: IntArray


class SynapsesBySource(NamedTuple):
    """Synapses in any order, each with the number of its source; arrays are (synapses,)."""

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
    """All that the loops need of a phase; they write only ``registers``."""

    neurons: Neurons
    synapses: Synapses
    registers: Registers


class Recorded(NamedTuple):
    """The history that the loops write: spikes ``sent`` by all sources (rows, sources), registers (rows, n, ...).

    The spikes of input lines, which are the first sources, are in ``sent`` from the beginning. The loops only read
    them.
    """

    sent: AnyArray
    potential: IntArray
    v: IntArray
    current: IntArray
    refractory: IntArray


class Lateness(NamedTuple):
    """By how many steps cores process each spike too late, (rows, sources), and the largest of these numbers.

    A core of a busy board can fall behind. If no spike is late, ``steps`` is empty and is not read.
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
_RECEPTOR_COUNT = spinnaker.RECEPTOR_COUNT
_EXCITATORY = spinnaker.EXCITATORY
_INHIBITORY = spinnaker.INHIBITORY


class FastPhase:
    """A phase laid out for the compiled loop once, to play any number of recordings with it."""

    def __init__(self, network: SpinnakerNetwork, phase: str) -> None:
        self.network = network
        self.phase = phase
        populations = network.populations_of(phase)
        self.neurons = _neurons(populations)
        self.synapses = _synapses(network, phase)
        self.v_init = _joined([item.parameters.v_init for item in populations])

    def play(self, spikes: AnyArray, lateness: AnyArray | None = None) -> SpinnakerResult:
        """Play ``spikes`` from rest; arguments are explained at :class:`hw_model.spinnaker.reference.PhaseRows`."""
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
    """Return the parameters of all populations of a phase, one population after the other."""
    by_population = [_neurons_of(population) for population in populations]
    return Neurons(*(_joined(arrays) for arrays in zip(*by_population, strict=True)))


def _neurons_of(population: SpinnakerPopulation) -> Neurons:
    """Return the parameters of a population, with those of its cores repeated for each neuron."""
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
    """Return arrays joined to one, contiguous and int64: the kind of array that the loops are compiled for."""
    return np.ascontiguousarray(np.concatenate(parts), dtype=np.int64)


def _synapses(network: SpinnakerNetwork, phase: str) -> Synapses:
    """Return the synapses of a phase ordered by source, and those of one source by projection."""
    first_source = network.sources_of(phase)
    columns = network.columns_of(phase)
    nothing = np.zeros(0, dtype=np.int64)
    # Begin with empty arrays, so that there is something to join in a phase without projections.
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
    # Stable: the synapses of one source stay in the order of projections, which matters when a sum saturates.
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
    """Return the registers before the first step; the ring buffers are as long as the longest of any core."""
    size = len(v_init)
    return Registers(
        v=v_init.copy(),
        current=np.zeros((size, _RECEPTOR_COUNT), dtype=np.int64),
        refractory=np.zeros(size, dtype=np.int64),
        ring=np.zeros((int(neurons.slots.max(initial=1)), size, _RECEPTOR_COUNT), dtype=np.int64),
    )


def _lateness(steps: IntArray | None) -> Lateness:
    """Return the lateness for the loops, which cannot take None."""
    if steps is None:
        return Lateness(np.zeros((0, 0), dtype=np.int64), 0)
    return Lateness(np.ascontiguousarray(steps), int(steps.max(initial=0)))


@compiled
def _wrapped(exact, event_counts, event):  # type: ignore[no-untyped-def]
    """Return an exact sum wrapped to 32 bits, and count the event if this changes it."""
    value = _wrap(exact)
    event_counts[event] += value != exact
    return value


@compiled
def _receive(neurons, registers, n, t, event_counts):  # type: ignore[no-untyped-def]
    """Add the weights that are due in step t to the currents of neuron n, and clear the slot for later steps."""
    slot = t % neurons.slots[n]
    for r in range(_RECEPTOR_COUNT):
        arrived = registers.ring[slot, n, r]
        # Most slots are empty, so this test saves time.
        if arrived:
            shifted = _wrapped(arrived << neurons.shifts[n, r], event_counts, RING_WRAPS)
            current_sum = _charged(registers.current[n, r], neurons.synapse_init[n, r], shifted)
            registers.current[n, r] = _wrapped(current_sum, event_counts, CURRENT_WRAPS)
            registers.ring[slot, n, r] = 0


@compiled
def _move(neurons, registers, n, event_counts):  # type: ignore[no-untyped-def]
    """Return V of neuron n as it is compared with the threshold, or count down a refractory step, which keeps V."""
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
    """Run step t of all neurons: receive, move V, fire, let the currents decay."""
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
        for r in range(_RECEPTOR_COUNT):
            current = _faded(registers.current[n, r], neurons.synapse_decay[n, r])
            registers.current[n, r] = current
            recorded.current[t, n, r] = current


@compiled
def _deliver(phase, source, sent, lateness, event_counts):  # type: ignore[no-untyped-def]
    """Add the weights of a source that spiked in step ``sent`` to the ring buffers of its targets."""
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
    """Play all rows of ``recorded.sent``, which contains the spikes of input lines already."""
    steps, sources = recorded.sent.shape
    for t in range(steps):
        _update(phase.neurons, phase.registers, recorded, t, event_counts)
        # Deliver all spikes that are processed in step t. Spikes that were sent earlier, but are late, come first.
        for sent in range(max(0, t - lateness.largest), t + 1):
            for source in range(sources):
                if not recorded.sent[sent, source]:
                    continue
                late_steps = 0
                if lateness.largest > 0:
                    late_steps = lateness.steps[sent, source]
                if sent + late_steps == t:
                    _deliver(phase, source, sent, late_steps, event_counts)
