"""Collect the data of viewer.html: what the network and the chip did in some of the recordings, in few characters.

The page should stay below 2 MB, so it holds at most ten recordings, and potentials only of the neurons that differ
most. Arrays are little-endian and in base64; ``viewer.js`` reads them.
"""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hw_model.values import AnyArray, IntArray
from locsnn_compile.network.network import Population
from locsnn_compile.pipeline import Levels
from locsnn_compile.report.figures.entries import Entry, IfKnown, plain
from locsnn_compile.report.figures.resources import CoreUse
from locsnn_compile.verification.matching import Divergence
from locsnn_compile.verification.observation import Observation, Observed

RECORDINGS = 10
"""Most recordings on a page, chosen by hand."""
MOST_TEXT = 1_800_000
"""Most characters of data: with the script and the library, the page stays below 2 MB."""
QUANTITIES = ("synaptic_ops", "spikes", "packets_received")
"""The counts of each core that a reader can choose for the picture of the mesh."""
GRADES = 65_535
"""Number of steps between the lowest potential and the highest, which are stored as 0 and 65,535 in 16 bits."""
_POTENTIAL_CHARACTERS = 6
"""Characters of a neuron in a step: two sides of 2 bytes each are 4 bytes, and base64 takes 4 characters for 3."""
_BEFORE_ALL_OTHERS = 1 << 40
"""A number of differing spikes that no neuron reaches, to sort a neuron before all others."""


class PotentialValues(Entry):
    """Potentials of the kept neurons, ``low + grade * values`` in the network's units, (2 sides, neurons, steps)."""

    low: float
    grade: float
    values: str


class RecordingValues(Entry):
    """What both sides did in a recording: the network first, then the chip.

    - ``predictions``: the classes, -1 where all class scores tie
    - ``spikes``: by population and input, the numbers ``step * size + neuron`` in ascending order
    - ``activity``: by phase, (steps, cores of the phase) for each of :data:`QUANTITIES`
    - ``potentials``: by population, of the neurons that are kept
    """

    number: int
    label: int | None
    predictions: tuple[int, int]
    spikes: Mapping[str, tuple[str, str]]
    activity: Mapping[str, tuple[str, ...]]
    potentials: IfKnown[Mapping[str, PotentialValues]]


class PopulationValues(Entry):
    """A population.

    - ``axis``: the phase in which it steps, over time or location
    - ``kept``: the neurons whose potentials are on the page; ``thresholds``: theirs, in the same order
    - ``cores``: the numbers of the cores that hold the population
    """

    name: str
    axis: str
    size: int
    steps: int
    kept: tuple[int, ...]
    thresholds: tuple[float, ...]
    cores: tuple[int, ...]


class InputValues(Entry):
    """An input of the network, with ``size`` lines, in the phase ``axis``."""

    name: str
    axis: str
    size: int
    steps: int


class ViewerValues(Entry):
    """All data of the page; ``samples`` recordings were checked, ``first`` is the first spike that differs."""

    recordings: tuple[RecordingValues, ...]
    samples: int
    populations: tuple[PopulationValues, ...]
    inputs: tuple[InputValues, ...]
    phases: tuple[str, ...]
    first: Divergence | None
    quantities: tuple[str, ...]
    cores: tuple[CoreUse, ...]


def viewer_values(
    observed: Observed, cores: tuple[CoreUse, ...], first: Divergence | None
) -> ViewerValues:
    """Return the data of the page on some of the recordings.

    These are the recording in which the sides ``first`` differ and, while there is room, those from the
    beginning. The room that remains goes to the potentials of the neurons that differ most.
    """
    levels = observed.levels
    network = levels.network
    most_telling = first.recording if first else 0
    # The most telling recording comes first, and is not repeated.
    numbers = list(dict.fromkeys([most_telling, *range(len(observed))]))[:RECORDINGS]
    sample = Observation(levels.quantized, levels.program, observed.recordings[numbers])
    recordings = _fitting(_recordings(observed, sample, numbers))
    room_per_recording = (MOST_TEXT - _characters(recordings)) // len(recordings)
    kept = _most_different(levels, _differing_spikes(sample, first), room_per_recording)
    with_potentials = []
    for recording in recordings:
        # Played again one by one: the potentials of all neurons take much memory.
        potentials = _potentials(levels, observed.recording(recording.number), kept)
        with_potentials.append(replace(recording, potentials=potentials))
    return ViewerValues(
        recordings=tuple(with_potentials),
        samples=len(observed),
        populations=tuple(_population(levels, p, kept[p.name]) for p in network.own_populations),
        inputs=_inputs(levels),
        phases=tuple(phase.name for phase in network.phases),
        first=first,
        quantities=QUANTITIES,
        cores=cores,
    )


