"""``locsnn run`` for programs of chips with an arithmetic of their own: Xylo and SpiNNaker.

Such a program is played in whole recordings, in this process, and without energies: options that
stream, stop early, price, or spread the work over a cluster are refused. ``run.py`` plays programs
for meshes of cores.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from hw_model.mapping.graph import Readout, winning
from hw_model.values import ByteArray, FloatArray, IntArray, Sums
from locsnn_compile.cli.options import given_options
from locsnn_compile.cli.outcomes import (
    Outcome,
    RunFigures,
    Tally,
    accuracy_lines,
    check_classes,
    recording_line,
)
from locsnn_compile.cli.shell import print_result, progress_bar
from locsnn_compile.cli.step_options import (
    assumption_lines,
    batches_with_labels,
    chunks_expected,
)
from locsnn_compile.data.recordings import Expected, Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.report.figures.entries import plain


class PlayedWhole(NamedTuple):
    """Scores (batch, classes) and numbers of spikes (batch,), and the counts of all recordings together."""

    scores: FloatArray
    spikes: tuple[int, ...]
    counts: Sums


@dataclass(frozen=True, eq=False)
class WholeProgram:
    """What ``locsnn run`` needs of a program.

    - ``name``, ``chip``: the names of the program and of its chip
    - ``readout``: turns scores into predictions
    - ``expected``: the recordings that it takes
    - ``unsupported``: the options that do not apply to it, and why
    - ``play``: plays recordings (batch, steps, channels) by an engine, ``fast`` or ``reference``
    - ``summary``: returns a line on the counts of so many recordings
    """

    name: str
    chip: str
    readout: Readout
    expected: Expected
    unsupported: Mapping[str, str]
    play: Callable[[ByteArray, Any], PlayedWhole]
    summary: Callable[[Any, int], str]


def run_whole(args: argparse.Namespace, program: WholeProgram) -> int:
    """Play every recording; print a line for each, or JSON."""
    _check_options(args, program)
    counts: Any = None  # each kind of program has counts of its own, which can be added
    outcomes: list[Outcome] = []
    last_chunk: Recordings | None = None
    with progress_bar("simulating", show=args.json) as progress:
        for recordings in chunks_expected(args, program.expected):
            last_chunk = recordings
            for spikes, labels in batches_with_labels(recordings):
                played = program.play(spikes, args.engine)
                counts = played.counts if counts is None else counts + played.counts
                outcomes += _outcomes(program, played, labels, first=len(outcomes))
            if progress:
                progress(len(outcomes), None)
    assert last_chunk is not None  # files without recordings are refused on reading
    # What was assumed on reading is the same for all chunks of a file.
    figures = RunFigures(
        program=program.name,
        recordings=tuple(outcomes),
        counts=asdict(counts),
        energy_pj=None,
        assumptions=tuple(last_chunk.assumed),
    )
    lines = [
        *map(recording_line, outcomes),
        *accuracy_lines(Tally.of(outcomes)),
        program.summary(counts, len(outcomes)),
        *assumption_lines(last_chunk),
    ]
    print_result(args, plain(figures), lines)
    return 0


def _check_options(args: argparse.Namespace, program: WholeProgram) -> None:
    """Refuse options that do not apply to the program."""
    for option, value in given_options(args, tuple(program.unsupported)).items():
        if value is not False:  # a flag that was not given, such as --stream
            what = f"the program is for {program.chip}: {program.unsupported[option]}"
            raise InputError(option, what, fix="Leave it out.")


def _outcomes(
    program: WholeProgram, played: PlayedWhole, labels: IntArray | None, *, first: int
) -> Iterator[Outcome]:
    """Yield the outcome of each recording; they are numbered from ``first`` on."""
    if labels is not None:
        check_classes(labels, played.scores.shape[1])
    # Where all classes tie, ``decided`` is -1 and ``winning`` the first class.
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
