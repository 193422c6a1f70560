"""Compare a program for SpiNNaker with the float network, spike by spike, and with two other versions of itself.

- With the integers that it was made from, computed as ``loihi-sim`` does: what differs is due to SpiNNaker's
  arithmetic alone.
- With the program as it would be if sPyNNaker, SpiNNaker's own software, chose the shifts of weights: what differs is
  what that choice would cost (:mod:`locsnn_compile.spinnaker.own_choice`).
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from functools import partial
from typing import NamedTuple

from hw_model.arithmetic import loihi
from hw_model.spinnaker.playing import (
    PlayedSpinnaker,
    SpinnakerCounts,
    play_program,
    potentials_in_units,
)
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.values import ByteArray, Sums, picked
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.own_arithmetic.comparison import (
    Batch,
    BatchMatch,
    ProgramMatch,
    ProgramRun,
    match_of_all,
    match_of_batch,
    population_matches,
    sum_of_batches,
)
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.spinnaker.grid import REGISTERS
from locsnn_compile.spinnaker.own_choice import can_be_played, own_shifts, with_shifts
from locsnn_compile.verification.first_difference import SpikePlace
from locsnn_compile.verification.matching import PopulationMatch, Progress


class SpinnakerMatch(ProgramMatch[SpinnakerCounts]):
    """How a program compares with the network, with its integers, and with sPyNNaker's own choice of shifts.

    ``integers`` compares it with the integers that it was made from, computed by the arithmetic of ``loihi``.
    ``own_scale`` compares it, as the reference, with the program that has sPyNNaker's own shifts; it is None if our
    engine does not model such shifts.
    """

    integers: Mapping[str, PopulationMatch]
    own_scale: Mapping[str, PopulationMatch] | None


def compare_spinnaker(
    quantized: QuantizedNetwork,
    program: SpinnakerProgram,
    recordings: Recordings,
    progress: Progress | None = None,
) -> SpinnakerMatch:
    """Play recordings, which have the network's steps and channels, to all sides, and return how they compare."""
    network = quantized.network
    compare_batch = partial(_compare_batch, _Sides.of(quantized, program))
    sums = sum_of_batches(network, recordings, compare_batch, progress)
    match = match_of_all(network, recordings, sums.match)
    return SpinnakerMatch(
        **picked(match, *(field.name for field in fields(match))),
        integers=sums.integers,
        own_scale=sums.own_scale or None,
    )


class _Sides(NamedTuple):
    """The four sides that play the recordings: the network in float (``quantized`` holds it) and in integers, the
    program, and the program with sPyNNaker's own shifts.
    """

    quantized: QuantizedNetwork
    integers: Network
    program: SpinnakerProgram
    own: SpinnakerProgram | None

    @classmethod
    def of(cls, quantized: QuantizedNetwork, program: SpinnakerProgram) -> "_Sides":
        """Return the sides for a program; the last is None if our engine does not model sPyNNaker's own shifts."""
        shifts = own_shifts(program.network)
        if not can_be_played(shifts):
            return cls(quantized, quantized.on_grid(), program, None)
        own = replace(program, network=with_shifts(program.network, shifts))
        return cls(quantized, quantized.on_grid(), program, own)

    @property
    def network(self) -> Network:
        """The trained network."""
        return self.quantized.network


class _SpinnakerBatch(Sums, eq=False):
    """The comparisons of :class:`SpinnakerMatch` for one batch; adding two of them joins their recordings."""

    match: BatchMatch[SpinnakerCounts]
    integers: dict[str, PopulationMatch]
    own_scale: dict[str, PopulationMatch]


def _compare_batch(sides: _Sides, batch: Batch) -> _SpinnakerBatch:
    """Play a batch to all sides, and compare what they did."""
    network = sides.network
    reference = evaluate(network, batch.spikes, potentials=True, registers=REGISTERS)
    integers = evaluate(sides.integers, batch.spikes, registers=REGISTERS)
    run = _play(sides, batch.spikes)
    return _SpinnakerBatch(
        match=match_of_batch(network, reference, run, batch.first_recording),
        integers=population_matches(network, integers.spikes, run.spikes),
        own_scale=_own_scale(sides, run, batch.spikes),
    )


def _own_scale(
    sides: _Sides, run: ProgramRun[SpinnakerCounts], recordings: ByteArray
) -> dict[str, PopulationMatch]:
    """Compare the program's spikes with those of the program with sPyNNaker's own shifts."""
    if sides.own is None:
        return {}
    own = play_program(sides.own, recordings)
    return population_matches(sides.network, run.spikes, own.spikes)


def _play(sides: _Sides, recordings: ByteArray) -> ProgramRun[SpinnakerCounts]:
    """Play recordings (batch, steps, channels) to the program."""
    played = play_program(sides.program, recordings)
    # The program of a network always has a readout.
    assert played.scores is not None

    def potential_at(place: SpikePlace) -> float:
        name = place.population
        potential = played.potential[name][place.recording, place.step, place.neuron]
        in_units = potentials_in_units(sides.program, {name: potential})[name]
        scale = sides.quantized.population(name).scale[place.neuron]
        return float(loihi.in_registers(in_units) / scale)

    return ProgramRun(
        spikes=played.spikes,
        scores=played.scores,
        score_scale=sides.quantized.score_scale,
        counts=tuple(_of_all_phases(counts) for counts in played.counts),
        counts_by_phase=_by_phase(played),
        potential_at=potential_at,
    )


def _of_all_phases(counts: Mapping[str, SpinnakerCounts]) -> SpinnakerCounts:
    """Return the sum of counts over phases."""
    return sum(counts.values(), start=SpinnakerCounts())


def _by_phase(played: PlayedSpinnaker) -> dict[str, SpinnakerCounts]:
    """Return the counts of all recordings of a batch, by phase."""
    totals: dict[str, SpinnakerCounts] = {}
    for counts_of_recording in played.counts:
        for phase, counts in counts_of_recording.items():
            totals[phase] = totals.get(phase, SpinnakerCounts()) + counts
    return totals
