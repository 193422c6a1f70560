"""The excerpt of a report: a few steps of one recording, as pictures of its spikes and of one potential.

It shows the input, the spikes of the float network (the *reference*) and of the chip, and the potential of the neuron
that differs first. The limits below keep the pictures readable and the report small; they were chosen by hand.
"""

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
"""Largest number of steps of a phase that is shown."""
MARKS = 5000
"""Largest number of spikes of an input or a population that is shown; if there are more, fewer steps are shown."""
NEURONS = 40
"""Largest number of neurons of a population that is shown: most differences first, then most spikes."""
LINES = 128
"""Largest number of rows of an input that is shown; if there are more lines, neighbours share a row."""
POPULATIONS = 8
"""Largest number of populations that is shown: the first that differs, then in network order."""
AROUND = 20
"""Steps before and after the central one for which the potential is shown."""


class SpikeRows(Frozen, eq=False):
    """The rows of one picture: the spikes of an input, or of a population on both sides.

    ``size`` is the number of lines or neurons, of which some or all are shown. ``reference`` and ``chip`` (steps, rows)
    are 1 if any of the ``together`` neighbouring lines or neurons of a row spikes; ``numbers`` (rows,) are the first of
    each row. An input is the same on both sides.
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
        """Return the rows cut to a range of steps."""
        window = slice(steps.start, steps.stop)
        return replace(self, reference=self.reference[window], chip=self.chip[window])


class NeuronPotential(Frozen, eq=False):
    """The potentials of one neuron that were compared with its threshold, on both sides, from ``first_step`` on.

    Arrays are (steps,), in the units of the float network.
    """

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

    ``first`` is the first spike that differs between the sides; if it is None, they agree and the first recording is
    shown. ``populations_left_out`` is the number of populations that are missing in ``populations``.
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
    """Return the excerpt around the first spike that differs; around the first step if ``first`` is None."""
    network = observed.network
    recording = 0 if first is None else first.recording
    observation = observed.recording(recording)
    reference = observation.reference
    chip_spikes = observation.chip.spikes
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
    # The step in the middle of the excerpt, for the phase in which the sides differ.
    central_step: dict[str, int] = {}
    if first is not None:
        population = observed.levels.quantized.population(first.population).population
        central_step[population.phase] = first.step
    steps: dict[str, range] = {}
    for phase in all_steps:
        pictures = [item for item in (*inputs, *rows) if item.phase == phase]
        steps[phase] = _steps_that_fit(pictures, central_step.get(phase, 0))
    return Excerpt(
        recording=recording,
        first=first,
        steps=steps,
        all_steps=all_steps,
        inputs=tuple(item.during(steps[item.phase]) for item in inputs),
        populations=tuple(item.during(steps[item.phase]) for item in rows),
        populations_left_out=len(network.own_populations) - len(shown),
        potential=_potential(observed.levels, observation, first),
    )


def _populations(network: Network, first: Divergence | None) -> list[Population]:
    """Return the populations to show, in network order."""
    # The sort is stable: the population that differs first comes first, and all others keep their order.
    ranked = sorted(
        network.own_populations, key=lambda p: first is not None and p.name != first.population
    )
    shown = {p.name for p in ranked[:POPULATIONS]}
    return [p for p in network.own_populations if p.name in shown]


def _input(view: InputView, spikes: ByteArray) -> SpikeRows:
    """Return the rows of an input; if it has many lines, neighbours share a row."""
    together = -(-view.lines // LINES)
    # Pad the last row to a whole number of lines.
    padded = np.pad(spikes, ((0, 0), (0, -view.lines % together)))
    rows = padded.reshape(len(spikes), -1, together).max(axis=2)
    return SpikeRows(
        name=view.name,
        axis=view.axis,
        phase=view.phase,
        size=view.lines,
        numbers=np.arange(0, view.lines, together),
        reference=rows,
        chip=rows,
        together=together,
    )


def rows_shown(
    population: Population, reference: ByteArray, chip: ByteArray, first: Divergence | None
) -> SpikeRows:
    """Return the rows of the neurons to show, in network order.

    These are the neuron that differs first, then those with the most differences, then those with the most spikes.
    """
    differences = (reference != chip).sum(axis=0)
    spikes = reference.sum(axis=0, dtype=np.int64)
    if first is not None and first.population == population.name:
        # More than any neuron can differ.
        differences[first.neuron] = len(reference) + 1
    neurons = np.sort(np.lexsort((-spikes, -differences))[:NEURONS])
    return SpikeRows(
        name=population.name,
        axis=population.axis,
        phase=population.phase,
        size=population.size,
        numbers=neurons,
        reference=reference[:, neurons],
        chip=chip[:, neurons],
    )


def _steps_that_fit(pictures: list[SpikeRows], centre: int) -> range:
    """Return as many steps around the centre as fit into every picture of a phase; halve until they do."""
    # The spikes per step of the fullest picture.
    spikes_per_step = np.max(
        [picture.either.sum(axis=1, dtype=np.int64) for picture in pictures], axis=0
    )
    steps = len(spikes_per_step)
    length = min(steps, STEPS)
    while True:
        start = min(max(0, centre - length // 2), steps - length)
        if length <= 1 or spikes_per_step[start : start + length].sum() <= MARKS:
            return range(start, start + length)
        length //= 2


def _potential(
    levels: Levels, observation: Observation, first: Divergence | None
) -> NeuronPotential:
    """Return the potential of the neuron that differs first; if none does, of the readout neuron that spikes most."""
    reference = observation.reference
    if first is None:
        name = levels.network.readout.populations[0]
        neuron = int(reference.spikes[name][0].sum(axis=0, dtype=np.int64).argmax())
        centre = int(reference.spikes[name][0, :, neuron].argmax())  # its first spike
    else:
        name = first.population
        neuron = first.neuron
        centre = first.step
    quantized = levels.quantized.population(name)
    all_steps = levels.network.steps_of(quantized.population.phase)
    steps = range(max(0, centre - AROUND), min(centre + AROUND + 1, all_steps))
    # The observation has one recording, number 0.
    window = (0, slice(steps.start, steps.stop), neuron)
    return NeuronPotential(
        population=name,
        axis=quantized.population.axis,
        neuron=neuron,
        first_step=steps.start,
        reference=reference.potential[name][window].astype(np.float64),
        chip=observation.chip.potential[name][window] / quantized.scale[neuron],
        threshold=float(quantized.population.thresholds[neuron]),
        reference_spikes=reference.spikes[name][window].astype(bool),
        chip_spikes=observation.chip.spikes[name][window].astype(bool),
    )
