"""How ``locsnn run`` plays a program for a Xylo, and what it prints about it.

``players.py`` has the table of the kinds of programs, and ``run_whole.py`` plays them.
"""

from typing import Any

from hw_model.values import ByteArray
from hw_model.xylo.playing import XyloCounts, play_program
from hw_model.xylo.program import XyloProgram
from locsnn_compile.cli.run_whole import PlayedWhole, WholeProgram
from locsnn_compile.data.channels import flat_channels, parse_numbering
from locsnn_compile.data.recordings import EventTimes, Expected
from locsnn_compile.report.format import plural

_UNSUPPORTED = {
    "--stream": "it plays whole recordings",
    "--stop": "it plays whole recordings",
    "--psi": "it has one branch",
    "--profile": "its energies are not published",
    "--scheduler": "it is played in this process",
}
"""Options that do not apply to a program for a Xylo, and why."""


def whole_xylo(program: XyloProgram) -> WholeProgram:
    """Prepare a program for being played in whole recordings."""

    def play(recordings: ByteArray, engine: Any) -> PlayedWhole:
        played = play_program(program, recordings, engine)
        spikes = tuple(counts.spikes for counts in played.counts)
        total_counts = sum(played.counts, start=XyloCounts())
        return PlayedWhole(played.scores, spikes, total_counts)

    return WholeProgram(
        name=program.name,
        chip=program.chip.name,
        readout=program.readout,
        expected=expected_by(program),
        unsupported=_UNSUPPORTED,
        play=play,
        summary=_summary,
    )


def _summary(counts: XyloCounts, recordings: int) -> str:
    """Return a line on the counts of so many recordings."""
    operations = counts.synaptic_ops / recordings
    saturations = plural(counts.saturations, "saturation")
    return (
        f"mean per recording: {operations:,.0f} synaptic operations; {saturations} in all; "
        "energy is not known"
    )


def expected_by(program: XyloProgram) -> Expected:
    """Return the recordings that a program expects."""
    whose = f"program {program.name!r}"
    numbering = parse_numbering(program.channel_order)
    channels = program.inputs
    return Expected(
        whose,
        step_seconds=program.step_seconds,
        threshold=program.event_threshold,
        steps=program.steps,
        channels=channels,
        class_names=program.class_names,
        inputs=flat_channels(channels, program.polarities, program.columns, numbering, whose),
        numbering=numbering,
        event_times=EventTimes(program.start, program.time_unit),
        recorded=program.recorded,
    )
