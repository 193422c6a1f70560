"""Compare the float reference with the chip, spike by spike, over a set of recordings.

:func:`compare` plays recordings to both sides in batches, possibly on several processes. The result of a batch
(:class:`_Part`) is a record whose fields can be added, so memory does not grow with the number of recordings.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

import hw_model as hw
from hw_model.accounting.cost import Latency
from hw_model.accounting.usage import PhaseUsage, total_ns
from hw_model.description.counts import Counts, total
from hw_model.description.profile import End, Range
from hw_model.targets import target_of
from hw_model.values import ByteArray, FloatArray, Frozen, IntArray, Shown, Sums, picked
from locsnn_compile.baselines.operations import network_additions
from locsnn_compile.cluster.spread import Spread, here
from locsnn_compile.data.recordings import batches
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.reference.evaluate import FloatRuns, ReferenceResult
from locsnn_compile.verification.chance import Chance, chance_of
from locsnn_compile.verification.first_difference import SpikePlace, first_difference
from locsnn_compile.verification.observation import Observation, Observed

ENDS: tuple[End, ...] = ("least", "most")
"""Both ends of the ranges of a profile."""
Progress = Callable[[int, int], None]
"""Called with the number of things done and the number of all: recordings, settings or rows."""


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
        """``2 * common / (reference + chip)``, the Dice coefficient; None if neither side spikes."""
        both = self.reference_spikes + self.chip_spikes
        return 2 * self.common_spikes / both if both else None

    @classmethod
    def of(cls, reference: ByteArray, chip: ByteArray) -> "PopulationMatch":
        """Count the spikes (batch, steps, n) of both sides."""
        # The minimum, because neurons of some chips spike several times in a step.
        common = np.minimum(reference, chip)
        return cls(int(reference.sum()), int(chip.sum()), int(common.sum()))


class ScoreMatch(Sums):
    """The differences of class scores, in the network's units, as sums over ``scores`` scores.

    ``spread`` is the sum of the distances of the reference's scores from the mean of their recording, ``error`` the sum
    of the distances of the chip's scores from the reference's.
    """

    scores: int = 0
    spread: float = 0.0
    error: float = 0.0

    @classmethod
    def of(cls, reference: FloatArray, chip: FloatArray) -> "ScoreMatch":
        """Compare the scores (batch, classes) of both sides."""
        spread = reference - reference.mean(axis=1, keepdims=True)
        error = chip - reference
        return cls(
            scores=reference.size,
            spread=float(np.abs(spread).sum()),
            error=float(np.abs(error).sum()),
        )

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
    """The first spike that differs, with both potentials there, in the float network's units, before any reset."""

    recording: int
    population: str
    neuron: int
    step: int
    reference_potential: float
    chip_potential: float
    threshold: float


class _Figures(Frozen, eq=False):
    """Figures of recordings that are sums, or lists joined, over parts of the recordings.

    - ``counts``: the chip's counts for every recording, and ``latencies``, their times under the default profile
    - ``counts_by_phase``: the chip's counts over all recordings
    - ``wraps_and_clips``: counts of each kind, by group of compartments
    - ``usage``: by phase, what cores did step by step
    - ``additions``: the reference's operations by phase over all recordings
    - ``member_ns``: the time of each member of a committee over all recordings, if its cores ran by themselves
    """

    scores: ScoreMatch
    counts: tuple[Counts, ...]
    counts_by_phase: dict[str, Counts]
    wraps_and_clips: dict[str, dict[str, int]]
    latencies: tuple[Latency, ...]
    usage: dict[str, PhaseUsage]
    additions: dict[str, int]
    member_ns: dict[str, float]


class Agreement(Shown):
    """How a program agrees with the network it came from, over ``samples`` recordings, on any kind of chip.

    ``reference_prediction`` and ``chip_prediction`` are classes (samples,), or -1 where all scores
    tie and nothing is predicted; ``labels`` are (samples,) or None. ``helpers`` are the matches of populations that a
    frontend added; all other figures leave these populations out.
    """

    samples: int
    events_source: str
    reference_prediction: IntArray
    chip_prediction: IntArray
    labels: IntArray | None
    by_population: dict[str, PopulationMatch]
    helpers: dict[str, PopulationMatch]
    scores: ScoreMatch
    first_divergence: Divergence | None

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
        """Share of recordings with equal predictions, among those for which a side predicts; None if there are none."""
        equal = int((self.reference_prediction == self.chip_prediction).sum())
        # Where neither side predicts, both are -1: equal, but no prediction.
        equal_classes = equal - self.tied_predictions
        predicted = self.samples - self.tied_predictions
        return equal_classes / predicted if predicted else None

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
        """Whether the chip's accuracy differs significantly from chance; None without labels, or with too few."""
        return None if self.labels is None else chance_of(self.chip_prediction, self.labels)


class Match(Agreement, _Figures):
    """The match of a program for a mesh or the open core, with what the chip counted.

    ``latency_range_ns`` is the range of the mean latency if the profile has ranges.
    """

    latency_range_ns: Range

    @property
    def mean_ns(self) -> float:
        """Mean time per recording."""
        return float(np.mean([latency.total_ns for latency in self.latencies]))


