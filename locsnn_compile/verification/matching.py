"""Float reference against chip, spike by spike, over a set of recordings."""

import math
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

import hw_model as hw
from hw_model.accounting.cost import Latency
from hw_model.accounting.usage import PhaseUsage, measure, total_ns
from hw_model.description.counts import Counts, total
from hw_model.description.profile import Range
from hw_model.rtl.device import latencies as core_latencies
from hw_model.values import ByteArray, FloatArray, Frozen, IntArray, Shown, Sums, picked
from locsnn_compile.baselines.operations import network_additions
from locsnn_compile.cluster.spread import Spread, here
from locsnn_compile.errors import InputError, check_same
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.verification.chance import Chance, chance_of

CHUNK = 16
"""Recordings held at a time, so memory does not grow with their number."""

Progress = Callable[[int, int], None]
"""Called with what is done and what there is to do: recordings, settings or rows."""
Place = tuple[int, str, int, int]
"""Recording, population, neuron and step of a spike."""


class PopulationMatch(Sums):
    """Spikes of one population in the reference, on the chip, and at the same neuron and step in both."""

    reference_spikes: int = 0
    chip_spikes: int = 0
    common_spikes: int = 0

    @property
    def mismatches(self) -> int:
        """Spikes on one side only."""
        return self.reference_spikes + self.chip_spikes - 2 * self.common_spikes

    @property
    def agreement(self) -> float | None:
        """``2 * common / (reference + chip)``; None if neither side spikes, so nothing was compared."""
        both = self.reference_spikes + self.chip_spikes
        return 2 * self.common_spikes / both if both else None

    @classmethod
    def of(cls, reference: ByteArray, chip: ByteArray) -> "PopulationMatch":
        """Count the spikes (batch, steps, n) of both sides."""
        return cls(int(reference.sum()), int(chip.sum()), int((reference & chip).sum()))


class ScoreMatch(Sums):
    """``scores`` class scores in the network's units.

    ``spread`` adds up how far the reference's scores are from the mean of their recording, ``error`` how far the chip's
    are from the reference's.
    """

    scores: int = 0
    spread: float = 0.0
    error: float = 0.0

    @classmethod
    def of(cls, reference: FloatArray, chip: FloatArray) -> "ScoreMatch":
        """Compare the scores (batch, classes) of both sides."""
        spread, error = reference - reference.mean(axis=1, keepdims=True), chip - reference
        return cls(reference.size, float(np.abs(spread).sum()), float(np.abs(error).sum()))

    @property
    def mean_spread(self) -> float:
        """Mean distance of a score of the reference from the mean of its recording."""
        return self.spread / self.scores

    @property
    def mean_error(self) -> float:
        """Mean distance of a score of the chip from that of the reference."""
        return self.error / self.scores

    @property
    def relative_error(self) -> float | None:
        """The error as a share of the spread; None if all scores of the reference tie, so there is no spread."""
        return self.error / self.spread if self.spread else None


class Divergence(Frozen):
    """The first spike that differs: both potentials in the float network's units, before any reset."""

    recording: int
    population: str
    neuron: int
    step: int
    reference_potential: float
    chip_potential: float
    threshold: float


class _Figures(Frozen, eq=False):
    """Figures of recordings that parts of them add up to.

    ``counts`` are the chip's counts for every recording, and ``latencies`` their times under the default profile.
    ``usage`` is, by phase, what cores did step by step; ``additions`` are the reference's operations by phase over all
    recordings. ``member_ns`` is the time of each member of a committee over all recordings, if its cores ran by
    themselves.
    """

    scores: ScoreMatch
    counts: tuple[Counts, ...]
    counts_by_phase: dict[str, Counts]
    wraps_and_clips: dict[str, dict[str, int]]
    latencies: tuple[Latency, ...]
    usage: dict[str, PhaseUsage]
    additions: dict[str, int]
    member_ns: dict[str, float]


