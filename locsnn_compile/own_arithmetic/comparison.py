"""Compare the float network with a program of any chip family, spike by spike, batch by batch.

A family only says what its program did on a batch (:class:`ProgramRun`). The rest is the same for all families: the
match of the batch with the network, the first spike that differs, and the sum over batches. Batches bound the memory.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import reduce
from operator import add
from typing import Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np

from hw_model.values import ByteArray, FloatArray, Frozen, IntArray, Sums
from locsnn_compile.baselines.operations import network_additions
from locsnn_compile.data.recordings import Recordings, batches
from locsnn_compile.network.network import Network
from locsnn_compile.reference.evaluate import ReferenceResult
from locsnn_compile.verification.first_difference import SpikePlace, first_difference
from locsnn_compile.verification.matching import (
    Agreement,
    Divergence,
    PopulationMatch,
    Progress,
    ScoreMatch,
)
from locsnn_compile.verification.observation import check_labels


class ChipCounts(Protocol):
    """The counts that the chips of all families have. A family adds its own; counts of recordings can be added up."""

    @property
    def synaptic_ops(self) -> int:
        """How often a weight was added to a neuron."""

    @property
    def neuron_updates(self) -> int:
        """How often a neuron was updated."""

    @property
    def spikes(self) -> int:
        """Spikes of all neurons."""

    @property
    def input_events(self) -> int:
        """Events of recordings that reach an input."""

    @property
    def transpose_events(self) -> int:
        """Events that reach an input through the transpose buffer."""

    def __add__(self, other: Self, /) -> Self: ...


CountsT = TypeVar("CountsT", bound=ChipCounts)
BatchT = TypeVar("BatchT", bound=Sums)


class ProgramRun(Generic[CountsT], Frozen, eq=False):
    """What a program did on a batch of recordings.

    - ``spikes``: (batch, steps, n) by population; the number of spikes, where a chip's neuron can send several per step
    - ``scores``: the class scores (batch, classes). A score of ``score_scale`` corresponds to 1 in the network
    - ``counts``: the counts of each recording
    - ``counts_by_phase``: the counts of all recordings together, by phase
    - ``potential_at``: returns the potential of a neuron, as compared with its threshold, in the network's units
    """

    spikes: Mapping[str, ByteArray]
    scores: FloatArray
    score_scale: float
    counts: tuple[CountsT, ...]
    counts_by_phase: dict[str, CountsT]
    potential_at: Callable[[SpikePlace], float]


class Batch(NamedTuple):
    """Recordings (batch, steps, channels) played at once, and the number of the first one."""

    first_recording: int
    spikes: ByteArray


class BatchMatch(Generic[CountsT], Sums, eq=False):
    """How a program compares with the network on some recordings; adding two of them joins their recordings.

    ``predictions`` has the predictions of the network and of the program, (batch,) each, per batch. ``divergences`` has
    the first spike that differs of each batch that has one. The other fields are those of :class:`ProgramMatch`.
    """

    matches: dict[str, PopulationMatch]
    scores: ScoreMatch
    predictions: tuple[tuple[IntArray, IntArray], ...]
    counts: tuple[CountsT, ...]
    counts_by_phase: dict[str, CountsT]
    additions: dict[str, int]
    divergences: tuple[Divergence, ...]


class ProgramMatch(Generic[CountsT], Agreement):
    """How a program compares with the network on all recordings, and what the chip counted.

    ``counts`` has the counts of each recording, ``counts_by_phase`` those of all recordings together. ``additions`` is
    the operations of the float network by phase, as the published method counts them, over all recordings.
    """

    counts: tuple[CountsT, ...]
    counts_by_phase: dict[str, CountsT]
    additions: dict[str, int]

    @property
    def total_counts(self) -> CountsT:
        """The sum of the counts over all recordings."""
        return reduce(add, self.counts)


def sum_of_batches(
    network: Network,
    recordings: Recordings,
    compare_batch: Callable[[Batch], BatchT],
    progress: Progress | None,
) -> BatchT:
    """Compare recordings, which have the network's steps and channels, batch by batch, and return the sum.

    Raises ``InputError`` for labels that are not classes of the network.
    """
    check_labels(network, recordings.labels, len(recordings), recordings.source)
    sums: BatchT | None = None
    for batch in _batches(recordings):
        compared = compare_batch(batch)
        sums = compared if sums is None else sums + compared
        if progress:
            progress(batch.first_recording + len(batch.spikes), len(recordings))
    # Every set of recordings has at least one, so there was a batch.
    assert sums is not None
    return sums


def _batches(recordings: Recordings) -> Iterator[Batch]:
    """Yield the recordings in batches, which bound the memory."""
    for rows in batches(len(recordings)):
        yield Batch(rows.start, recordings.spikes[rows])


def match_of_batch(
    network: Network, reference: ReferenceResult, run: ProgramRun[CountsT], first_recording: int
) -> BatchMatch[CountsT]:
    """Compare what network and program did on a batch; ``reference`` must hold potentials."""
    readout = network.readout
    return BatchMatch(
        matches=population_matches(network, reference.spikes, run.spikes),
        scores=ScoreMatch.of(reference.scores, run.scores / run.score_scale),
        predictions=((readout.decided(reference.scores), readout.decided(run.scores)),),
        counts=run.counts,
        counts_by_phase=run.counts_by_phase,
        additions=network_additions(network, reference.spikes),
        divergences=_divergences(network, reference, run, first_recording),
    )


def population_matches(
    network: Network, reference: Mapping[str, ByteArray], chip: Mapping[str, ByteArray]
) -> dict[str, PopulationMatch]:
    """Compare spikes (batch, steps, n) by population."""
    return {
        population.name: PopulationMatch.of(reference[population.name], chip[population.name])
        for population in network.populations
    }


def _divergences(
    network: Network, reference: ReferenceResult, run: ProgramRun[CountsT], first_recording: int
) -> tuple[Divergence, ...]:
    """Return the first spike that differs in a batch, if there is any."""
    place = first_difference(network, reference.spikes, run.spikes)
    if place is None:
        return ()
    name = place.population
    potential = reference.potential[name][place.recording, place.step, place.neuron]
    return (
        Divergence(
            recording=first_recording + place.recording,
            population=name,
            neuron=place.neuron,
            step=place.step,
            reference_potential=float(potential),
            chip_potential=run.potential_at(place),
            threshold=float(network.population(name).thresholds[place.neuron]),
        ),
    )


def match_of_all(
    network: Network, recordings: Recordings, sums: BatchMatch[CountsT]
) -> ProgramMatch[CountsT]:
    """Return the match over all recordings, given the sum over their batches."""
    references, chips = zip(*sums.predictions, strict=True)
    # Helpers are populations that a frontend added. They are not in the model, so the report shows them apart.
    helpers = {population.name for population in network.populations if population.helper}
    return ProgramMatch(
        samples=len(recordings),
        events_source=recordings.source,
        reference_prediction=np.concatenate(references),
        chip_prediction=np.concatenate(chips),
        labels=recordings.labels,
        by_population={name: match for name, match in sums.matches.items() if name not in helpers},
        helpers={name: match for name, match in sums.matches.items() if name in helpers},
        scores=sums.scores,
        counts=sums.counts,
        counts_by_phase=sums.counts_by_phase,
        additions=sums.additions,
        first_divergence=sums.divergences[0] if sums.divergences else None,
    )
