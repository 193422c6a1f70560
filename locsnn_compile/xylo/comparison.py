"""The float network against a program for a Xylo, spike by spike."""

from collections.abc import Iterator

import numpy as np

from hw_model.values import ByteArray, IntArray, Shown, Sums
from hw_model.xylo.playing import PlayedXylo, XyloCounts, play_program
from hw_model.xylo.program import XyloProgram
from locsnn_compile.baselines.operations import network_additions
from locsnn_compile.data.recordings import Recordings, batches
from locsnn_compile.reference.evaluate import ReferenceResult, evaluate
from locsnn_compile.verification.first_difference import first_difference
from locsnn_compile.verification.matching import (
    Agreement,
    Divergence,
    PopulationMatch,
    Progress,
    ScoreMatch,
)
from locsnn_compile.verification.observation import check_labels
from locsnn_compile.xylo.quantized import QuantizedXylo


class XyloMatch(Shown, Agreement):
    """How a program compares with the network it came from, over ``samples`` recordings.

    ``reference_prediction`` and ``chip_prediction`` are classes (samples,), or -1 where all scores
    tie and nothing is predicted; ``labels`` are (samples,) or None. ``helpers`` are populations
    that a frontend added. ``counts`` are those of each recording, and ``additions`` the float
    network's operations on paper over all of them.
    """

    samples: int
    events_source: str
    reference_prediction: IntArray
    chip_prediction: IntArray
    labels: IntArray | None
    by_population: dict[str, PopulationMatch]
    helpers: dict[str, PopulationMatch]
    scores: ScoreMatch
    counts: tuple[XyloCounts, ...]
    additions: int
    first_divergence: Divergence | None

    @property
    def total_counts(self) -> XyloCounts:
        """The counts of all recordings."""
        return sum(self.counts, start=XyloCounts())


def compare_xylo(
    quantized: QuantizedXylo,
    program: XyloProgram,
    recordings: Recordings,
    progress: Progress | None = None,
) -> XyloMatch:
    """Play recordings of the network's own steps and channels to both sides."""
    network = quantized.parts.network
    check_labels(network, recordings.labels, len(recordings), recordings.source)
    helpers = {population.name for population in network.populations if population.helper}
    all_batches: _Batch | None = None
    for batch in _batches(quantized, program, recordings.spikes):
        all_batches = all_batches + batch if all_batches else batch
        if progress:
            progress(len(all_batches.counts), len(recordings))
    assert all_batches is not None  # there is at least one recording
    references, chips = zip(*all_batches.predictions, strict=True)
    matches = all_batches.matches
    divergences = all_batches.divergences
    return XyloMatch(
        samples=len(recordings),
        events_source=recordings.source,
        reference_prediction=np.concatenate(references),
        chip_prediction=np.concatenate(chips),
        labels=recordings.labels,
        by_population={name: match for name, match in matches.items() if name not in helpers},
        helpers={name: match for name, match in matches.items() if name in helpers},
        scores=all_batches.scores,
        counts=all_batches.counts,
        additions=all_batches.additions,
        first_divergence=divergences[0] if divergences else None,
    )


class _Batch(Sums, eq=False):
    """The match of some recordings, as in :class:`XyloMatch`, with the predictions of both sides."""

    matches: dict[str, PopulationMatch]
    scores: ScoreMatch
    predictions: tuple[tuple[IntArray, IntArray], ...]
    counts: tuple[XyloCounts, ...]
    additions: int
    divergences: tuple[Divergence, ...]


def _batches(
    quantized: QuantizedXylo, program: XyloProgram, recordings: ByteArray
) -> Iterator[_Batch]:
    network = quantized.parts.network
    readout = network.readout
    for rows in batches(len(recordings)):
        part = recordings[rows]
        reference = evaluate(network, part, potentials=True)
        chip = play_program(program, part)
        yield _Batch(
            matches={
                population.name: PopulationMatch.of(
                    reference.spikes[population.name], chip.spikes[population.name]
                )
                for population in network.populations
            },
            scores=ScoreMatch.of(reference.scores, chip.scores),
            predictions=((readout.decided(reference.scores), readout.decided(chip.scores)),),
            counts=chip.counts,
            additions=sum(network_additions(network, reference.spikes).values()),
            divergences=_divergences(quantized, reference, chip, rows.start),
        )


def _divergences(
    quantized: QuantizedXylo, reference: ReferenceResult, chip: PlayedXylo, first: int
) -> tuple[Divergence, ...]:
    """Return the first spike that differs in a batch, if there is any."""
    network = quantized.parts.network
    place = first_difference(network, reference.spikes, chip.spikes)
    if place is None:
        return ()
    name = place.population
    at = (place.recording, place.step, place.neuron)
    scale = quantized.scales_of(name)[place.neuron]
    return (
        Divergence(
            recording=first + place.recording,
            population=name,
            neuron=place.neuron,
            step=place.step,
            reference_potential=float(reference.potential[name][at]),
            chip_potential=float(chip.potential[name][at] / scale),
            threshold=float(network.population(name).thresholds[place.neuron]),
        ),
    )