class Match(Shown, _Figures):
    """How a program compares with the network it came from, over ``samples`` recordings.

    ``reference_prediction`` and ``chip_prediction`` are classes (samples,), or -1 if all scores tie and nothing was
    predicted; ``labels`` are (samples,) or None. ``helpers`` are populations that a frontend added, which count nowhere
    else. ``latency_range_ns`` is the range of the mean latency if the profile has ranges.
    """

    samples: int
    events_source: str
    reference_prediction: IntArray
    chip_prediction: IntArray
    labels: IntArray | None
    by_population: dict[str, PopulationMatch]
    helpers: dict[str, PopulationMatch]
    first_divergence: Divergence | None
    latency_range_ns: Range

    @property
    def spikes(self) -> PopulationMatch:
        """All populations together."""
        return sum(self.by_population.values(), start=PopulationMatch())

    @property
    def mean_ns(self) -> float:
        """Mean time per recording."""
        return float(np.mean([one.total_ns for one in self.latencies]))

    @property
    def tied_predictions(self) -> int:
        """Recordings for which neither side predicts a class."""
        return int((np.maximum(self.reference_prediction, self.chip_prediction) < 0).sum())

    @property
    def prediction_agreement(self) -> float | None:
        """Share of same classes among the recordings for which a side predicts one; None if there are none."""
        same = (
            int((self.reference_prediction == self.chip_prediction).sum()) - self.tied_predictions
        )
        predicted = self.samples - self.tied_predictions
        return same / predicted if predicted else None

    @property
    def accuracy(self) -> dict[str, float] | None:
        """Share of correct predictions of the reference and of the chip; a tie is wrong. None without labels."""
        if self.labels is None:
            return None
        return {
            "reference": float((self.reference_prediction == self.labels).mean()),
            "chip": float((self.chip_prediction == self.labels).mean()),
        }

    @property
    def chance(self) -> Chance | None:
        """Whether the chip's accuracy can be told from chance; None without labels, or with too few."""
        return None if self.labels is None else chance_of(self.chip_prediction, self.labels)


def compare(
    quantized: QuantizedNetwork,
    program: hw.ChipProgram,
    recordings: ByteArray,
    *,
    labels: IntArray | None = None,
    source: str = "array",
    progress: Progress | None = None,
    spread: Spread = here,
    explain: bool = True,
) -> Match:
    """Play recordings (samples, steps, channels) to both sides, some at a time, and compare every spike and score.

    ``explain``: play the recording with the first difference again, and keep both potentials there.
    """
    network = quantized.network
    recordings = network.fit(recordings, source)
    check_labels(network, labels, len(recordings), source)
    helpers = {p.name for p in network.populations if p.helper}
    both: _Part | None = None
    chunks = (
        (start, recordings[start : start + CHUNK]) for start in range(0, len(recordings), CHUNK)
    )
    for part in spread(partial(_compare_part, network, program, quantized.score_scale), chunks):
        both = both + part if both else part
        if progress:
            progress(len(both.counts), len(recordings))
    assert both is not None  # there is at least one recording
    assert total(both.counts) == total(both.counts_by_phase.values())
    first = explain and both.differences
    least, most = (
        both.ends_ns[end] / len(recordings) if end in both.ends_ns else None
        for end in ("least", "most")
    )
    reference, chip = (np.concatenate(side) for side in zip(*both.predictions, strict=True))
    return Match(
        samples=len(recordings),
        events_source=source,
        reference_prediction=reference,
        chip_prediction=chip,
        labels=labels,
        by_population={name: found for name, found in both.matches.items() if name not in helpers},
        helpers={name: found for name, found in both.matches.items() if name in helpers},
        first_divergence=_explain(quantized, program, recordings, first[0]) if first else None,
        latency_range_ns=(least, most),
        **picked(both, *_Figures.__dataclass_fields__),
    )


