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
from locsnn_compile.cli.shell import progress_bar, say
from locsnn_compile.cli.step_options import (
    assumption_lines,
    chunks_for_program,
    read_for_program,
)
from locsnn_compile.cluster.spread import Spread, spread_over
from locsnn_compile.data.read import recording_parts
from locsnn_compile.data.recordings import Recordings, batches
from locsnn_compile.errors import InputError
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.format import count, energy, plural, share, time
from locsnn_compile.verification.savings import Savings, savings

MIN_AGREEMENT = 0.99
"""Of a margin that is calibrated, unless another is asked for."""


def run(args: argparse.Namespace) -> int:
    """Play every recording; print a line for each, or JSON."""
    _check_options(args)
    program = load_any_program(args.program)
    whole_of = player_of(program).whole
    if whole_of is not None:
        from locsnn_compile.cli.run_whole import run_whole  # a chip program does not need it

        return run_whole(args, whole_of(program))
    assert isinstance(program, hw.ChipProgram)  # all others are played in whole recordings
    return run_on_mesh(args, program)


def run_on_mesh(args: argparse.Namespace, program: hw.ChipProgram) -> int:  # noqa: C901 - asks each option of the command once
    """Play every recording to a program for a mesh of cores or the open core."""
    if args.profile:
        program = replace(program, chip=hw.priced_by(program.chip, args.profile))
    if program.readout is None:
        raise InputError(
            f"program {program.name!r}",
            "has no readout, so it predicts nothing",
            fix="Compile a model.",
        )
    # --stream and --stop play all recordings again; otherwise only a few are in memory at a time.
    again = bool(args.stream or args.stop)
    chunks = (
        iter([read_for_program(args, args.events, program)])
        if again
        else chunks_for_program(args, program)
    )
    recordings = next(chunks)
    if args.step_seconds is not None and not args.stream and recordings.threshold is None:
        raise InputError("--step-seconds", "nothing requested is timed", fix="Add --stream.")
    margin = _known_margin(args, program, recordings) if args.stop == "margin" else None
    counts = hw.Counts()
    tally = Tally()
    outcomes: list[Outcome] = []
    stream: StreamFigures | None = None
    stop: StopFigures | None = None
    more_lines: list[str] = []
    shown = not (args.json or args.stream)
    with spread_over(args.scheduler) as spread:
        with progress_bar("simulating", show=not shown) as progress:
            for part in _play(program, chain([recordings], chunks), args.engine, spread):
                counts += part.counts
                tally += Tally.of(part.outcomes)
                if again or args.json:
                    outcomes += part.outcomes
                if progress:
                    progress(tally.recordings, len(recordings) if again else None)
                if shown:
                    print("\n".join(map(recording_line, part.outcomes)))
        if args.stream:
            from locsnn_compile.cli.run_stream import stream_all, stream_lines

            lead = None if margin is None else margin.lead
            outcomes, stream = stream_all(args, program, recordings, outcomes, lead)
            more_lines += stream_lines(stream)
        if args.stop:
            outcomes, stop = _find_stops(args, program, recordings, outcomes, margin, spread)
            more_lines += _stop_lines(stop)
    binned = recordings.binned
    figures = RunFigures(
        program=program.name,
        recordings=tuple(outcomes),
        counts=dict(counts),
        energy_pj=hw.energy_pj(counts, program.chip.costs),
        assumptions=tuple(recordings.assumed),
        binning=None if binned is None else binned.document(),
        stream=stream,
        stop=stop,
    )
    lines = [
        *accuracy_lines(tally),
        _summary(program, tally.recordings, counts),
        *assumption_lines(recordings),
    ]
    if binned is not None:
        lines.append(f"binning: {binned.words}")
    say(args, plain(figures), [*lines, *more_lines])
    return 0


def _summary(program: hw.ChipProgram, recordings: int, counts: hw.Counts) -> str:
    operations = counts.synaptic_ops / recordings
    by_operation = hw.energy_pj(counts, program.chip.costs)
    spent = ""
    if by_operation:
        microjoules = math.fsum(by_operation.values()) / recordings / 1e6
        spent = f"{microjoules:.2f} µJ (profile {program.chip.default_profile}), "
    return (
        f"mean per recording: {operations:,.0f} synaptic operations, {spent}"
        f"{plural(counts.wraps, 'wrap')} and {plural(counts.clips, 'clip')} in all"
    )


class _Part(Frozen):
    """What some of the recordings did."""

    outcomes: list[Outcome]
    counts: hw.Counts


def _play(
    program: hw.ChipProgram, chunks: Iterable[Recordings], engine: str, spread: Spread
) -> Iterator[_Part]:
    """Yield what a few recordings at a time did."""
    first = 0
    for part in spread(partial(_play_part, program, engine), _parts(chunks)):
        numbered = [
            replace(outcome, recording=first + i) for i, outcome in enumerate(part.outcomes)
        ]
        first += len(numbered)
        yield replace(part, outcomes=numbered)


