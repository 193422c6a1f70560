"""A few steps of one recording to look at: input, spikes of both sides, and the potential that differs first."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hw_model.mapping.graph import Axis
from hw_model.values import BoolArray, ByteArray, FloatArray, Frozen, IntArray, Shown
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.pipeline import Levels
from locsnn_compile.verification.matching import Divergence
from locsnn_compile.verification.observation import Observation, Observed

STEPS = 400
"""Most steps of a phase that are kept."""
MARKS = 5000
"""Most spikes of an input or a population that are kept; if there are more, fewer steps are kept."""
NEURONS = 40
"""Most neurons of a population that are kept: those with the most differences, then those with the most spikes."""
LINES = 128
"""Most rows of an input that are kept; if there are more lines, they share rows."""
POPULATIONS = 8
"""Most populations that are kept: the first that differs, then in network order."""
AROUND = 20
"""Steps before and after the central one for which potentials are kept."""


class SpikeRows(Frozen, eq=False):
    """Spikes of an input, or of a population on both sides: some or all of its ``size`` lines or neurons.

    ``reference`` and ``chip`` (steps, rows) tell whether any of the ``together`` lines or neurons of a row spikes; the
    first of each row are ``numbers`` (rows,). An input is the same on both sides.
    """

    name: str
    axis: Axis
    phase: str
    size: int
    numbers: IntArray
    reference: ByteArray
    chip: ByteArray
    together: int = 1

    @property
    def either(self) -> ByteArray:
        """Spikes on at least one side."""
        return self.reference | self.chip

    def during(self, steps: range) -> "SpikeRows":
        """Return the rows in some steps."""
        window = slice(steps.start, steps.stop)
        return replace(self, reference=self.reference[window], chip=self.chip[window])


class NeuronPotential(Frozen, eq=False):
    """What the threshold of one neuron saw from ``first_step`` on, (steps,), in the reference's units."""

    population: str
    axis: Axis
    neuron: int
    first_step: int
    reference: FloatArray
    chip: FloatArray
    threshold: float
    reference_spikes: BoolArray
    chip_spikes: BoolArray


class Excerpt(Shown):
    """Steps ``steps[phase]``, out of ``all_steps[phase]``, of recording number ``recording``.

    ``first`` is where the sides first differ; it is None if they never do, and the first recording is shown.
    ``populations_left_out`` is the number of those missing in ``populations``.
    """

    recording: int
    first: Divergence | None
    steps: Mapping[str, range]
    all_steps: Mapping[str, int]
    inputs: tuple[SpikeRows, ...]
    populations: tuple[SpikeRows, ...]
    populations_left_out: int
    potential: NeuronPotential


def take_excerpt(observed: Observed, first: Divergence | None) -> Excerpt:
    """Keep what the pictures of one recording need; ``first`` is where the sides first diverge."""
    network = observed.network
    recording = 0 if first is None else first.recording
    seen = observed.recording(recording)
    reference = seen.reference
    chip_spikes = seen.chip.spikes
    shown = _populations(network, first)
    all_steps = {phase.name: network.steps_of(phase.name) for phase in network.phases}
    inputs = [
        _input(view, reference.spikes[view.name][0])
        for view in network.views
        if view.phase in all_steps
    ]
    rows = [
        rows_shown(p, reference.spikes[p.name][0], chip_spikes[p.name][0], first) for p in shown
    ]
    central = (
        {}
        if first is None
        else {observed.levels.quantized.population(first.population).population.phase: first.step}
    )
    steps = {
        phase: _window(
            [item for item in (*inputs, *rows) if item.phase == phase], central.get(phase, 0)
        )
        for phase in all_steps
    }
    return Excerpt(
        recording=recording,
        first=first,
        steps=steps,
        all_steps=all_steps,
        inputs=tuple(item.during(steps[item.phase]) for item in inputs),
        populations=tuple(item.during(steps[item.phase]) for item in rows),
        populations_left_out=len(network.own_populations) - len(shown),
        potential=_potential(observed.levels, seen, first),
    )


def _populations(network: Network, first: Divergence | None) -> list[Population]:
    """Return the populations to keep, in network order."""
    ranked = sorted(
        network.own_populations, key=lambda p: first is not None and p.name != first.population
    )
    kept = {p.name for p in ranked[:POPULATIONS]}
    return [p for p in network.own_populations if p.name in kept]


def _input(view: InputView, spikes: ByteArray) -> SpikeRows:
    """Return the rows of an input; if it has many lines, neighbours share a row."""
    together = -(-view.lines // LINES)
    padded = np.pad(spikes, ((0, 0), (0, -view.lines % together)))
    rows, numbers = (
        padded.reshape(len(spikes), -1, together).max(axis=2),
        np.arange(0, view.lines, together),
    )
    return SpikeRows(view.name, view.axis, view.phase, view.lines, numbers, rows, rows, together)


def rows_shown(
    population: Population, reference: ByteArray, chip: ByteArray, first: Divergence | None
) -> SpikeRows:
    """Keep the neuron that differs first, those with the most differences, then the busiest; in network order."""
    differences = (reference != chip).sum(axis=0)
    spikes = reference.sum(axis=0, dtype=np.int64)
    if first is not None and first.population == population.name:
        differences[first.neuron] = len(reference) + 1
    neurons = np.sort(np.lexsort((-spikes, -differences))[:NEURONS])
    name, axis, phase = population.name, population.axis, population.phase
    return SpikeRows(
        name, axis, phase, population.size, neurons, reference[:, neurons], chip[:, neurons]
    )


def _window(drawn: list[SpikeRows], centre: int) -> range:
    """Return as many steps around the centre as fit into every picture of a phase."""
    a_step = np.max([item.either.sum(axis=1, dtype=np.int64) for item in drawn], axis=0)
    steps = len(a_step)
    length = min(steps, STEPS)
    while True:
        start = min(max(0, centre - length // 2), steps - length)
        if length <= 1 or a_step[start : start + length].sum() <= MARKS:
            return range(start, start + length)
        length //= 2


def _potential(levels: Levels, seen: Observation, first: Divergence | None) -> NeuronPotential:
    """Keep the potential that differs first or, if none does, that of the readout neuron that spikes most."""
    reference = seen.reference
    if first is None:
        name = levels.network.readout.populations[0]
        neuron = int(reference.spikes[name][0].sum(axis=0, dtype=np.int64).argmax())
        centre = int(reference.spikes[name][0, :, neuron].argmax())
    else:
        name, neuron, centre = first.population, first.neuron, first.step
    quantized = levels.quantized.population(name)
    last = levels.network.steps_of(quantized.population.phase)
    steps = range(max(0, centre - AROUND), min(centre + AROUND + 1, last))
    window = (0, slice(steps.start, steps.stop), neuron)
    return NeuronPotential(
        population=name,
        axis=quantized.population.axis,
        neuron=neuron,
        first_step=steps.start,
        reference=reference.potential[name][window].astype(np.float64),
        chip=seen.chip.potential[name][window] / quantized.scale[neuron],
        threshold=float(quantized.population.thresholds[neuron]),
        reference_spikes=reference.spikes[name][window].astype(bool),
        chip_spikes=seen.chip.spikes[name][window].astype(bool),
    )
