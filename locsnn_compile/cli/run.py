"""``locsnn run``: play recordings to a compiled program.

Play recordings to a compiled program: predictions, counts and energy, without the float network.

example:
  locsnn run build/objects-hybrid --events examples/recordings/touches.npz --stream

With --stream events come step by step, and what is predicted so far is shown whenever it changes. --stop proven ends a
recording as soon as nothing that remains can change the winner. --stop margin ends it as soon as the winner leads by
the margin that was enough on the recordings of --calibrate. Give recordings that neither trained the model nor test it;
from an archive with a train part, that part is used. --stop silence ends a recording after --silence steps without an
event, once everything is at rest.
"""

# The docstring above is the help of the command, so it stays in these words.

import argparse
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

import hw_model as hw
from hw_model.targets.programs import load_any_program
from hw_model.values import ByteArray, Frozen, IntArray
from locsnn_compile.cli.outcomes import (
    CalibratedOn,
    EarlyStop,
    Margin,
    Outcome,
    RunFigures,
    StopFigures,
    StreamFigures,
    Tally,
    accuracy_lines,
    check_classes,
    recording_line,
)
from locsnn_compile.cli.players import player_of
from locsnn_compile.cli.shell import print_result, progress_bar
from locsnn_compile.cli.step_options import (
    assumption_lines,
    batches_with_labels,
    chunks_for_program,
    read_for_program,
)
from locsnn_compile.cluster.spread import Spread, spread_over
from locsnn_compile.data.read import recording_parts
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.format import count, energy, plural, share, time
from locsnn_compile.verification.savings import Savings, savings

MIN_AGREEMENT = 0.99
"""Default of ``--min-agreement``, which a calibrated margin must reach: chosen by hand."""


def run(args: argparse.Namespace) -> int:
    """Play every recording; print a line for each, or JSON."""
    _check_options(args)
    program = load_any_program(args.program)
    whole_program_of = player_of(program).whole
    if whole_program_of is not None:
        from locsnn_compile.cli.run_whole import run_whole  # a chip program does not need it

        return run_whole(args, whole_program_of(program))
    assert isinstance(program, hw.ChipProgram)  # all others are played in whole recordings
    return run_on_mesh(args, program)


def run_on_mesh(args: argparse.Namespace, program: hw.ChipProgram) -> int:
    """Play every recording to a program for a mesh of cores or the open core; return the exit code."""
    program = _with_profile(args, program)
    recordings, later_chunks = _read_first(args, program)
    margin = _margin(args, program, recordings) if args.stop == "margin" else None
    outcomes: Sequence[Outcome]
    stream: StreamFigures | None = None
    stop: StopFigures | None = None
    more_lines: list[str] = []
    with spread_over(args.scheduler) as spread:
        played = _play_all(args, program, recordings, later_chunks, spread)
        outcomes = played.outcomes
        if args.stream:
            from locsnn_compile.cli.run_stream import stream_all, stream_lines

            lead = None if margin is None else margin.lead
            outcomes, stream = stream_all(args, program, recordings, outcomes, lead)
            more_lines += stream_lines(stream)
        if args.stop:
            outcomes, stop = _find_stops(args, program, recordings, outcomes, margin, spread)
            more_lines += _stop_lines(stop)
    # What binning left out, and what was assumed on reading. Several chunks come only from arrays,
    # which hold bins already, so the first chunk speaks for all.
    binned = recordings.binned
    figures = RunFigures(
        program=program.name,
        recordings=tuple(outcomes),
        counts=dict(played.counts),
        energy_pj=hw.energy_pj(played.counts, program.chip.costs),
        assumptions=tuple(recordings.assumed),
        binning=None if binned is None else binned.document(),
        stream=stream,
        stop=stop,
    )
    lines = [
        *accuracy_lines(played.tally),
        _summary(program, played.tally.recordings, played.counts),
        *assumption_lines(recordings),
    ]
    if binned is not None:
        lines.append(f"binning: {binned.words}")
    print_result(args, plain(figures), [*lines, *more_lines])
    return 0


def _with_profile(args: argparse.Namespace, program: hw.ChipProgram) -> hw.ChipProgram:
    """Return the program with the costs of ``--profile``; refuse a program that predicts nothing."""
    if args.profile:
        program = replace(program, chip=hw.priced_by(program.chip, args.profile))
    if program.readout is None:
        raise InputError(
            f"program {program.name!r}",
            "has no readout, so it predicts nothing",
            fix="Compile a model.",
        )
    return program