def _recordings(
    observed: Observed, sample: Observation, numbers: Sequence[int]
) -> list[RecordingValues]:
    """Return what both sides did in the recordings ``numbers``, which ``sample`` holds in this order.

    Potentials are still missing.
    """
    network = observed.levels.network
    reference = sample.reference
    chip = sample.chip
    chip_scores = np.asarray(chip.scores)
    sides: dict[str, tuple[AnyArray, AnyArray]] = {}
    for population in network.own_populations:
        name = population.name
        sides[name] = (reference.spikes[name], chip.spikes[name])
    for view in _inputs(observed.levels):
        # Both sides play the same input.
        sides[view.name] = (reference.spikes[view.name], reference.spikes[view.name])

    def recording(i: int) -> RecordingValues:
        return RecordingValues(
            number=numbers[i],
            label=None if observed.labels is None else int(observed.labels[numbers[i]]),
            predictions=(
                int(network.readout.decided(reference.scores[i])),
                int(network.readout.decided(chip_scores[i])),
            ),
            spikes={
                name: (_spike_numbers(reference_side[i]), _spike_numbers(chip_side[i]))
                for name, (reference_side, chip_side) in sides.items()
            },
            activity={
                phase: tuple(_base64(activities[i].count(name), "u4") for name in QUANTITIES)
                for phase, activities in chip.activity.items()
            },
            potentials=None,
        )

    return [recording(i) for i in range(len(numbers))]


def _fitting(recordings: list[RecordingValues]) -> list[RecordingValues]:
    """Return the first recordings, as many as the page has room for, but at least one."""
    while len(recordings) > 1 and _characters(recordings) > MOST_TEXT:
        recordings = recordings[:-1]
    return recordings


def _characters(recordings: list[RecordingValues]) -> int:
    """Return how much of the page recordings take."""
    return len(json.dumps(plain(recordings)))


def _differing_spikes(sample: Observation, first: Divergence | None) -> dict[str, IntArray]:
    """Return the number of differing spikes of each neuron, (n,) by population.

    The neuron of the first difference gets a number above all others, as a reader looks at it first.
    """
    differing: dict[str, IntArray] = {}
    for population in sample.quantized.network.own_populations:
        name = population.name
        differs = sample.reference.spikes[name] != sample.chip.spikes[name]
        differing[name] = differs.sum(axis=(0, 1))  # over recordings and steps
    if first is not None:
        differing[first.population][first.neuron] = _BEFORE_ALL_OTHERS
    return differing


def _most_different(
    levels: Levels, differing: Mapping[str, IntArray], room: int
) -> dict[str, list[int]]:
    """Return the neurons of each population that differ most, in ascending order.

    They are as many as fit their potentials into ``room`` characters per recording, but at least one per population.
    """
    network = levels.network

    def characters(neurons: int) -> int:
        """Return the characters of the potentials of at most this many neurons of each population."""
        return sum(
            _POTENTIAL_CHARACTERS
            * network.steps_of(population.phase)
            * min(neurons, population.size)
            for population in network.own_populations
        )

    neurons = max(map(len, differing.values()))
    # A quarter fewer at a time: few steps, and at least three quarters of the room are used.
    while neurons > 1 and characters(neurons) > room:
        neurons = neurons * 3 // 4
    # A stable sort, so that equal neurons keep their order on every machine.
    return {
        name: sorted(np.argsort(-spikes, kind="stable")[:neurons].tolist())
        for name, spikes in differing.items()
    }


def _potentials(
    levels: Levels, recording: Observation, kept: Mapping[str, list[int]]
) -> dict[str, PotentialValues]:
    """Return the potentials of the neurons that are kept, in a single recording, by population."""
    reference = recording.reference.potential
    chip = recording.chip.potential
    potentials = {}
    for name, neurons in kept.items():
        # The chip's voltages are brought to the network's units.
        scale = levels.quantized.population(name).scale[neurons]
        reference_potential = reference[name][0][:, neurons]
        chip_potential = chip[name][0][:, neurons] / scale
        # (sides, steps, neurons) becomes (sides, neurons, steps), so that the steps of a neuron lie together.
        sides = np.stack([reference_potential, chip_potential]).swapaxes(1, 2)
        low = float(sides.min())
        # Potentials that never move have no range; then any grade will do.
        grade = float(np.ptp(sides)) / GRADES or 1.0
        values = _base64(np.rint((sides - low) / grade), "u2")
        potentials[name] = PotentialValues(low, grade, values)
    return potentials


def _population(levels: Levels, population: Population, kept: list[int]) -> PopulationValues:
    """Return what the viewer shows of a population, with the thresholds of the kept neurons only."""
    name = population.name
    cores = [
        core.number
        for core in levels.program.cores
        if any(core_slice.group == name for core_slice in core.slices)
    ]
    return PopulationValues(
        name=name,
        axis=population.phase,
        size=population.size,
        steps=levels.network.steps_of(population.phase),
        kept=tuple(kept),
        thresholds=tuple(population.thresholds[kept].tolist()),
        cores=tuple(cores),
    )


def _inputs(levels: Levels) -> tuple[InputValues, ...]:
    """Return the inputs of the network, except those of a phase in which no population steps."""
    network = levels.network
    phases = [phase.name for phase in network.phases]
    return tuple(
        InputValues(view.name, view.phase, view.lines, network.steps_of(view.phase))
        for view in network.views
        if view.phase in phases
    )


def _spike_numbers(spikes: AnyArray) -> str:
    """Return the number ``step * size + neuron`` of each spike, given spikes (steps, neurons)."""
    return _base64(np.flatnonzero(spikes), "u4")


def _base64(values: AnyArray, kind: str) -> str:
    """Return numbers as text; ``kind`` is numpy's name of the type, such as u2 for 16 bits without sign."""
    return base64.b64encode(values.astype(f"<{kind}").tobytes()).decode()