def compare(
    observed: Observed,
    *,
    progress: Progress | None = None,
    spread: Spread = here,
    explain: bool = True,
    float_runs: FloatRuns | None = None,
) -> Match:
    """Play all recordings to both sides, a batch at a time, and compare every spike and score.

    - ``progress``: called with the number of recordings after every batch
    - ``spread``: where the batches run, by default one after the other in this process
    - ``explain``: play the recording with the first difference again, and keep both potentials there
    - ``float_runs``: the float network's side of these recordings, if others need it as well
    """
    levels = observed.levels
    compare_batch = partial(_compare_batch, levels.quantized, levels.program)
    all_batches: _Part | None = None
    for part in spread(compare_batch, _numbered(observed, float_runs)):
        all_batches = all_batches + part if all_batches else part
        if progress:
            progress(len(all_batches.counts), len(observed))
    assert all_batches is not None  # there is at least one recording
    # Two ways to count the same operations.
    assert total(all_batches.counts) == total(all_batches.counts_by_phase.values())
    references, chips = zip(*all_batches.predictions, strict=True)
    first_divergence = None
    if explain and all_batches.differences:
        # Parts are in the order of the recordings.
        first_divergence = _explain(observed, all_batches.differences[0])
    helpers = {p.name for p in observed.network.populations if p.helper}
    matches = all_batches.matches
    return Match(
        samples=len(observed),
        events_source=observed.source,
        reference_prediction=np.concatenate(references),
        chip_prediction=np.concatenate(chips),
        labels=observed.labels,
        by_population={name: match for name, match in matches.items() if name not in helpers},
        helpers={name: match for name, match in matches.items() if name in helpers},
        first_divergence=first_divergence,
        latency_range_ns=_mean_range(all_batches.ends_ns, len(observed)),
        **picked(all_batches, *_Figures.__dataclass_fields__),
    )


def _mean_range(ends_ns: Mapping[str, float], samples: int) -> Range:
    """Return the least and the most mean time; None for ends that the profile does not have."""
    least, most = (ends_ns[end] / samples if end in ends_ns else None for end in ENDS)
    return least, most


class _Part(Sums, _Figures, eq=False):
    """The match of a batch of recordings, as in :class:`Match`; parts can be added.

    - ``matches``: those of all populations, by name
    - ``differences``: the first difference of each batch that has any
    - ``predictions``: those of both sides in each batch
    - ``ends_ns``: the time of all recordings at both ends of the profile's ranges
    """

    matches: dict[str, PopulationMatch]
    differences: tuple[SpikePlace, ...]
    predictions: tuple[tuple[IntArray, IntArray], ...]
    ends_ns: dict[str, float]


class _Numbered(Frozen, eq=False):
    """A batch of recordings, the number of its first recording, and what the float network does if that is known."""

    first: int
    recordings: ByteArray
    known_reference: ReferenceResult | None


def _numbered(observed: Observed, float_runs: FloatRuns | None) -> Iterator[_Numbered]:
    """Yield the recordings, a batch at a time."""
    for rows in batches(len(observed)):
        known = None if float_runs is None else float_runs.batch(rows)
        yield _Numbered(rows.start, observed.recordings[rows], known)


def _compare_batch(quantized: QuantizedNetwork, program: hw.ChipProgram, batch: _Numbered) -> _Part:
    """Play a batch to both sides, and compare them."""
    network = quantized.network
    observation = Observation(
        quantized, program, batch.recordings, known_reference=batch.known_reference
    )
    reference = observation.reference
    chip = observation.chip
    assert chip.scores is not None  # a network has a readout
    profile = program.chip.costs
    target = target_of(program.chip)
    latencies, usage = target.measure(program, batch.recordings, chip.activity, chip.spikes)
    return _Part(
        matches={
            p.name: PopulationMatch.of(reference.spikes[p.name], chip.spikes[p.name])
            for p in network.populations
        },
        differences=_first_difference(network, reference, chip, batch.first),
        predictions=(
            (network.readout.decided(reference.scores), network.readout.decided(chip.scores)),
        ),
        scores=ScoreMatch.of(reference.scores, chip.scores / quantized.score_scale),
        counts=chip.per_recording,
        counts_by_phase=chip.counts_by_phase,
        wraps_and_clips={name: dict(events) for name, events in chip.events.items()},
        latencies=tuple(latencies),
        usage=usage,
        ends_ns=_times_at_ends(program, chip, latencies),
        additions=network_additions(network, reference.spikes),
        member_ns={
            member.name: total_ns(program, chip.activity, profile, f"{member.name}/")
            for member in network.members
        },
    )


def _times_at_ends(
    program: hw.ChipProgram, chip: hw.SimulationResult, latencies: Sequence[Latency]
) -> dict[str, float]:
    """Return the time of all recordings at either end of the profile's ranges, as far as it has them."""
    profile = program.chip.costs
    times: dict[str, float] = {}
    for end in ENDS:
        at_end = profile.with_times(end)
        if at_end is None:
            continue
        if at_end.time_ns == profile.time_ns:
            times[end] = math.fsum(latency.total_ns for latency in latencies)
        else:
            times[end] = total_ns(program, chip.activity, at_end)
    return times


def _first_difference(
    network: Network, reference: ReferenceResult, chip: hw.SimulationResult, first_recording: int
) -> tuple[SpikePlace, ...]:
    """Return the first difference of a batch that begins with ``first_recording``, if there is any."""
    place = first_difference(network, reference.spikes, chip.spikes)
    if place is None:
        return ()
    return (place._replace(recording=first_recording + place.recording),)


def _explain(observed: Observed, place: SpikePlace) -> Divergence:
    """Play the recording of a difference again, and return both potentials there."""
    recording, name, neuron, step = place
    observation = observed.recording(recording)
    population = observed.levels.quantized.population(name)
    reference_potential = observation.reference.potential[name][0, step, neuron]
    chip_potential = observation.chip.potential[name][0, step, neuron] / population.scale[neuron]
    threshold = population.population.thresholds[neuron]
    return Divergence(*place, float(reference_potential), float(chip_potential), float(threshold))
