"""Float reference against chip, spike by spike, over a set of recordings."""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, field
from functools import partial

import numpy as np

import hw_model as hw
from hw_model.accounting.cost import Latency
from hw_model.accounting.usage import PhaseUsage, added_usage, measure, total_ns
from hw_model.arithmetic.arrays import ByteArray, IntArray
from hw_model.description.counts import Counts, total
from hw_model.description.profile import Profile, Range
from hw_model.values import Frozen, Shown
from locsnn_compile.baselines.operations import network_additions
from locsnn_compile.cluster.spread import Spread, here
from locsnn_compile.errors import InputError
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.reference.evaluate import decided, evaluate

CHUNK = 16
"""Recordings held at a time: memory does not grow with their number."""

Progress = Callable[[int, int], None]
"""Called with (recordings done, recordings in all)."""
Place = tuple[int, str, int, int]
"""Recording, population, neuron and step of a spike."""


class PopulationMatch(Frozen):
    """Spikes of one population in the reference, on the chip, and at the same neuron and step in both."""

    reference_spikes: int = 0
    chip_spikes: int = 0
    common_spikes: int = 0

    @property
    def mismatches(self) -> int:
        """Spikes that only one side has."""
        return self.reference_spikes + self.chip_spikes - 2 * self.common_spikes

    @property
    def agreement(self) -> float | None:
        """``2 * common / (reference + chip)``; None where neither side spikes: nothing was compared."""
        both = self.reference_spikes + self.chip_spikes
        return 2 * self.common_spikes / both if both else None

    @classmethod
    def of(cls, reference: ByteArray, chip: ByteArray) -> "PopulationMatch":
        """Count the spikes (batch, steps, n) of both sides."""
        return cls(int(reference.sum()), int(chip.sum()), int((reference & chip).sum()))

    def __add__(self, other: "PopulationMatch") -> "PopulationMatch":
        return PopulationMatch(*map(operator.add, astuple(self), astuple(other)))


class Divergence(Frozen):
    """The first spike that differs: both potentials in the float network's units, before any reset."""

    recording: int
    population: str
    neuron: int
    step: int
    reference_potential: float
    chip_potential: float
    threshold: float


class Match(Shown):
    """How a program compares with the network it came from, over ``samples`` recordings.

    ``reference_prediction`` and ``chip_prediction`` are classes (samples,), -1 where all scores tie: nothing was
    predicted; ``labels`` likewise or None. ``helpers`` are the populations that a frontend made up, which count for
    nothing else. ``counts`` holds the chip's counts of every recording, ``latencies`` their times under the default
    profile, and ``latency_range_ns`` the least and most of their mean where the profile has ranges; ``usage`` says by
    phase what they did step by step, ``additions`` the reference's operations by phase over all recordings.
    """

    samples: int
    events_source: str
    reference_prediction: IntArray
    chip_prediction: IntArray
    labels: IntArray | None
    by_population: dict[str, PopulationMatch]
    helpers: dict[str, PopulationMatch]
    first_divergence: Divergence | None
    counts: tuple[Counts, ...]
    counts_by_phase: dict[str, Counts]
    wraps_and_clips: dict[str, dict[str, int]]
    latencies: tuple[Latency, ...]
    latency_range_ns: Range
    usage: dict[str, PhaseUsage]
    additions: dict[str, int] = field(default_factory=dict)

    @property
    def spikes(self) -> PopulationMatch:
        """All populations together."""
        return sum(self.by_population.values(), start=PopulationMatch())

    @property
    def tied_predictions(self) -> int:
        """Recordings for which neither side predicts a class."""
        return int((np.maximum(self.reference_prediction, self.chip_prediction) < 0).sum())

    @property
    def prediction_agreement(self) -> float | None:
        """Share of the recordings that a side predicts for which both predict the same class; None without any."""
        same = int((self.reference_prediction == self.chip_prediction).sum()) - self.tied_predictions
        predicted = self.samples - self.tied_predictions
        return same / predicted if predicted else None

    @property
    def accuracy(self) -> dict[str, float] | None:
        """Share of recordings predicted right, by the reference and by the chip, a tie being wrong; None unlabelled."""
        if self.labels is None:
            return None
        return {
            "reference": float((self.reference_prediction == self.labels).mean()),
            "chip": float((self.chip_prediction == self.labels).mean()),
        }


