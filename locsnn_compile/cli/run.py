"""``locsnn run``: play recordings to a compiled program.

Play recordings to a compiled program: predictions, counts and energy, without the float network.

example:
  locsnn run build/objects-hybrid --events examples/recordings/touches.npz --stream

With --stream events come step by step, and what is predicted so far is shown whenever it changes. --stop proven ends a
recording as soon as nothing that remains can change the winner. --stop margin ends it as soon as the winner leads by
what was enough on the recordings of --calibrate; give some that have neither trained the model nor test it. Of an
archive with a train part, those are taken. --stop silence ends it after --silence steps without an event, once
everything is at rest.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hw_model as hw
from locsnn_compile.cli.options import check_number, check_psi
from locsnn_compile.cli.shell import progress_bar
from locsnn_compile.cli.step_options import CHUNK, chunks_for_program, read_for_program
from locsnn_compile.errors import InputError, check_known
from locsnn_compile.report.format import plural

if TYPE_CHECKING:
    from locsnn_compile.cluster.spread import Spread
    from locsnn_compile.data.recordings import Recordings


STOPS = ("proven", "margin", "silence")


def run(args: argparse.Namespace) -> int:
    """Play every recording; print a line each, or JSON."""
    _check_options(args)
    from locsnn_compile.cli.run_stream import stream_all, stream_lines
    from locsnn_compile.cluster.spread import spread_over

    program = hw.load_program(args.program)
    if args.profile:
        program = replace(program, chip=hw.priced_by(program.chip, args.profile))
    if program.readout is None:
        raise InputError(f"program {program.name!r}", "has no readout, so it predicts nothing", fix="Compile a model.")
    # What is streamed or stopped is played again; of all else no more than a few recordings are held at a time.
    again = bool(args.stream or args.stop)
    chunks = iter([read_for_program(args, args.events, program)]) if again else chunks_for_program(args, program)
    recordings = next(chunks)
    if args.step_seconds is not None and not args.stream and recordings.threshold is None:
        raise InputError("--step-seconds", "nothing requested is timed", fix="Add --stream.")
    margin = known_margin(args, program) if args.stop == "margin" else None
    counts, tally, rows = hw.Counts(), Counter[str](), list[dict[str, Any]]()
    lines = not (args.json or args.stream)
    with spread_over(args.scheduler) as spread:
        with progress_bar("simulating", show=not lines) as progress:
            for found, added in _play(program, chain([recordings], chunks), args.engine, spread):
                counts += added
                tally.update(known=sum(row["label"] is not None for row in found), all=len(found))
                tally.update(right=sum(row["prediction"] == row["label"] for row in found))
                rows += found if again or args.json else []
                if progress:
                    progress(tally["all"], len(recordings) if again else None)
                if lines:
                    print("\n".join(map(recording_line, found)))
        totals = hw.energy_pj(counts, program.chip.costs)
        result: dict[str, Any] = {
            "program": program.name,
            "recordings": rows,
            "counts": dict(counts),
            "energy_pj": totals,
        }
        if recordings.binned is not None:
            result["binning"] = recordings.binned.document()
        if args.stream:
            result["stream"] = stream_all(args, program, recordings, rows, margin)
        if args.stop:
            result["stop"] = find_stops(args, program, recordings, rows, margin, spread)
    if args.json:
        print(json.dumps(result, indent=2, allow_nan=False))
        return 0
    for line in _summary(program, tally, counts, totals):
        print(line)
    if recordings.binned is not None:
        print(f"binning: {recordings.binned.words}")
    if args.stream:
        print("\n".join(stream_lines(result["stream"])))
    if args.stop:
        print("\n".join(stop_lines(result["stop"])))
    return 0


def recording_line(row: dict[str, Any]) -> str:
    """Return what became of a recording in a line."""
    label = "" if row["label"] is None else f"  label {row['label']}"
    return f"recording {row['recording']}: class {row['prediction']}{label}  {row['spikes']} spikes"


def _summary(program: hw.ChipProgram, tally: Counter[str], counts: hw.Counts, totals: dict[str, float]) -> list[str]:
    lines, played = [], tally["all"]
    if tally["known"]:
        lines.append(f"accuracy {tally['right'] / tally['known']:.3f} on {plural(tally['known'], 'recording')}")
    spent = f"{sum(totals.values()) / played / 1e6:.2f} µJ (profile {program.chip.default_profile}), " if totals else ""
    lines.append(
        f"mean per recording: {counts.synaptic_ops / played:.0f} synaptic operations, {spent}"
        f"{plural(counts.wraps, 'wrap')} and {plural(counts.clips, 'clip')} in all"
    )
    return lines


def _play(
    program: hw.ChipProgram, chunks: Iterable[Recordings], engine: str, spread: Spread
) -> Iterator[tuple[list[dict[str, Any]], hw.Counts]]:
    """Yield rows and counts of some recordings after the other."""
    parts = (
        (found.spikes[start : start + CHUNK], None if found.labels is None else found.labels[start : start + CHUNK])
        for found in chunks
        for start in range(0, len(found), CHUNK)
    )
    number = 0
    for rows, counts in spread(partial(_play_part, program, engine), parts):
        yield [{"recording": number + i, **row} for i, row in enumerate(rows)], counts
        number += len(rows)


def _play_part(program: hw.ChipProgram, engine: Any, part: tuple[Any, Any]) -> tuple[list[dict[str, Any]], hw.Counts]:
    """Play spikes with their labels; return rows and counts."""

    spikes, labels = part
    found = hw.simulate(program, spikes, engine=engine, probe=())
    labels = [None] * len(spikes) if labels is None else labels.tolist()
    each = zip(found.prediction.tolist(), labels, found.per_recording, strict=True)
    return [{"prediction": one, "label": label, "spikes": its.spikes} for one, label, its in each], found.counts


def _check_options(args: argparse.Namespace) -> None:
    """Refuse options that could only fail after the work is done, or that nothing would come of."""
    check_known(f"--stop {args.stop}", "unknown way to stop", args.stop, STOPS)
    by_margin = args.stop == "margin"
    for option, value in (("--calibrate", args.calibrate), ("--margin", args.margin)):
        if value is not None and not by_margin:
            raise InputError(option, "nothing requested has a margin", fix="Add --stop margin.")
    if by_margin and (args.calibrate is None) == (args.margin is None):
        both = "is given twice" if args.margin is not None else "is not known"
        raise InputError("--stop margin", f"the margin {both}", fix="Give one of --calibrate FILE and --margin X.")
    if (args.silence is None) == (args.stop == "silence"):
        raise InputError("--stop silence", "it goes together with --silence N", fix="Give both or neither.")
    if args.min_agreement is not None and args.calibrate is None:
        raise InputError("--min-agreement", "no margin is calibrated", fix="Add --calibrate FILE.")
    if args.scheduler and args.stream:
        raise InputError("--scheduler", "steps are timed on this machine", fix="Leave out --scheduler or --stream.")
    if args.psi is not None and not (args.stream or by_margin):
        raise InputError("--psi", "nothing requested weighs the branches", fix="Add --stream or --stop margin.")
    check_psi(args.psi)
    check_number("--margin", args.margin, "it is not a valid lead", lambda x: x > 0, "Give more than 0.")
    check_number("--silence", args.silence, "it is not a number of steps", lambda x: x > 0, "Give 1 or more.")
    check_number("--step-seconds", args.step_seconds, "it is not a duration", lambda x: x > 0, "Give more than 0.")
    check_number("--min-agreement", args.min_agreement, "it is not a share", lambda x: 0 <= x <= 1, "Give 0 to 1.")


Row = dict[str, Any]
MIN_AGREEMENT = 0.99


def known_margin(args: argparse.Namespace, program: hw.ChipProgram) -> Row:
    """Return the margin, as given or calibrated, and how it came; infinite where no lead was enough."""
    if args.margin is not None:
        return {"margin": args.margin, "calibrated_on": None}
    import numpy as np

    asked = MIN_AGREEMENT if args.min_agreement is None else args.min_agreement
    recordings, part = _calibration(args, program)
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


def find_stops(
    args: argparse.Namespace,
    program: hw.ChipProgram,
    recordings: Recordings,
    rows: list[Row],
    margin: Row | None,
    spread: Spread,
) -> Row:
    """Stop every recording; add its ``stop`` to the rows and return what is saved, and what it costs in agreement."""
    import numpy as np

    from locsnn_compile.verification.over_time import savings, stop_all

    if args.silence is not None:
        stop = partial(hw.stop_in_silence, program, silence=args.silence)
    elif margin is None:
        stop = partial(hw.stop_when_proven, program)
    else:
        stop = partial(hw.stop_at_margin, program, margin=margin["margin"], psi=args.psi)
    with progress_bar("stopping", show=True) as progress:
        stops = stop_all(stop, recordings.spikes, progress, spread=spread)
    for row, step, prediction in zip(rows, stops.steps.tolist(), stops.prediction.tolist(), strict=True):
        row["stop"] = {"step": step, "prediction": prediction}
    # JSON has no infinity: no lead at which to stop is null.
    how = {} if margin is None else {**margin, "margin": margin["margin"] if np.isfinite(margin["margin"]) else None}
    labels = recordings.labels
    return {
        "kind": args.stop,
        **how,
        **savings(program, stops),
        "agreement": float(np.mean(stops.prediction == stops.final)),
        "accuracy": None if labels is None else float(np.mean(stops.prediction == labels)),
        "whole_accuracy": None if labels is None else float(np.mean(stops.final == labels)),
        "recordings": len(rows),
    }


def stop_lines(found: Row) -> list[str]:
    """Return where the margin comes from, what is saved, and how predictions compare, a line each."""
    from locsnn_compile.report.words import sentence

    lines = []
    if calibrated := found.get("calibrated_on"):
        of_part = f", {calibrated['part']} part" if calibrated["part"] else ""
        lead = "no lead is" if found["margin"] is None else f"a lead of {found['margin']:.4g} is"
        lines.append(sentence("margin", lead=lead, of_part=of_part, **calibrated))
    saved = {key: 1 - found[key] / found[f"all_{key}"] if found[f"all_{key}"] else 0.0 for key in _SAVED}
    priced = sentence("stopped, with costs", saved=saved, **found) if found["profile"] else ""
    right = "" if found["accuracy"] is None else sentence("predicted, with labels", **found)
    stopped = sentence("stopped", saved=saved, **found) + priced
    return [*lines, stopped, sentence("predicted", **found) + right]


_SAVED = ("steps", "synaptic_ops", "energy_pj")


def _calibration(args: argparse.Namespace, program: hw.ChipProgram) -> tuple[Recordings, str | None]:
    """Return the recordings to calibrate on, never those that are played, and their part of the archive."""
    from locsnn_compile.data.read import recording_parts

    parts = recording_parts(args.calibrate, test_share=args.split)
    part = "train" if "train" in parts else None
    if part is None and Path(args.calibrate).resolve() == Path(args.events).resolve():
        what = "these recordings are played, too, and a margin always fits those that it was found on"
        fix = "Give others."
        raise InputError(f"--calibrate {Path(args.calibrate).name!r}", what, fix=fix)
    return read_for_program(args, args.calibrate, program, part), part
