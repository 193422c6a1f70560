"""How ``locsnn run`` plays a program for SpiNNaker, and what it prints about it.

``players.py`` has the table of the kinds of programs, and ``run_whole.py`` plays them.
"""

from typing import Any

from hw_model.errors import InputError
from hw_model.spinnaker.playing import SpinnakerCounts, play_program
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.values import ByteArray
from locsnn_compile.cli.run_whole import PlayedWhole, WholeProgram
from locsnn_compile.data.channels import flat_channels, parse_numbering
from locsnn_compile.data.recordings import EventTimes, Expected
from locsnn_compile.report.format import plural

_UNSUPPORTED = {
    "--stream": "it plays whole recordings",
    "--stop": "it plays whole recordings",
    "--psi": "it plays whole recordings",
    "--profile": "its energies are not known",
    "--scheduler": "it is played in this process",
}
"""Options that do not apply to a program for SpiNNaker, and why."""


def whole_spinnaker(program: SpinnakerProgram) -> WholeProgram:
    """Prepare a program for being played in whole recordings; refuse one that predicts nothing."""
    if program.readout is None:
        what = "has no readout, so it predicts nothing"
        raise InputError(f"program {program.name!r}", what, fix="Compile a model.")

    def play(recordings: ByteArray, engine: Any) -> PlayedWhole:
        played = play_program(program, recordings, engine)
        assert played.scores is not None  # because there is a readout
        # The counts of each recording are by population.
        spikes = tuple(
            sum(counts.spikes for counts in by_population.values())
            for by_population in played.counts
        )
        return PlayedWhole(played.scores, spikes, played.total_counts)

    return WholeProgram(
        name=program.name,
        chip=program.chip.name,
        readout=program.readout,
        expected=expected_by(program),
        unsupported=_UNSUPPORTED,
        play=play,
        summary=_summary,
    )


def _summary(counts: SpinnakerCounts, recordings: int) -> str:
    """Return a line on the counts of so many recordings."""
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
        steps=_most_steps(program),
        channels=channels,
        class_names=program.class_names,
        inputs=flat_channels(channels, program.polarities, program.columns, numbering, whose),
        numbering=numbering,
        event_times=EventTimes(program.start, program.time_unit),
        recorded=program.recorded,
    )


def _most_steps(program: SpinnakerProgram) -> int | None:
    """Return the most steps that recordings may have; None if they may have any number.

    Two things limit them: the steps of a time phase, and the rows of the buffer from which location
    neurons read a recording channel by channel (an input with ``positions``).
    """
    network = program.network
    # A phase that begins at the first touch ends by itself, however long a recording is.
    if any(phase.align_events is not None for phase in network.phases):
        return None
    step_limits: list[int] = []
    for phase in network.phases:
        if phase.axis == "time" and phase.steps is not None:
            step_limits.append(phase.steps)
    for item in network.inputs:
        if item.positions is not None:
            step_limits.append(item.rows)
    return min(step_limits, default=None)
