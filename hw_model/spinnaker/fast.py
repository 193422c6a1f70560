"""The compiled engine of SpiNNaker: the page of its arithmetic on single numbers, step after step.

The formulas are those of :mod:`hw_model.arithmetic.spinnaker`, compiled. Here is only the order of
turns, as in :mod:`hw_model.spinnaker.reference`, which this engine equals in every register and
every count.
"""

from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import spinnaker
from hw_model.engine.compiled import compiled
from hw_model.engine.formulas import compiled_formulas
from hw_model.spinnaker.network import RECEPTORS, SpinnakerNetwork, SpinnakerPopulation
from hw_model.spinnaker.reference import (
    SpinnakerResult,
    checked_rows,
    empty_result,
)
from hw_model.values import AnyArray, IntArray

RING_WRAPS, CURRENT_WRAPS, POTENTIAL_WRAPS, SATURATED, LATE = range(len(spinnaker.EVENTS))
"""Where a count lies among those of :data:`hw_model.arithmetic.spinnaker.EVENTS`."""


class Neurons(NamedTuple):
    """n neurons: ``synapse_*`` and ``shifts`` (n, receptors), all others (n,)."""

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
    """Synapses in the order they act in; those of source s begin at ``first[s]``, (sources + 1,)."""

    first: IntArray
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
    """All that a phase is."""

    neurons: Neurons
    synapses: Synapses
    registers: Registers


class Recorded(NamedTuple):
    """Where spikes of all sources (rows, sources) and registers (rows, n, ..) are kept."""

    sent: AnyArray
    potential: IntArray
    v: IntArray
    current: IntArray
    refractory: IntArray


class Lateness(NamedTuple):
    """Steps (rows, sources) by which spikes come late, and the most of them; () if that is 0."""

    steps: IntArray
    most: int


_NAMES = (
    "wrap",
    "charged",
    "drive_of",
    "goal_of",
    "approached",
    "faded",
    "slot_of",
    "comes_too_late",
    "collected",
)
_COMPILED = compiled_formulas(spinnaker, _NAMES, __name__)
_wrap = _COMPILED["wrap"]
_charged = _COMPILED["charged"]
_drive_of = _COMPILED["drive_of"]
_goal_of = _COMPILED["goal_of"]
_approached = _COMPILED["approached"]
_faded = _COMPILED["faded"]
_slot_of = _COMPILED["slot_of"]
_comes_too_late = _COMPILED["comes_too_late"]
_collected = _COMPILED["collected"]
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
        counted = np.zeros(len(spinnaker.EVENTS), dtype=np.int64)
        recorded = Recorded(sent, result.potential, result.v, result.current, result.refractory)
        registers = _at_rest(self.v_init, self.neurons)
        arrays = PhaseArrays(self.neurons, self.synapses, registers)
        _play(arrays, _lateness(rows.lateness), recorded, counted)
        result.spikes[:] = sent[:, lines:]
        result.events.update(zip(spinnaker.EVENTS, counted.tolist(), strict=True))
        return result


def play_fast(
    network: SpinnakerNetwork, phase: str, spikes: AnyArray, lateness: AnyArray | None = None
) -> SpinnakerResult:
    """Do what :func:`hw_model.spinnaker.reference.play_reference` does."""
    return FastPhase(network, phase).play(spikes, lateness)


def _neurons(populations: tuple[SpinnakerPopulation, ...]) -> Neurons:
    each = [_neurons_of(population) for population in populations]
    return Neurons(*(_joined(arrays) for arrays in zip(*each, strict=True)))


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
    """Return arrays as one, in the one kind of memory for which the loops are compiled."""
    return np.ascontiguousarray(np.concatenate(parts), dtype=np.int64)