def _parts(chunks: Iterable[Recordings]) -> Iterator[tuple[ByteArray, IntArray | None]]:
    """Yield a few recordings at a time, with their labels."""
    for recordings in chunks:
        labels = recordings.labels
        for part in batches(len(recordings)):
            yield recordings.spikes[part], None if labels is None else labels[part]


def _play_part(
    program: hw.ChipProgram, engine: Any, part: tuple[ByteArray, IntArray | None]
) -> _Part:
    """Play some recordings with their labels; their outcomes are numbered from 0 on."""
    spikes, labels = part
    played = hw.simulate(program, spikes, engine=engine, probe=())
    assert played.scores is not None  # a program without a readout has been refused
    assert program.readout is not None
    if labels is not None:
        check_classes(labels, played.scores.shape[1])
    tied = program.readout.decided(played.scores) < 0
    outcomes = [
        Outcome(
            recording=i,
            prediction=int(played.prediction[i]),
            tied=bool(tied[i]),
            label=None if labels is None else int(labels[i]),
            spikes=of_recording.spikes,
        )
        for i, of_recording in enumerate(played.per_recording)
    ]
    return _Part(outcomes, played.counts)


def _check_options(args: argparse.Namespace) -> None:
    """Refuse options that would fail only after all the work, or that would change nothing."""
    by_margin = args.stop == "margin"
    for option, value in (("--calibrate", args.calibrate), ("--margin", args.margin)):
        if value is not None and not by_margin:
            raise InputError(option, "nothing requested has a margin", fix="Add --stop margin.")
    if by_margin and (args.calibrate is None) == (args.margin is None):
        both = "is given twice" if args.margin is not None else "is not known"
        raise InputError(
            "--stop margin", f"the margin {both}", fix="Give either --calibrate FILE or --margin X."
        )
    if (args.silence is None) == (args.stop == "silence"):
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
    """The lead that ends a recording, infinite if none was enough, and where it comes from."""

    lead: float
    calibrated_on: CalibratedOn | None = None

    @property
    def figures(self) -> Margin:
        """The margin as JSON has it, which knows no infinity."""
        lead = self.lead if math.isfinite(self.lead) else None
        return Margin(lead, self.calibrated_on)


def _known_margin(args: argparse.Namespace, program: hw.ChipProgram, played: Recordings) -> _Margin:
    """Return the margin that is given, or else calibrated on other recordings than those ``played``."""
    if args.margin is not None:
        return _Margin(args.margin)
    min_agreement = MIN_AGREEMENT if args.min_agreement is None else args.min_agreement
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
    """Stop every recording; return the outcomes with their stops, and the figures of all."""
    from locsnn_compile.verification.over_time import stop_all  # others do not need it

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
    accuracy = whole_accuracy = None
    if recordings.labels is not None:
        # A recording in which all classes tie at the end predicts nothing, so it counts as wrong wherever it stops.
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
    """Return, a line each, where the margin comes from, what stopping saves, and how predictions compare."""
    margin = [] if figures.margin is None else _margin_lines(figures.margin)
    saved = f"{_stopped(figures)}{_stopped_costs(figures.savings)}"
    return [*margin, saved, _predicted(figures)]


def _margin_lines(margin: Margin) -> list[str]:
    """Return where the margin comes from; nothing if it was given."""
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


def _stopped(figures: StopFigures) -> str:
    saved = figures.savings
    steps = _saved(saved.steps, saved.all_steps)
    operations = _saved(saved.synaptic_ops, saved.all_synaptic_ops)
    return (
        f"stopped ({figures.kind}) after {count(saved.steps)} of "
        f"{plural(saved.all_steps, 'step')} on average; saved {steps} of the "
        f"steps, {operations} of the synaptic operations"
    )


def _stopped_costs(saved: Savings) -> str:
    """Return what stopping saves of the energy, after a comma; nothing without a profile."""
    if saved.energy_pj is None or saved.all_energy_pj is None:
        return ""
    times = "an unknown time"
    if saved.latency_ns is not None and saved.all_latency_ns is not None:
        times = f"{time(saved.latency_ns)} instead of {time(saved.all_latency_ns)}"
    return (
        f", {_saved(saved.energy_pj, saved.all_energy_pj)} of the energy; "
        f"{energy(saved.energy_pj)} instead of {energy(saved.all_energy_pj)}, and {times} "
        f"(profile {saved.profile})"
    )


def _saved(part: float, whole: float) -> str:
    return share(1 - part / whole if whole else 0.0)


def _predicted(figures: StopFigures) -> str:
    same = f"{share(figures.agreement)} of {plural(figures.recordings, 'recording')}"
    accuracy = ""
    if figures.accuracy is not None:
        accuracy = f"; accuracy {figures.accuracy:.3f} instead of {figures.whole_accuracy:.3f}"
    return f"same prediction as the whole recording in {same}{accuracy}"
