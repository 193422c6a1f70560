"""What ``locsnn run`` does with a program for SpiNNaker: play recordings, and count."""

from typing import Any

from hw_model.errors import InputError
from hw_model.spinnaker.playing import SpinnakerCounts, play_program
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.values import ByteArray
from locsnn_compile.cli.run_whole import PlayedWhole, WholeProgram
from locsnn_compile.data.channels import flat_channels, parse_numbering
from locsnn_compile.data.recordings import EventTimes, Expected
from locsnn_compile.report.format import plural

_NOT_THERE = {
    "--stream": "it plays whole recordings",
    "--stop": "it plays whole recordings",
    "--psi": "it plays whole recordings",
    "--profile": "its energies are not known",
    "--scheduler": "it is played in this process",
}
"""Options that a program for SpiNNaker has no use for, and why."""


def whole_spinnaker(program: SpinnakerProgram) -> WholeProgram:
    """Return what ``locsnn run`` needs of a program."""
    if program.readout is None:
        what = "has no readout, so it predicts nothing"
        raise InputError(f"program {program.name!r}", what, fix="Compile a model.")

    def play(recordings: ByteArray, engine: Any) -> PlayedWhole:
        played = play_program(program, recordings, engine)
        assert played.scores is not None  # there is a readout
        spikes = tuple(sum(each.spikes for each in of_one.values()) for of_one in played.counts)
        return PlayedWhole(played.scores, spikes, played.total_counts)

    return WholeProgram(
        name=program.name,
        chip=program.chip.name,
        readout=program.readout,
        expected=expected_by(program),
        not_there=_NOT_THERE,
        play=play,
        summary=_summary,
    )


def _summary(counts: SpinnakerCounts, recordings: int) -> str:
    operations = counts.synaptic_ops / recordings
    wraps = plural(counts.wraps, "wrap")
    saturated = plural(counts.saturated_weights, "saturated weight")
    return (
        f"mean per recording: {operations:,.0f} synaptic operations; {wraps} and {saturated} in "
        "all; energy is not known"
    )


def expected_by(program: SpinnakerProgram) -> Expected:
    """Return the recordings that a program expects."""
    whose = f"program {program.name!r}"
    numbering = parse_numbering(program.channel_order)
    channels = max(program.streams.values())
    return Expected(
        whose,
        step_seconds=program.step_seconds,
        threshold=program.event_threshold,
        steps=_longest(program),
        channels=channels,
        class_names=program.class_names,
        inputs=flat_channels(channels, program.polarities, program.columns, numbering, whose),
        numbering=numbering,
        event_times=EventTimes(program.start, program.time_unit),
        recorded=program.recorded,
    )


def _longest(program: SpinnakerProgram) -> int | None:
    """Return the most steps that recordings may have; None where they may last as long as they like.

    A program that begins with the first touch ends by itself.
    """
    network = program.network
    if any(phase.align_events is not None for phase in network.phases):
        return None
    of_time = (phase.steps for phase in network.phases if phase.axis == "time")
    fixed = [steps for steps in of_time if steps is not None]
    turned = [item.rows for item in network.inputs if item.positions is not None]
    return min(fixed + turned, default=None)