def compare(
    quantized: QuantizedNetwork,
    program: hw.ChipProgram,
    recordings: ByteArray,
    *,
    labels: IntArray | None = None,
    source: str = "array",
    progress: Progress | None = None,
    spread: Spread = here,
) -> Match:
    """Play recordings (samples, steps, channels) to both sides, some at a time, and compare every spike."""
    network = quantized.network
    recordings = network.fit(recordings, source)
    _check_labels(network, labels, len(recordings), source)
    matches = {p.name: PopulationMatch() for p in network.populations}
    helpers = {p.name for p in network.populations if p.helper}
    predictions: list[tuple[IntArray, IntArray]] = []
    counts: list[Counts] = []
    by_phase: dict[str, Counts] = {phase.name: Counts() for phase in program.phases}
    wraps_and_clips: dict[str, dict[str, int]] = {}
    latencies: list[Latency] = []
    usage: dict[str, PhaseUsage] = {}
    ends_ns = [0.0, 0.0]
    additions: dict[str, int] = dict.fromkeys((phase.name for phase in network.phases), 0)
    first: Place | None = None
    chunks = ((start, recordings[start : start + CHUNK]) for start in range(0, len(recordings), CHUNK))
    for part in spread(partial(_compare_part, network, program), chunks):
        for name in matches:
            matches[name] += part.matches[name]
        first = first or part.first
        predictions.append(part.predictions)
        counts += part.counts
        for phase, added in part.by_phase.items():
            by_phase[phase] += added
        for name, events in part.wraps_and_clips.items():
            before = wraps_and_clips.setdefault(name, dict.fromkeys(events, 0))
            wraps_and_clips[name] = {event: before[event] + n for event, n in events.items()}
        latencies += part.latencies
        usage = added_usage((usage, part.usage))
        for i, ns in enumerate(part.ends_ns):
            ends_ns[i] += ns
        for phase, n in part.additions.items():
            additions[phase] += n
        if progress:
            progress(len(counts), len(recordings))
    reference, chip = (np.concatenate(side) for side in zip(*predictions, strict=True))
    assert total(counts) == total(by_phase.values())
    return Match(
        samples=len(recordings),
        events_source=source,
        reference_prediction=reference,
        chip_prediction=chip,
        labels=labels,
        by_population={name: found for name, found in matches.items() if name not in helpers},
        helpers={name: found for name, found in matches.items() if name in helpers},
        first_divergence=None if first is None else _explain(quantized, program, recordings, first),
        counts=tuple(counts),
        counts_by_phase=by_phase,
        wraps_and_clips=wraps_and_clips,
        latencies=tuple(latencies),
        latency_range_ns=_mean_range(program, ends_ns, len(recordings)),
        usage=usage,
        additions=additions,
    )


class _Part(Frozen, eq=False):
    """What some recordings did: as in :class:`Match`, and their time at both ends of the default profile's ranges."""

    matches: dict[str, PopulationMatch]
    first: Place | None
    predictions: tuple[IntArray, IntArray]
    counts: tuple[Counts, ...]
    by_phase: dict[str, Counts]
    wraps_and_clips: Mapping[str, Mapping[str, int]]
    latencies: list[Latency]
    usage: dict[str, PhaseUsage]
    ends_ns: list[float]
    additions: dict[str, int]


def _compare_part(network: Network, program: hw.ChipProgram, numbered: tuple[int, ByteArray]) -> _Part:
    """Play recordings, of which the first has a number, to both sides."""
    start, recordings = numbered
    wanted = evaluate(network, recordings, registers=program.chip.registers)
    found = hw.simulate(program, recordings, probe=("spikes", "activity"))
    assert found.scores is not None  # a network has a readout
    profile = program.chip.profile(program.chip.default_profile)
    latencies, usage = measure(program, found.activity, profile)
    return _Part(
        matches={p.name: PopulationMatch.of(wanted.spikes[p.name], found.spikes[p.name]) for p in network.populations},
        first=_first_difference(network, wanted.spikes, found.spikes, start),
        predictions=(decided(wanted.scores), decided(found.scores)),
        counts=found.per_recording,
        by_phase=found.counts_by_phase,
        wraps_and_clips=found.events,
        latencies=latencies,
        usage=usage,
        ends_ns=[
            sum(one.total_ns for one in latencies)
            if end is None or end.time_ns == profile.time_ns
            else total_ns(program, found.activity, end)
            for end in _ends(program)
        ],
        additions=network_additions(network, wanted.spikes),
    )


def _ends(program: hw.ChipProgram) -> list[Profile | None]:
    profile = program.chip.profile(program.chip.default_profile)
    return [profile.with_times(end) for end in ("least", "most")]


def _mean_range(program: hw.ChipProgram, sums: Sequence[float], recordings: int) -> Range:
    """Return the least and most of a mean; None where an end is not known."""
    least, most = (None if end is None else ns / recordings for end, ns in zip(_ends(program), sums, strict=True))
    return least, most


def _check_labels(network: Network, labels: IntArray | None, samples: int, source: str) -> None:
    if labels is None:
        return
    if labels.shape != (samples,):
        raise InputError(
            f"labels of {source!r}",
            "there is not one label per recording",
            measured=f"{labels.shape} against ({samples},)",
            fix="Give one class number for every recording.",
        )
    if labels.min() < 0 or labels.max() >= network.classes:
        raise InputError(
            f"labels of {source!r}",
            "a label is none of the model's classes",
            measured=f"{labels.min()}..{labels.max()} against 0..{network.classes - 1}",
            fix="Check that the events belong to this model.",
        )


def _first_difference(
    network: Network, wanted: Mapping[str, ByteArray], found: Mapping[str, ByteArray], start: int
) -> Place | None:
    """Return the place that is first by recording, phase, step and network order."""
    rows, order = [], [phase.name for phase in network.phases]
    for rank, population in enumerate(network.own_populations):
        differs = np.argwhere(wanted[population.name] != found[population.name])
        if len(differs):
            recording, step, neuron = (int(i) for i in differs[0])
            rows.append((recording, order.index(population.phase), step, rank, neuron))
    if not rows:
        return None
    recording, _, step, rank, neuron = min(rows)
    return start + recording, network.own_populations[rank].name, neuron, step


def _explain(quantized: QuantizedNetwork, program: hw.ChipProgram, recordings: ByteArray, place: Place) -> Divergence:
    recording, name, neuron, step = place
    one = recordings[recording : recording + 1]
    reference = evaluate(quantized.network, one, potentials=True, registers=program.chip.registers)
    wanted = reference.potential[name][0, step, neuron]
    found = hw.simulate(program, one, probe=("potential",)).potential[name][0, step, neuron]
    population = quantized.population(name)
    potential, threshold = found / population.scale[neuron], population.population.thresholds[neuron]
    return Divergence(*place, float(wanted), float(potential), float(threshold))