def _plays_again(args: argparse.Namespace) -> bool:
    """Return whether all recordings are played a second time, so that all must be in memory."""
    return bool(args.stream or args.stop)


def _read_first(
    args: argparse.Namespace, program: hw.ChipProgram
) -> tuple[Recordings, Iterator[Recordings]]:
    """Return the first recordings of ``--events``, and the chunks that follow them.

    These are a few at a time, or all of them and no chunk if they are played again.
    """
    if _plays_again(args):
        chunks = iter([read_for_program(args, args.events, program)])
    else:
        chunks = chunks_for_program(args, program)
    recordings = next(chunks)
    # Recordings with a threshold were binned, for which the width of a step was needed.
    if args.step_seconds is not None and not args.stream and recordings.threshold is None:
        raise InputError("--step-seconds", "nothing requested is timed", fix="Add --stream.")
    return recordings, chunks


def _summary(program: hw.ChipProgram, recordings: int, counts: hw.Counts) -> str:
    """Return a line on the mean costs of a recording, and on all wraps and clips of registers."""
    operations = counts.synaptic_ops / recordings
    pj_by_operation = hw.energy_pj(counts, program.chip.costs)
    energy_words = ""
    if pj_by_operation:
        microjoules = math.fsum(pj_by_operation.values()) / recordings / 1e6
        energy_words = f"{microjoules:.2f} µJ (profile {program.chip.default_profile}), "
    return (
        f"mean per recording: {operations:,.0f} synaptic operations, {energy_words}"
        f"{plural(counts.wraps, 'wrap')} and {plural(counts.clips, 'clip')} in all"
    )


class _PlayedBatch(Frozen):
    """The outcomes of a few recordings that were played together, and the counts of all of them."""

    outcomes: list[Outcome]
    counts: hw.Counts


class _Played(Frozen):
    """The same of all recordings; ``outcomes`` is empty if nobody needs them at the end."""

    outcomes: list[Outcome]
    counts: hw.Counts
    tally: Tally


def _play_all(
    args: argparse.Namespace,
    program: hw.ChipProgram,
    recordings: Recordings,
    later_chunks: Iterator[Recordings],
    spread: Spread,
) -> _Played:
    """Play the first ``recordings`` and those of later chunks; print a line for each as it is done."""
    prints_lines = not (args.json or args.stream)  # --stream prints lines of its own
    # Otherwise the lines are all that is needed, and memory does not grow with the recordings.
    keeps_outcomes = _plays_again(args) or args.json
    total = len(recordings) if _plays_again(args) else None  # unknown while chunks come
    outcomes: list[Outcome] = []
    counts = hw.Counts()
    tally = Tally()
    with progress_bar("simulating", show=not prints_lines) as progress:
        for batch in _play(program, chain([recordings], later_chunks), args.engine, spread):
            counts += batch.counts
            tally += Tally.of(batch.outcomes)
            if keeps_outcomes:
                outcomes += batch.outcomes
            if progress:
                progress(tally.recordings, total)
            if prints_lines:
                print("\n".join(map(recording_line, batch.outcomes)))
    return _Played(outcomes, counts, tally)


def _play(
    program: hw.ChipProgram, chunks: Iterable[Recordings], engine: str, spread: Spread
) -> Iterator[_PlayedBatch]:
    """Play recordings in batches, here or on a cluster; yield the batches in order."""
    first = 0
    batches = chain.from_iterable(map(batches_with_labels, chunks))
    for batch in spread(partial(_play_batch, program, engine), batches):
        # A batch may have been played on another machine, which does not know its place.
        numbered = [
            replace(outcome, recording=first + i) for i, outcome in enumerate(batch.outcomes)
        ]
        first += len(numbered)
        yield replace(batch, outcomes=numbered)


