"""``locsnn run``: play recordings to a compiled program, whole or step by step, to their end or until they may stop."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from locsnn_compile.cli.checks import check_known, check_number, check_psi
from locsnn_compile.cli.shell import progress_bar
from locsnn_compile.cli.step_options import add_step_options, read_for_program
from locsnn_compile.errors import InputError

if TYPE_CHECKING:
    import hw_model as hw
    from locsnn_compile.data.recordings import Recordings

HELP = "play recordings to a compiled program"
DESCRIPTION = "Play recordings to a compiled program: predictions, counts and energy, without the float network."
EXAMPLE = """\
example:
  locsnn run build/objects-hybrid --events examples/recordings/touches.npz --stream

With --stream events come step by step, and what is predicted so far is shown whenever it changes. --stop proven ends a
recording as soon as no remaining spike can change the winner. --stop margin ends it as soon as the winner leads by what
was enough on the recordings of --calibrate; give some that have neither trained the model nor test it. Of an archive
with a train part, those are taken.
"""
STOPS = ("proven", "margin")
_CHUNK = 16


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add = parser.add_argument
    add("program", metavar="DIR", help="folder that locsnn-compile wrote")
    add("--events", required=True, metavar="FILE", help="recordings: .zip, folder, .npy, .npz, .pt, .tact")
    add("--profile", metavar="NAME|FILE", help="costs to show: a profile of the chip, or a YAML file like one")
    add("--engine", default="fast", metavar="NAME", help="fast or reference (default fast); equal integers")
    add("--stream", action="store_true", help="play step by step; show each change of the prediction, and the pace")
    add(
        "--psi",
        type=float,
        metavar="X",
        help="with --stream or --stop margin: weigh the branches by time, such as 10",
    )
    add("--stop", metavar="HOW", help="stop early: proven, or margin")
    add("--calibrate", metavar="FILE", help="recordings to find the margin on")
    add("--min-agreement", type=float, metavar="X", help="of stops with the end, on those recordings (default 0.99)")
    add("--margin", type=float, metavar="X", help="the margin, where it is known")
    add_step_options(parser)
    add("--json", action="store_true", help="print the result as JSON")


def run(args: argparse.Namespace) -> int:
    """Play every recording; print a line each, or JSON."""
    _check_options(args)
    import hw_model as hw
    from locsnn_compile.cli.run_stop import find_stops, known_margin, stop_lines
    from locsnn_compile.cli.run_stream import stream_all, stream_lines

    program = hw.load_program(args.program)
    if args.profile:
        program = replace(program, chip=hw.priced_by(program.chip, args.profile))
    recordings = read_for_program(args, args.events, program)
    if args.step_seconds is not None and not args.stream and recordings.threshold is None:
        raise InputError("--step-seconds", "nothing that is asked for is timed", fix="Add --stream.")
    rows, counts = _play(program, recordings, args.engine)
    totals = hw.energy_pj(counts, program.chip.profile(program.chip.default_profile))
    result: dict[str, Any] = {"program": program.name, "recordings": rows, "counts": dict(counts), "energy_pj": totals}
    if recordings.binned is not None:
        result["binning"] = recordings.binned.document()
    margin = known_margin(args, program) if args.stop == "margin" else None
    if args.stream:
        result["stream"] = stream_all(args, program, recordings, rows, margin)
    elif not args.json:
        for row in rows:
            print(recording_line(row))
    if args.stop:
        result["stop"] = find_stops(args, program, recordings, rows, margin)
    if args.json:
        print(json.dumps(result, indent=2, allow_nan=False))
        return 0
    for line in _summary(program, rows, counts, totals):
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


def _summary(
    program: hw.ChipProgram, rows: list[dict[str, Any]], counts: hw.Counts, totals: dict[str, float]
) -> list[str]:
    from locsnn_compile.report.format import plural

    known = [row for row in rows if row["label"] is not None]
    lines = []
    if known:
        accuracy = sum(row["prediction"] == row["label"] for row in known) / len(known)
        lines.append(f"accuracy {accuracy:.3f} on {plural(len(known), 'recording')}")
    lines.append(
        f"mean of a recording: {counts.synaptic_ops / len(rows):.0f} synaptic operations, "
        f"{sum(totals.values()) / len(rows) / 1e6:.2f} µJ (profile {program.chip.default_profile}), "
        f"{plural(counts.wraps, 'wrap')} and {plural(counts.clips, 'clip')} in all"
    )
    return lines


def _play(program: hw.ChipProgram, recordings: Recordings, engine: Any) -> tuple[list[dict[str, Any]], hw.Counts]:
    import hw_model as hw

    if program.readout is None:
        raise InputError(f"program {program.name!r}", "has no readout, so it predicts nothing", fix="Compile a model.")
    rows: list[dict[str, Any]] = []
    counts = hw.Counts()
    with progress_bar("simulating", show=True) as progress:
        for start in range(0, len(recordings), _CHUNK):
            found = hw.simulate(program, recordings.spikes[start : start + _CHUNK], engine=engine, probe=())
            counts = counts + found.counts
            for i, (prediction, one) in enumerate(zip(found.prediction, found.per_recording, strict=True), start):
                label = None if recordings.labels is None else int(recordings.labels[i])
                rows.append({"recording": i, "prediction": int(prediction), "label": label, "spikes": one.spikes})
            if progress:
                progress(len(rows), len(recordings))
    return rows, counts


def _check_options(args: argparse.Namespace) -> None:
    """Refuse options that could only fail after the work is done, or that nothing would come of."""
    check_known(f"--stop {args.stop}", "recordings are not stopped so", args.stop, STOPS)
    by_margin = args.stop == "margin"
    for option, value in (("--calibrate", args.calibrate), ("--margin", args.margin)):
        if value is not None and not by_margin:
            raise InputError(option, "nothing that is asked for has a margin", fix="Add --stop margin.")
    if by_margin and (args.calibrate is None) == (args.margin is None):
        both = "is given twice" if args.margin is not None else "is not known"
        raise InputError("--stop margin", f"the margin {both}", fix="Give one of --calibrate FILE and --margin X.")
    if args.min_agreement is not None and args.calibrate is None:
        raise InputError("--min-agreement", "no margin is calibrated", fix="Add --calibrate FILE.")
    if args.psi is not None and not (args.stream or by_margin):
        raise InputError("--psi", "nothing that is asked for is weighed", fix="Add --stream or --stop margin.")
    check_psi(args.psi)
    check_number("--margin", args.margin, "it is no lead", lambda x: x > 0, "Give more than 0.")
    check_number("--step-seconds", args.step_seconds, "it is no time", lambda x: x > 0, "Give more than 0.")
    check_number("--min-agreement", args.min_agreement, "it is no share", lambda x: 0 <= x <= 1, "Give 0 to 1.")
