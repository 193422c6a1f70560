"""What ``locsnn run`` does with a program for a Xylo: play recordings, and count."""

import argparse
from collections.abc import Iterator
from dataclasses import asdict

from hw_model.mapping.graph import winning
from hw_model.values import ByteArray, IntArray
from hw_model.xylo.playing import PlayedXylo, XyloCounts, play_program
from hw_model.xylo.program import XyloProgram
from locsnn_compile.cli.options import given
from locsnn_compile.cli.outcomes import (
    Outcome,
    RunFigures,
    Tally,
    accuracy_lines,
    check_classes,
    recording_line,
)
from locsnn_compile.cli.shell import progress_bar, say
from locsnn_compile.cli.step_options import assumption_lines, chunks_expected
from locsnn_compile.data.channels import flat_channels, parse_numbering
from locsnn_compile.data.recordings import Expected, Recordings, batches
from locsnn_compile.errors import InputError
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.format import plural

_NOT_THERE = {
    "--stream": "it plays whole recordings",
    "--stop": "it plays whole recordings",
    "--psi": "it has one branch",
    "--profile": "its energies are not published",
    "--scheduler": "it is played in this process",
}
"""Options that a program for a Xylo has no use for, and why."""


def run_xylo(args: argparse.Namespace, program: XyloProgram) -> int:
    """Play every recording; print a line for each, or JSON."""
    _check_options(args, program)
    counts = XyloCounts()
    outcomes: list[Outcome] = []
    assumed: Recordings | None = None
    with progress_bar("simulating", show=args.json) as progress:
        for recordings in chunks_expected(args, expected_by(program)):
            assumed = recordings
            for spikes, labels in _parts(recordings):
                played = play_program(program, spikes, args.engine)
                counts = sum(played.counts, start=counts)
                outcomes += _outcomes(program, played, labels, first=len(outcomes))
            if progress:
                progress(len(outcomes), None)
    assert assumed is not None  # there is at least one recording
    figures = RunFigures(
        program=program.name,
        recordings=tuple(outcomes),
        counts=asdict(counts),
        energy_pj=None,
        assumptions=tuple(assumed.assumed),
    )
    lines = [
        *map(recording_line, outcomes),
        *accuracy_lines(Tally.of(outcomes)),
        _summary(counts, len(outcomes)),
        *assumption_lines(assumed),
    ]
    say(args, plain(figures), lines)
    return 0


def _check_options(args: argparse.Namespace, program: XyloProgram) -> None:
    for option, value in given(args, tuple(_NOT_THERE)).items():
        if value is not False:
            what = f"the program is for {program.chip.name}: {_NOT_THERE[option]}"
            raise InputError(option, what, fix="Leave it out.")


def _parts(recordings: Recordings) -> Iterator[tuple[ByteArray, IntArray | None]]:
    """Yield a few recordings at a time, with their labels."""
    labels = recordings.labels
    for part in batches(len(recordings)):
        yield recordings.spikes[part], None if labels is None else labels[part]


def _outcomes(
    program: XyloProgram, played: PlayedXylo, labels: IntArray | None, first: int
) -> Iterator[Outcome]:
    """Yield the outcome of each recording; they are numbered from ``first`` on."""
    if labels is not None:
        check_classes(labels, played.scores.shape[1])
    decided = program.readout.decided(played.scores)
    predicted = winning(played.scores, program.readout.tie_class)
    for i, counts in enumerate(played.counts):
        yield Outcome(
            recording=first + i,
            prediction=int(predicted[i]),
            tied=bool(decided[i] < 0),
            label=None if labels is None else int(labels[i]),
            spikes=counts.spikes,
        )


def _summary(counts: XyloCounts, recordings: int) -> str:
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
    )
