"""The float network against a program for SpiNNaker, spike by spike.

The same recordings are also played to the program as it would be with the shifts that sPyNNaker
chooses by itself, so that a report can say what they would cost.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.spinnaker.playing import (
    PlayedSpinnaker,
    SpinnakerCounts,
    play_program,
    potentials_in_units,
)
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.values import ByteArray, IntArray, Shown, Sums
from locsnn_compile.baselines.operations import network_additions
from locsnn_compile.data.recordings import Recordings, batches
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.reference.evaluate import ReferenceResult, evaluate
from locsnn_compile.spinnaker.grid import REGISTERS
from locsnn_compile.spinnaker.own_choice import can_be_played, own_shifts, with_shifts
from locsnn_compile.verification.first_difference import first_difference
from locsnn_compile.verification.matching import (
    Agreement,
    Divergence,
    PopulationMatch,
    Progress,
    ScoreMatch,
)
from locsnn_compile.verification.observation import check_labels


class SpinnakerMatch(Shown, Agreement):
    """How a program compares with the network it came from, over ``samples`` recordings.

    ``reference_prediction`` and ``chip_prediction`` are classes (samples,), or -1 where all scores
    tie and nothing is predicted; ``labels`` are (samples,) or None. ``helpers`` are populations
    that a frontend added. ``counts`` are those of each recording by phase, and ``additions`` the
    float network's operations on paper by phase, over all of them. ``integers`` compares the
    program with the integers that it was made from, computed as ``loihi`` does. ``own_scale``
    compares it (as the reference) with itself, had sPyNNaker chosen the shifts; it is None if
    those cannot be played.
    """

    samples: int
    events_source: str
    reference_prediction: IntArray
    chip_prediction: IntArray
    labels: IntArray | None
    by_population: dict[str, PopulationMatch]
    helpers: dict[str, PopulationMatch]
    scores: ScoreMatch
    counts: tuple[Mapping[str, SpinnakerCounts], ...]
    additions: Mapping[str, int]
    first_divergence: Divergence | None
    integers: Mapping[str, PopulationMatch]
    own_scale: Mapping[str, PopulationMatch] | None

    @property
    def counts_by_phase(self) -> dict[str, SpinnakerCounts]:
        """The counts of all recordings, by phase."""
        totals: dict[str, SpinnakerCounts] = {}
        for of_recording in self.counts:
            for phase, counts in of_recording.items():
                totals[phase] = totals.get(phase, SpinnakerCounts()) + counts
        return totals

    @property
    def total_counts(self) -> SpinnakerCounts:
        """The counts of all recordings and phases."""
        return sum(self.counts_by_phase.values(), start=SpinnakerCounts())


def compare_spinnaker(
    quantized: QuantizedNetwork,
    program: SpinnakerProgram,
    recordings: Recordings,
    progress: Progress | None = None,
) -> SpinnakerMatch:
    """Play recordings of the network's own steps and channels to both sides."""
    network = quantized.network
    check_labels(network, recordings.labels, len(recordings), recordings.source)
    helpers = {population.name for population in network.populations if population.helper}
    all_batches: _Batch | None = None
    for batch in _batches(_Sides.of(quantized, program), recordings.spikes):
        all_batches = all_batches + batch if all_batches else batch
        if progress:
            progress(len(all_batches.counts), len(recordings))
    assert all_batches is not None  # there is at least one recording
    references, chips = zip(*all_batches.predictions, strict=True)
    matches = all_batches.matches
    divergences = all_batches.divergences
    return SpinnakerMatch(
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
        integers=all_batches.integers,
        own_scale=all_batches.own_scale or None,
    )


class _Sides(NamedTuple):
    """What plays recordings: the network in float and in integers, the program, and the program with
    sPyNNaker's own shifts.
    """

    quantized: QuantizedNetwork
    integers: Network
    program: SpinnakerProgram
    own: SpinnakerProgram | None

    @classmethod
    def of(cls, quantized: QuantizedNetwork, program: SpinnakerProgram) -> "_Sides":
        shifts = own_shifts(program.network)
        if not can_be_played(shifts):
            return cls(quantized, quantized.on_grid(), program, None)
        own = replace(program, network=with_shifts(program.network, shifts))
        return cls(quantized, quantized.on_grid(), program, own)

    @property
    def network(self) -> Network:
        """The trained network."""
        return self.quantized.network


class _Batch(Sums, eq=False):
    """The match of some recordings, as in :class:`SpinnakerMatch`, with the predictions of both sides."""

    matches: dict[str, PopulationMatch]
    scores: ScoreMatch
    predictions: tuple[tuple[IntArray, IntArray], ...]
    counts: tuple[Mapping[str, SpinnakerCounts], ...]
    additions: dict[str, int]
    divergences: tuple[Divergence, ...]
    integers: dict[str, PopulationMatch]
    own_scale: dict[str, PopulationMatch]


def _batches(sides: _Sides, recordings: ByteArray) -> Iterator[_Batch]:
    network = sides.network
    readout = network.readout
    for rows in batches(len(recordings)):
        part = recordings[rows]
        reference = evaluate(network, part, potentials=True, registers=REGISTERS)
        integers = evaluate(sides.integers, part, registers=REGISTERS)
        chip = play_program(sides.program, part)
        assert chip.scores is not None  # a network has a readout
        yield _Batch(
            matches=_matches(network, reference.spikes, chip.spikes),
            scores=ScoreMatch.of(reference.scores, chip.scores / sides.quantized.score_scale),
            predictions=((readout.decided(reference.scores), readout.decided(chip.scores)),),
            counts=chip.counts,
            additions=network_additions(network, reference.spikes),
            divergences=_divergences(sides, reference, chip, rows.start),
            integers=_matches(network, integers.spikes, chip.spikes),
            own_scale=_own_scale(sides, chip, part),
        )


def _matches(
    network: Network, wanted: Mapping[str, ByteArray], played: Mapping[str, ByteArray]
) -> dict[str, PopulationMatch]:
    return {
        population.name: PopulationMatch.of(wanted[population.name], played[population.name])
        for population in network.populations
    }


def _own_scale(
    sides: _Sides, chip: PlayedSpinnaker, recordings: ByteArray
) -> dict[str, PopulationMatch]:
    """Compare the program's spikes with those that sPyNNaker's own shifts leave."""
    if sides.own is None:
        return {}
    own = play_program(sides.own, recordings)
    return _matches(sides.network, chip.spikes, own.spikes)


def _divergences(
    sides: _Sides, reference: ReferenceResult, chip: PlayedSpinnaker, first: int
) -> tuple[Divergence, ...]:
    """Return the first spike that differs in a batch, if there is any."""
    place = first_difference(sides.network, reference.spikes, chip.spikes)
    if place is None:
        return ()
    name = place.population
    at = (place.recording, place.step, place.neuron)
    in_units = potentials_in_units(sides.program, {name: chip.potential[name][at]})[name]
    quantized = sides.quantized.population(name)
    return (
        Divergence(
            recording=first + place.recording,
            population=name,
            neuron=place.neuron,
            step=place.step,
            reference_potential=float(reference.potential[name][at]),
            chip_potential=float(loihi.in_registers(in_units) / quantized.scale[place.neuron]),
            threshold=float(quantized.population.thresholds[place.neuron]),
        ),
    )
