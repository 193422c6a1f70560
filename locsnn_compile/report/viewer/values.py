"""The data of viewer.html: what both sides did in some of the recordings, in few characters.

Arrays are little-endian and in base64.
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
"""Most recordings on a page."""
MOST_TEXT = 1_800_000
"""Most characters of data: with the script and the library, the page stays below 2 MB."""
QUANTITIES = ("synaptic_ops", "spikes", "packets_received")
"""What the mesh shows of each core."""
GRADES = 65_535
"""Steps from the lowest potential to the highest, in numbers of 16 bits."""
_POTENTIAL_CHARACTERS = 6
"""Of a neuron in a step: two sides, of 2 bytes each, in base64."""
_BEFORE_ALL_OTHERS = 1 << 40
"""A number of differing spikes that no neuron reaches."""


class PotentialValues(Entry):
    """Potentials (2 sides, kept neurons, steps): ``low + grade * values``, in the network's units."""

    low: float
    grade: float
    values: str


class RecordingValues(Entry):
    """What both sides did in a recording: the network first, then the chip.

    - ``spikes``: by population and input, the numbers ``step * size + neuron``
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
    """A population, the neurons whose potentials are ``kept``, with their thresholds, and its cores."""

    name: str
    axis: str
    size: int
    steps: int
    kept: tuple[int, ...]
    thresholds: tuple[float, ...]
    cores: tuple[int, ...]


class InputValues(Entry):
    """An input of the network."""

    name: str
    axis: str
    size: int
    steps: int


class ViewerValues(Entry):
    """All that the page shows; ``samples`` recordings were checked, ``first`` is where sides first differ."""

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

    They are the recording in which the sides ``first`` differ and, while there is room, the first
    ones. What room is left goes to the potentials of the neurons that differ most.
    """
    levels = observed.levels
    network = levels.network
    most_telling = first.recording if first else 0
    numbers = list(dict.fromkeys([most_telling, *range(len(observed))]))[:RECORDINGS]
    some = Observation(levels.quantized, levels.program, observed.recordings[numbers])
    recordings = _that_fit(_recordings(observed, some, numbers))
    room = (MOST_TEXT - _characters(recordings)) // len(recordings)
    kept = _kept(levels, _differing(some, first), room)
    return ViewerValues(
        recordings=tuple(
            replace(item, potentials=_potentials(levels, observed.recording(item.number), kept))
            for item in recordings
        ),
        samples=len(observed),
        populations=tuple(_population(levels, p, kept[p.name]) for p in network.own_populations),
        inputs=_inputs(levels),
        phases=tuple(phase.name for phase in network.phases),
        first=first,
        quantities=QUANTITIES,
        cores=cores,
    )


def _recordings(
    observed: Observed, some: Observation, numbers: Sequence[int]
) -> list[RecordingValues]:
    """Return recordings without potentials; ``some`` holds them in the order of their numbers."""
    network = observed.levels.network
    reference, chip = some.reference, some.chip
    chip_scores = np.asarray(chip.scores)
    sides: dict[str, tuple[AnyArray, AnyArray]] = {}
    for population in network.own_populations:
        name = population.name
        sides[name] = (reference.spikes[name], chip.spikes[name])
    for view in _inputs(observed.levels):
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
                name: (_places(reference_side[i]), _places(chip_side[i]))
                for name, (reference_side, chip_side) in sides.items()
            },
            activity={
                phase: tuple(_text(items[i].count(name), "u4") for name in QUANTITIES)
                for phase, items in chip.activity.items()
            },
            potentials=None,
        )

    return [recording(i) for i in range(len(numbers))]


def _that_fit(recordings: list[RecordingValues]) -> list[RecordingValues]:
    """Return the first recordings, as many as the page has room for, but at least one."""
    while len(recordings) > 1 and _characters(recordings) > MOST_TEXT:
        recordings = recordings[:-1]
    return recordings


def _characters(recordings: list[RecordingValues]) -> int:
    return len(json.dumps(plain(recordings)))


def _differing(some: Observation, first: Divergence | None) -> dict[str, IntArray]:
    """Return how many spikes of every neuron differ, by population; the first one leads."""
    differing: dict[str, IntArray] = {}
    for population in some.quantized.network.own_populations:
        name = population.name
        unequal = some.reference.spikes[name] != some.chip.spikes[name]
        differing[name] = unequal.sum(axis=(0, 1))
    if first is not None:
        differing[first.population][first.neuron] = _BEFORE_ALL_OTHERS
    return differing


def _kept(levels: Levels, differing: Mapping[str, IntArray], room: int) -> dict[str, list[int]]:
    """Return the neurons of each population that differ most, as many as fit their potentials into ``room``."""
    network = levels.network

    def characters(count: int) -> int:
        return sum(
            _POTENTIAL_CHARACTERS * network.steps_of(p.phase) * min(count, p.size)
            for p in network.own_populations
        )

    count = max(map(len, differing.values()))
    while count > 1 and characters(count) > room:
        count = count * 3 // 4
    return {
        name: sorted(np.argsort(-spikes, kind="stable")[:count].tolist())
        for name, spikes in differing.items()
    }


def _potentials(
    levels: Levels, recording: Observation, kept: Mapping[str, list[int]]
) -> dict[str, PotentialValues]:
    """Return the potentials of the neurons that are kept, in a single recording."""
    reference, chip = recording.reference.potential, recording.chip.potential
    potentials = {}
    for name, neurons in kept.items():
        scale = levels.quantized.population(name).scale[neurons]
        of_reference = reference[name][0][:, neurons]
        of_chip = chip[name][0][:, neurons] / scale
        sides = np.stack([of_reference, of_chip]).swapaxes(1, 2)
        low = float(sides.min())
        grade = float(np.ptp(sides)) / GRADES or 1.0  # of a potential that never moves
        values = _text(np.rint((sides - low) / grade), "u2")
        potentials[name] = PotentialValues(low, grade, values)
    return potentials


def _population(levels: Levels, population: Population, kept: list[int]) -> PopulationValues:
    name = population.name
    cores = [
        core.number
        for core in levels.program.cores
        if any(piece.group == name for piece in core.slices)
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
    network = levels.network
    phases = [phase.name for phase in network.phases]
    return tuple(
        InputValues(view.name, view.phase, view.lines, network.steps_of(view.phase))
        for view in network.views
        if view.phase in phases
    )


def _places(spikes: AnyArray) -> str:
    return _text(np.flatnonzero(spikes), "u4")


def _text(values: AnyArray, kind: str) -> str:
    return base64.b64encode(values.astype(f"<{kind}").tobytes()).decode()