def _synapses(network: SpinnakerNetwork, phase: str) -> Synapses:
    """Return synapses ordered by source; of one source they follow each other by projection."""
    first_source = network.sources_of(phase)
    columns = network.columns_of(phase)
    nothing = np.zeros(0, dtype=np.int64)
    parts = [(nothing,) * 5]
    for projection in network.projections_of(phase):
        receptor = RECEPTORS.index(projection.receptor)
        parts.append(
            (
                first_source[projection.source] + projection.source_index,
                columns[projection.target].start + projection.target_index,
                np.full(len(projection.weight), receptor),
                projection.weight,
                projection.delay,
            )
        )
    source, *arrays = (_joined(arrays) for arrays in zip(*parts, strict=True))
    order = np.argsort(source, kind="stable")
    sources = network.lines_of(phase) + network.neurons_of(phase)
    first = np.searchsorted(source[order], np.arange(sources + 1))
    return Synapses(first.astype(np.int64), *(array[order] for array in arrays))


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
def _wrapped(exact, counted, event):  # type: ignore[no-untyped-def]
    value = _wrap(exact)
    counted[event] += value != exact
    return value


@compiled
def _receive(neurons, registers, n, t, counted):  # type: ignore[no-untyped-def]
    """Add what has arrived for step t to the currents of neuron n, and empty its slot."""
    slot = t % neurons.slots[n]
    for r in range(_RECEPTORS):
        arrived = registers.ring[slot, n, r]
        if arrived:  # most slots are empty
            shifted = _wrapped(arrived << neurons.shifts[n, r], counted, RING_WRAPS)
            exact = _charged(registers.current[n, r], neurons.synapse_init[n, r], shifted)
            registers.current[n, r] = _wrapped(exact, counted, CURRENT_WRAPS)
            registers.ring[slot, n, r] = 0


@compiled
def _move(neurons, registers, n, counted):  # type: ignore[no-untyped-def]
    """Return V of neuron n as the threshold sees it."""
    if registers.refractory[n] > 0:
        registers.refractory[n] -= 1
        return registers.v[n]
    excitation = registers.current[n, _EXCITATORY]
    inhibition = registers.current[n, _INHIBITORY]
    exact = _drive_of(excitation, inhibition, neurons.i_offset[n])
    drive = _wrapped(exact, counted, POTENTIAL_WRAPS)
    exact = _goal_of(drive, neurons.resistance[n], neurons.v_rest[n])
    goal = _wrapped(exact, counted, POTENTIAL_WRAPS)
    distance = _wrapped(goal - registers.v[n], counted, POTENTIAL_WRAPS)
    exact = _approached(goal, distance, neurons.membrane_decay[n])
    return _wrapped(exact, counted, POTENTIAL_WRAPS)


@compiled
def _update(neurons, registers, recorded, t, counted):  # type: ignore[no-untyped-def]
    """Take step t of all neurons."""
    size = len(registers.v)
    first_neuron = recorded.sent.shape[1] - size
    for n in range(size):
        _receive(neurons, registers, n, t, counted)
        v = _move(neurons, registers, n, counted)
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
            left = _faded(registers.current[n, r], neurons.synapse_decay[n, r])
            registers.current[n, r] = left
            recorded.current[t, n, r] = left


@compiled
def _deliver(phase, source, sent, lateness, counted):  # type: ignore[no-untyped-def]
    """Add the weights of a source that spiked in step ``sent`` to ring buffers."""
    synapses = phase.synapses
    ring = phase.registers.ring
    for s in range(synapses.first[source], synapses.first[source + 1]):
        n = synapses.target[s]
        r = synapses.receptor[s]
        slots = phase.neurons.slots[n]
        if _comes_too_late(lateness, synapses.delay[s], slots):
            counted[LATE] += 1
            continue
        slot = _slot_of(sent, synapses.delay[s], slots)
        before = ring[slot, n, r]
        after = _collected(before, synapses.weight[s])
        counted[SATURATED] += after != before + synapses.weight[s]
        ring[slot, n, r] = after


@compiled
def _play(phase, lateness, recorded, counted):  # type: ignore[no-untyped-def]
    """Play all rows of ``recorded.sent``, in which the spikes of lines stand already."""
    steps, sources = recorded.sent.shape
    for t in range(steps):
        _update(phase.neurons, phase.registers, recorded, t, counted)
        # Spikes that were sent first are processed first.
        for sent in range(max(0, t - lateness.most), t + 1):
            for source in range(sources):
                if not recorded.sent[sent, source]:
                    continue
                late = 0
                if lateness.most > 0:
                    late = lateness.steps[sent, source]
                if sent + late == t:
                    _deliver(phase, source, sent, late, counted)
