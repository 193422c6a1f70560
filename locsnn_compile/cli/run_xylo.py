"""What ``locsnn run`` does with a program for a Xylo: play recordings, and count."""

import argparse
from collections.abc import Iterator
from dataclasses import asdict
from itertools import count
from typing import Any

from hw_model.mapping.graph import winning
from hw_model.values import ByteArray, FloatArray, IntArray
from hw_model.xylo.playing import XyloCounts, play_program
from hw_model.xylo.program import XyloProgram
from locsnn_compile.cli.options import given
from locsnn_compile.cli.outcomes import accuracy_lines, check_classes, recording_line
from locsnn_compile.cli.shell import progress_bar, say
from locsnn_compile.cli.step_options import assumption_lines, chunks_expected
from locsnn_compile.data.channels import flat_channels, parse_numbering
from locsnn_compile.data.recordings import Expected, Recordings, batches
from locsnn_compile.errors import InputError
from locsnn_compile.report.format import plural

Row = dict[str, Any]
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
    rows: list[Row] = []
    number = count()
    assumed: Recordings | None = None
    with progress_bar("simulating", show=args.json) as progress:
        for recordings in chunks_expected(args, expected_by(program)):
            assumed = recordings
            for spikes, labels in _parts(recordings):
                played = play_program(program, spikes, args.engine)
                counts = sum(played.counts, start=counts)
                for row in _rows(program, played.scores, played.counts, labels):
                    rows.append({"recording": next(number), **row})
            if progress:
                progress(len(rows), None)
    assert assumed is not None  # there is at least one recording
    result: Row = {
        "program": program.name,
        "recordings": rows,
        "counts": asdict(counts),
        "energy_pj": None,
        "assumptions": list(assumed.assumed),
    }
    lines = [recording_line(row) for row in rows]
    lines += [*_accuracy(rows), _summary(counts, len(rows)), *assumption_lines(assumed)]
    say(args, result, lines)
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


def _rows(
    program: XyloProgram,
    scores: FloatArray,
    counts: tuple[XyloCounts, ...],
    labels: IntArray | None,
) -> Iterator[Row]:
    """Yield the outcome of each recording."""
    if labels is not None:
        check_classes(labels, scores.shape[1])
    decided = program.readout.decided(scores)
    predicted = winning(scores, program.readout.tie_class)
    for recording, of_recording in enumerate(counts):
        yield {
            "prediction": int(predicted[recording]),
            "tied": bool(decided[recording] < 0),
            "label": None if labels is None else int(labels[recording]),
            "spikes": of_recording.spikes,
        }


def _accuracy(rows: list[Row]) -> list[str]:
    labelled = [row for row in rows if row["label"] is not None]
    right = [row for row in labelled if row["prediction"] == row["label"] and not row["tied"]]
    return accuracy_lines(len(right), len(labelled))


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
