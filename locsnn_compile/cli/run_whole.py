"""What ``locsnn run`` does with a program that is played in whole recordings, in this process, and is not priced."""

import argparse
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from hw_model.mapping.graph import Readout, winning
from hw_model.values import ByteArray, FloatArray, IntArray, Sums
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
from locsnn_compile.data.recordings import Expected, Recordings, batches
from locsnn_compile.errors import InputError
from locsnn_compile.report.figures.entries import plain


class PlayedWhole(NamedTuple):
    """Scores (batch, classes) and spikes of each recording, and the counts of all of them."""

    scores: FloatArray
    spikes: tuple[int, ...]
    counts: Sums


@dataclass(frozen=True, eq=False)
class WholeProgram:
    """A program, as far as ``locsnn run`` concerns it.

    - ``name``, ``chip``: what they are called
    - ``readout``: what its scores predict
    - ``expected``: the recordings that it takes
    - ``not_there``: the options that it has no use for, and why
    - ``play``: plays recordings (batch, steps, channels) by an engine
    - ``summary``: says, in a line, what the counts of so many recordings are
    """

    name: str
    chip: str
    readout: Readout
    expected: Expected
    not_there: Mapping[str, str]
    play: Callable[[ByteArray, Any], PlayedWhole]
    summary: Callable[[Any, int], str]


def run_whole(args: argparse.Namespace, program: WholeProgram) -> int:
    """Play every recording; print a line for each, or JSON."""
    _check_options(args, program)
    counts: Any = None
    outcomes: list[Outcome] = []
    assumed: Recordings | None = None
    with progress_bar("simulating", show=args.json) as progress:
        for recordings in chunks_expected(args, program.expected):
            assumed = recordings
            for spikes, labels in _parts(recordings):
                played = program.play(spikes, args.engine)
                counts = played.counts if counts is None else counts + played.counts
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
        program.summary(counts, len(outcomes)),
        *assumption_lines(assumed),
    ]
    say(args, plain(figures), lines)
    return 0


def _check_options(args: argparse.Namespace, program: WholeProgram) -> None:
    for option, value in given(args, tuple(program.not_there)).items():
        if value is not False:
            what = f"the program is for {program.chip}: {program.not_there[option]}"
            raise InputError(option, what, fix="Leave it out.")


def _parts(recordings: Recordings) -> Iterator[tuple[ByteArray, IntArray | None]]:
    """Yield a few recordings at a time, with their labels."""
    labels = recordings.labels
    for part in batches(len(recordings)):
        yield recordings.spikes[part], None if labels is None else labels[part]


def _outcomes(
    program: WholeProgram, played: PlayedWhole, labels: IntArray | None, *, first: int
) -> Iterator[Outcome]:
    """Yield the outcome of each recording; they are numbered from ``first`` on."""
    if labels is not None:
        check_classes(labels, played.scores.shape[1])
    decided = program.readout.decided(played.scores)
    predicted = winning(played.scores, program.readout.tie_class)
    for i, spikes in enumerate(played.spikes):
        yield Outcome(
            recording=first + i,
            prediction=int(predicted[i]),
            tied=bool(decided[i] < 0),
            label=None if labels is None else int(labels[i]),
            spikes=spikes,
        )