def _play_batch(
    program: hw.ChipProgram, engine: Any, spikes_and_labels: tuple[ByteArray, IntArray | None]
) -> _PlayedBatch:
    """Play a batch of recordings; its outcomes are numbered from 0 on."""
    spikes, labels = spikes_and_labels
    played = hw.simulate(program, spikes, engine=engine, probe=())
    assert played.scores is not None  # a program without a readout has been refused
    assert program.readout is not None
    if labels is not None:
        check_classes(labels, played.scores.shape[1])
    # decided is -1 where all classes tie and the program names no class for that.
    is_tied = program.readout.decided(played.scores) < 0
    outcomes = [
        Outcome(
            recording=i,
            prediction=int(played.prediction[i]),
            tied=bool(is_tied[i]),
            label=None if labels is None else int(labels[i]),
            spikes=recording_counts.spikes,
        )
        for i, recording_counts in enumerate(played.per_recording)
    ]
    return _PlayedBatch(outcomes, played.counts)


def _check_options(args: argparse.Namespace) -> None:
    """Refuse options that would fail only after all the work, or that would change nothing."""
    by_margin = args.stop == "margin"
    for option, value in (("--calibrate", args.calibrate), ("--margin", args.margin)):
        if value is not None and not by_margin:
            raise InputError(option, "nothing requested has a margin", fix="Add --stop margin.")
    margin_sources = [source for source in (args.calibrate, args.margin) if source is not None]
    if by_margin and len(margin_sources) != 1:
        problem = "is given twice" if margin_sources else "is not known"
        raise InputError(
            "--stop margin",
            f"the margin {problem}",
            fix="Give either --calibrate FILE or --margin X.",
        )
    by_silence = args.stop == "silence"
    has_silence_steps = args.silence is not None
    if by_silence != has_silence_steps:
        raise InputError(
            "--stop silence", "it goes together with --silence N", fix="Give both or neither."
        )
    if args.min_agreement is not None and args.calibrate is None:
        raise InputError("--min-agreement", "no margin is calibrated", fix="Add --calibrate FILE.")
    if args.scheduler and args.stream:
        raise InputError(
            "--scheduler",
            "steps are timed on this machine",
            fix="Leave out --scheduler or --stream.",
        )
    if args.psi is not None and not (args.stream or by_margin):
        raise InputError(
            "--psi", "nothing requested weighs the branches", fix="Add --stream or --stop margin."
        )


class _Margin(Frozen):
    """The margin of ``--stop margin``, and where it comes from.

    ``lead`` is how far the best class must be ahead of the second to end a recording; it is infinite
    if no lead was enough. ``calibrated_on`` is None if the user gave the margin.
    """

    lead: float
    calibrated_on: CalibratedOn | None = None

    @property
    def figures(self) -> Margin:
        """The margin as it is printed: JSON has no infinity, so None stands for it."""
        lead = self.lead if math.isfinite(self.lead) else None
        return Margin(lead, self.calibrated_on)


def _margin(args: argparse.Namespace, program: hw.ChipProgram, played: Recordings) -> _Margin:
    """Return the margin that the user gives, or else calibrate one on the recordings of ``--calibrate``.

    Raises ``InputError`` if these are the recordings that are ``played``.
    """
    if args.margin is not None:
        return _Margin(args.margin)
    min_agreement = MIN_AGREEMENT if args.min_agreement is None else args.min_agreement
    # Of divided recordings the test part is played, so the margin comes from the train part.
    part = "train" if "train" in recording_parts(args.calibrate, test_share=args.split) else None
    recordings = read_for_program(args, args.calibrate, program, part)
    if np.array_equal(recordings.spikes, played.spikes):
        what = "these recordings are also played, and a margin always suits the recordings that it was found on"
        raise InputError(f"--calibrate {Path(args.calibrate).name!r}", what, fix="Give others.")
    with progress_bar("calibrating", show=True):
        lead = hw.calibrate_margin(program, recordings.spikes, min_agreement, args.psi)
        stops = hw.stop_at_margin(program, recordings.spikes, lead, args.psi)
    calibrated_on = CalibratedOn(
        source=recordings.source,
        part=part,
        recordings=len(recordings),
        min_agreement=min_agreement,
        agreement=float(np.mean(stops.prediction == stops.final)),
    )
    return _Margin(lead, calibrated_on)