class _Part(Sums, _Figures, eq=False):
    """The match of some recordings, as in :class:`Match`, and their time at both ends of the profile's ranges.

    ``differences`` has the first difference of each part, and ``predictions`` those of both sides in each part.
    """

    matches: dict[str, PopulationMatch]
    differences: tuple[Place, ...]
    predictions: tuple[tuple[IntArray, IntArray], ...]
    ends_ns: dict[str, float]


def _compare_part(
    network: Network, program: hw.ChipProgram, score_scale: float, numbered: tuple[int, ByteArray]
) -> _Part:
    """Play recordings to both sides; they come with the number of the first one."""
    start, recordings = numbered
    wanted = evaluate(network, recordings, registers=program.chip.registers)
    found = hw.simulate(program, recordings, probe=("spikes", "activity"))
    assert found.scores is not None  # a network has a readout
    profile = program.chip.costs
    latencies, usage = measure(program, found.activity, profile)
    if program.chip.open_core:
        latencies = core_latencies(program, recordings, found.spikes)
    return _Part(
        matches={
            p.name: PopulationMatch.of(wanted.spikes[p.name], found.spikes[p.name])
            for p in network.populations
        },
        differences=_first_difference(network, wanted.spikes, found.spikes, start),
        predictions=(
            (network.readout.decided(wanted.scores), network.readout.decided(found.scores)),
        ),
        scores=ScoreMatch.of(wanted.scores, found.scores / score_scale),
        counts=found.per_recording,
        counts_by_phase=found.counts_by_phase,
        wraps_and_clips={name: dict(events) for name, events in found.events.items()},
        latencies=tuple(latencies),
        usage=usage,
        ends_ns={
            end: math.fsum(one.total_ns for one in latencies)
            if its.time_ns == profile.time_ns
            else total_ns(program, found.activity, its)
            for end in ("least", "most")
            if (its := profile.with_times(end))
        },
        additions=network_additions(network, wanted.spikes),
        member_ns={
            its.name: total_ns(program, found.activity, profile, f"{its.name}/")
            for its in network.members
        },
    )


def check_labels(network: Network, labels: IntArray | None, samples: int, source: str) -> None:
    """Refuse labels (samples,) that are not classes of the network, or too few or many."""
    if labels is None:
        return
    where, fix = f"labels of {source!r}", "Give one class number for every recording."
    check_same(labels.shape, (samples,), where, "there is not one label per recording", fix=fix)
    if labels.min() < 0 or labels.max() >= network.classes:
        measured = f"{labels.min()}..{labels.max()} against 0..{network.classes - 1}"
        fix = "Check that the events belong to this model."
        raise InputError(
            where, "a label is not one of the model's classes", measured=measured, fix=fix
        )


def _first_difference(
    network: Network, wanted: Mapping[str, ByteArray], found: Mapping[str, ByteArray], start: int
) -> tuple[Place, ...]:
    """Return the first difference by recording, phase, step and network order, if there is any."""
    rows, order = [], [phase.name for phase in network.phases]
    for rank, population in enumerate(network.own_populations):
        differs = np.argwhere(wanted[population.name] != found[population.name])
        if len(differs):
            recording, step, neuron = (int(i) for i in differs[0])
            rows.append((recording, order.index(population.phase), step, rank, neuron))
    if not rows:
        return ()
    recording, _, step, rank, neuron = min(rows)
    return ((start + recording, network.own_populations[rank].name, neuron, step),)


def _explain(
    quantized: QuantizedNetwork, program: hw.ChipProgram, recordings: ByteArray, place: Place
) -> Divergence:
    recording, name, neuron, step = place
    one = recordings[recording : recording + 1]
    reference = evaluate(quantized.network, one, potentials=True, registers=program.chip.registers)
    wanted = reference.potential[name][0, step, neuron]
    found = hw.simulate(program, one, probe=("potential",)).potential[name][0, step, neuron]
    population = quantized.population(name)
    potential, threshold = (
        found / population.scale[neuron],
        population.population.thresholds[neuron],
    )
    return Divergence(*place, float(wanted), float(potential), float(threshold))
