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
import itertools
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

import hw_model as hw
from hw_model.xylo.files import load_any_program
from hw_model.xylo.program import XyloProgram
from locsnn_compile.cli.outcomes import accuracy_lines, check_classes, recording_line
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
from locsnn_compile.report.format import count, energy, plural, share, time

Row = dict[str, Any]
MIN_AGREEMENT = 0.99
"""Of a margin that is calibrated, unless another is asked for."""


def run(args: argparse.Namespace) -> int:
    """Play every recording; print a line for each, or JSON."""
    _check_options(args)
    program = load_any_program(args.program)
    if isinstance(program, XyloProgram):
        from locsnn_compile.cli.run_xylo import run_xylo  # programs of other chips do not need it

        return run_xylo(args, program)
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
    counts, tally, rows = hw.Counts(), Counter[str](), list[Row]()
    shown = not (args.json or args.stream)
    with spread_over(args.scheduler) as spread:
        with progress_bar("simulating", show=not shown) as progress:
            for found, added in _play(program, chain([recordings], chunks), args.engine, spread):
                counts += added
                tally.update(known=sum(row["label"] is not None for row in found), all=len(found))
                tally.update(
                    right=sum(
                        row["prediction"] == row["label"] and not row["tied"] for row in found
                    )
                )
                rows += found if again or args.json else []
                if progress:
                    progress(tally["all"], len(recordings) if again else None)
                if shown:
                    print("\n".join(map(recording_line, found)))
        totals = hw.energy_pj(counts, program.chip.costs)
        result: Row = {"program": program.name, "recordings": rows}
        result |= {"counts": dict(counts), "energy_pj": totals}
        said = _summary(program, tally, counts, totals)
        result["assumptions"] = list(recordings.assumed)
        said += assumption_lines(recordings)
        if recordings.binned is not None:
            result["binning"] = recordings.binned.document()
            said.append(f"binning: {recordings.binned.words}")
        if args.stream:
            from locsnn_compile.cli.run_stream import stream_all, stream_lines

            result["stream"] = stream_all(args, program, recordings, rows, margin)
            said += stream_lines(result["stream"])
        if args.stop:
            result["stop"] = _find_stops(args, program, recordings, rows, margin, spread)
            said += _stop_lines(result["stop"])
    say(args, result, said)
    return 0


def _summary(
    program: hw.ChipProgram, tally: Counter[str], counts: hw.Counts, totals: dict[str, float]
) -> list[str]:
    played = tally["all"]
    lines = accuracy_lines(tally["right"], tally["known"])
    spent = (
        f"{math.fsum(totals.values()) / played / 1e6:.2f} µJ (profile {program.chip.default_profile}), "
        if totals
        else ""
    )
    lines.append(
        f"mean per recording: {counts.synaptic_ops / played:,.0f} synaptic operations, {spent}"
        f"{plural(counts.wraps, 'wrap')} and {plural(counts.clips, 'clip')} in all"
    )
    return lines


def _play(
    program: hw.ChipProgram, chunks: Iterable[Recordings], engine: str, spread: Spread
) -> Iterator[tuple[list[Row], hw.Counts]]:
    """Yield the rows and the counts of a few recordings at a time."""
    parts = (
        (
            found.spikes[rows],
            None if found.labels is None else found.labels[rows],
        )
        for found in chunks
        for rows in batches(len(found))
    )
    number = itertools.count()
    for rows, counts in spread(partial(_play_part, program, engine), parts):
        yield [{"recording": next(number), **row} for row in rows], counts


def _play_part(
    program: hw.ChipProgram, engine: Any, part: tuple[Any, Any]
) -> tuple[list[Row], hw.Counts]:
    """Play some recordings with their labels; return their rows and counts.

    Where all classes tie and the program names none for that, the prediction is the first class, but nothing is
    predicted: with a label, that is wrong.
    """
    spikes, labels = part
    found = hw.simulate(program, spikes, engine=engine, probe=())
    assert found.scores is not None  # a program without a readout has been refused
    if labels is not None:
        check_classes(labels, found.scores.shape[1])
    assert program.readout is not None
    tied = program.readout.decided(found.scores) < 0
    labels = [None] * len(spikes) if labels is None else labels.tolist()
    columns = zip(
        found.prediction.tolist(), tied.tolist(), labels, found.per_recording, strict=True
    )
    rows = [
        {"prediction": best, "tied": tie, "label": label, "spikes": of.spikes}
        for best, tie, label, of in columns
    ]
    return rows, found.counts


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


