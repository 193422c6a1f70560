"""Compare a program for a Xylo with the float network, spike by spike."""

from functools import partial

from hw_model.values import ByteArray
from hw_model.xylo.playing import XyloCounts, play_program
from hw_model.xylo.program import XyloProgram
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.own_arithmetic.comparison import (
    Batch,
    BatchMatch,
    ProgramMatch,
    ProgramRun,
    match_of_all,
    match_of_batch,
    sum_of_batches,
)
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.verification.first_difference import SpikePlace
from locsnn_compile.verification.matching import Progress
from locsnn_compile.xylo.quantized import QuantizedXylo

XyloMatch = ProgramMatch[XyloCounts]


def compare_xylo(
    quantized: QuantizedXylo,
    program: XyloProgram,
    recordings: Recordings,
    progress: Progress | None = None,
) -> XyloMatch:
    """Return how both sides compare on recordings, which have the network's steps and channels."""
    network = quantized.parts.network
    compare_batch = partial(_compare_batch, quantized, program)
    sums = sum_of_batches(network, recordings, compare_batch, progress)
    return match_of_all(network, recordings, sums)


def _compare_batch(
    quantized: QuantizedXylo, program: XyloProgram, batch: Batch
) -> BatchMatch[XyloCounts]:
    """Play a batch to the network and to the program, and compare what they did."""
    network = quantized.parts.network
    reference = evaluate(network, batch.spikes, potentials=True)
    run = _play(quantized, program, batch.spikes)
    return match_of_batch(network, reference, run, batch.first_recording)


def _play(
    quantized: QuantizedXylo, program: XyloProgram, spikes: ByteArray
) -> ProgramRun[XyloCounts]:
    """Play spikes (batch, steps, channels) to the program."""
    played = play_program(program, spikes)

    def potential_at(place: SpikePlace) -> float:
        potential = played.potential[place.population][place.recording, place.step, place.neuron]
        # How many units of the chip's register a potential of 1 in the float network is.
        scale = quantized.scales_of(place.population)[place.neuron]
        return float(potential / scale)

    # A Xylo plays a recording once: its network has one phase.
    (phase,) = quantized.parts.network.phases
    counts_of_all: XyloCounts = sum(played.counts, start=XyloCounts())
    return ProgramRun(
        spikes=played.spikes,
        scores=played.scores,
        # Scores are spike counts on both sides.
        score_scale=1.0,
        counts=played.counts,
        counts_by_phase={phase.name: counts_of_all},
        potential_at=potential_at,
    )