def _find_stops(
    args: argparse.Namespace,
    program: hw.ChipProgram,
    recordings: Recordings,
    outcomes: Sequence[Outcome],
    margin: _Margin | None,
    spread: Spread,
) -> tuple[list[Outcome], StopFigures]:
    """Stop every recording early; return the outcomes with their stops, and the figures of all."""
    # Imported here, because only --stop needs it.
    from locsnn_compile.verification.over_time import stop_all

    if args.silence is not None:
        stop = partial(hw.stop_in_silence, program, silence=args.silence)
    elif margin is None:
        stop = partial(hw.stop_when_proven, program)
    else:
        stop = partial(hw.stop_at_margin, program, margin=margin.lead, psi=args.psi)
    with progress_bar("stopping", show=True) as progress:
        stops = stop_all(stop, recordings.spikes, progress, spread=spread)
    stopped = [
        replace(outcome, stop=EarlyStop(int(stops.steps[i]), int(stops.prediction[i])))
        for i, outcome in enumerate(outcomes)
    ]
    accuracy = None
    whole_accuracy = None
    if recordings.labels is not None:
        # A recording in which all classes tie at the end predicts nothing, so it counts as wrong wherever it stops:
        # no prediction equals the label -1.
        labels = np.where([outcome.tied for outcome in outcomes], -1, recordings.labels)
        accuracy = float(np.mean(stops.prediction == labels))
        whole_accuracy = float(np.mean(stops.final == labels))
    figures = StopFigures(
        kind=args.stop,
        margin=None if margin is None else margin.figures,
        savings=savings(program, stops),
        agreement=float(np.mean(stops.prediction == stops.final)),
        accuracy=accuracy,
        whole_accuracy=whole_accuracy,
        recordings=len(outcomes),
    )
    return stopped, figures


def _stop_lines(figures: StopFigures) -> list[str]:
    """Return lines on where the margin comes from, what stopping saves, and how predictions compare."""
    margin_lines = [] if figures.margin is None else _margin_lines(figures.margin)
    savings_line = f"{_saved_steps_text(figures)}{_saved_costs_text(figures.savings)}"
    return [*margin_lines, savings_line, _predictions_line(figures)]


def _margin_lines(margin: Margin) -> list[str]:
    """Return a line on where the margin comes from; nothing if the user gave it."""
    calibrated_on = margin.calibrated_on
    if calibrated_on is None:
        return []
    lead = "no lead is" if margin.margin is None else f"a lead of {margin.margin:.4g} is"
    part = f", {calibrated_on.part} part" if calibrated_on.part else ""
    recordings = plural(calibrated_on.recordings, "recording")
    return [
        f"margin: {lead} enough for {share(calibrated_on.min_agreement)} agreement on "
        f"{recordings} of {calibrated_on.source}{part}"
    ]


def _saved_steps_text(figures: StopFigures) -> str:
    """Return after how many steps recordings stop, and the shares of steps and operations saved.

    Figures that begin with ``all_`` are those of whole recordings.
    """
    spent = figures.savings
    steps = _saved_share(spent.steps, spent.all_steps)
    operations = _saved_share(spent.synaptic_ops, spent.all_synaptic_ops)
    return (
        f"stopped ({figures.kind}) after {count(spent.steps)} of "
        f"{plural(spent.all_steps, 'step')} on average; saved {steps} of the "
        f"steps, {operations} of the synaptic operations"
    )


def _saved_costs_text(spent: Savings) -> str:
    """Return what stopping saves of the energy and time, after a comma; nothing without a profile."""
    if spent.energy_pj is None or spent.all_energy_pj is None:
        return ""
    times = "an unknown time"
    if spent.latency_ns is not None and spent.all_latency_ns is not None:
        times = f"{time(spent.latency_ns)} instead of {time(spent.all_latency_ns)}"
    return (
        f", {_saved_share(spent.energy_pj, spent.all_energy_pj)} of the energy; "
        f"{energy(spent.energy_pj)} instead of {energy(spent.all_energy_pj)}, and {times} "
        f"(profile {spent.profile})"
    )


def _saved_share(spent: float, whole: float) -> str:
    """Return the share that is saved of a whole; of nothing, nothing is saved."""
    return share(1 - spent / whole if whole else 0.0)


def _predictions_line(figures: StopFigures) -> str:
    """Return how predictions at the stops compare with those of whole recordings."""
    same = f"{share(figures.agreement)} of {plural(figures.recordings, 'recording')}"
    accuracy = ""
    if figures.accuracy is not None:
        accuracy = f"; accuracy {figures.accuracy:.3f} instead of {figures.whole_accuracy:.3f}"
    return f"same prediction as the whole recording in {same}{accuracy}"