def _known_margin(args: argparse.Namespace, program: hw.ChipProgram, played: Recordings) -> Row:
    """Return the margin and where it comes from, which is not what is ``played``; infinite if no lead was enough."""
    if args.margin is not None:
        return {"margin": args.margin, "calibrated_on": None}
    asked = MIN_AGREEMENT if args.min_agreement is None else args.min_agreement
    part = "train" if "train" in recording_parts(args.calibrate, test_share=args.split) else None
    recordings = read_for_program(args, args.calibrate, program, part)
    if np.array_equal(recordings.spikes, played.spikes):
        what = "these recordings are also played, and a margin always suits the recordings that it was found on"
        raise InputError(f"--calibrate {Path(args.calibrate).name!r}", what, fix="Give others.")
    with progress_bar("calibrating", show=True):
        margin = hw.calibrate_margin(program, recordings.spikes, asked, args.psi)
        stops = hw.stop_at_margin(program, recordings.spikes, margin, args.psi)
    return {
        "margin": margin,
        "calibrated_on": {
            "source": recordings.source,
            "part": part,
            "recordings": len(recordings),
            "min_agreement": asked,
            "agreement": float(np.mean(stops.prediction == stops.final)),
        },
    }


def _find_stops(
    args: argparse.Namespace,
    program: hw.ChipProgram,
    recordings: Recordings,
    rows: list[Row],
    margin: Row | None,
    spread: Spread,
) -> Row:
    """Stop every recording; add its ``stop`` to its row, and return the figures over all of them."""
    from locsnn_compile.verification.over_time import savings, stop_all

    if args.silence is not None:
        stop = partial(hw.stop_in_silence, program, silence=args.silence)
    elif margin is None:
        stop = partial(hw.stop_when_proven, program)
    else:
        stop = partial(hw.stop_at_margin, program, margin=margin["margin"], psi=args.psi)
    with progress_bar("stopping", show=True) as progress:
        stops = stop_all(stop, recordings.spikes, progress, spread=spread)
    for row, step, prediction in zip(
        rows, stops.steps.tolist(), stops.prediction.tolist(), strict=True
    ):
        row["stop"] = {"step": step, "prediction": prediction}
    # JSON has no infinity: null means that no lead was enough.
    how = (
        {}
        if margin is None
        else {**margin, "margin": margin["margin"] if np.isfinite(margin["margin"]) else None}
    )
    # A recording in which all classes tie at the end predicts nothing, so it counts as wrong wherever it stops.
    labels = (
        None
        if recordings.labels is None
        else np.where([row["tied"] for row in rows], -1, recordings.labels)
    )
    return {
        "kind": args.stop,
        **how,
        **vars(savings(program, stops)),
        "agreement": float(np.mean(stops.prediction == stops.final)),
        "accuracy": None if labels is None else float(np.mean(stops.prediction == labels)),
        "whole_accuracy": None if labels is None else float(np.mean(stops.final == labels)),
        "recordings": len(rows),
    }


def _stop_lines(found: Row) -> list[str]:
    """Return, a line each, where the margin comes from, what stopping saves, and how predictions compare."""
    margin = _margin_lines(found["margin"], found["calibrated_on"]) if "margin" in found else []
    return [*margin, f"{_stopped(found)}{_stopped_costs(found)}", _predicted(found)]


def _margin_lines(margin: float | None, calibrated: Row | None) -> list[str]:
    if calibrated is None:
        return []
    of_part = f", {calibrated['part']} part" if calibrated["part"] else ""
    lead = "no lead is" if margin is None else f"a lead of {margin:.4g} is"
    return [
        f"margin: {lead} enough for {share(calibrated['min_agreement'])} agreement on "
        f"{plural(calibrated['recordings'], 'recording')} of {calibrated['source']}{of_part}"
    ]


def _stopped(found: Row) -> str:
    return (
        f"stopped ({found['kind']}) after {count(found['steps'])} of "
        f"{plural(found['all_steps'], 'step')} on average; saved {_saved(found, 'steps')} of the "
        f"steps, {_saved(found, 'synaptic_ops')} of the synaptic operations"
    )


def _stopped_costs(found: Row) -> str:
    """Return what stopping saves of the energy, after a comma; nothing without a profile."""
    if not found["profile"]:
        return ""
    times = "an unknown time"
    if found["latency_ns"] is not None:
        times = f"{time(found['latency_ns'])} instead of {time(found['all_latency_ns'])}"
    return (
        f", {_saved(found, 'energy_pj')} of the energy; {energy(found['energy_pj'])} instead of "
        f"{energy(found['all_energy_pj'])}, and {times} (profile {found['profile']})"
    )


def _saved(found: Row, key: str) -> str:
    whole = found[f"all_{key}"]
    return share(1 - found[key] / whole if whole else 0.0)


def _predicted(found: Row) -> str:
    same = f"{share(found['agreement'])} of {plural(found['recordings'], 'recording')}"
    accuracy = ""
    if found["accuracy"] is not None:
        whole = f"{found['whole_accuracy']:.3f}"
        accuracy = f"; accuracy {found['accuracy']:.3f} instead of {whole}"
    return f"same prediction as the whole recording in {same}{accuracy}"
