"""``locsnn run``: play recordings to a compiled program, whole or step by step, to their end or until they may stop."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import hw_model as hw
from locsnn_compile.cli.checks import check_known, check_number, check_psi
from locsnn_compile.cli.shell import progress_bar
from locsnn_compile.cli.step_options import CHUNK, add_step_options, chunks_for_program, read_for_program
from locsnn_compile.errors import InputError

if TYPE_CHECKING:
    from locsnn_compile.cluster.spread import Spread
    from locsnn_compile.data.recordings import Recordings

HELP = "play recordings to a compiled program"
DESCRIPTION = "Play recordings to a compiled program: predictions, counts and energy, without the float network."
EXAMPLE = """\
example:
  locsnn run build/objects-hybrid --events examples/recordings/touches.npz --stream

With --stream events come step by step, and what is predicted so far is shown whenever it changes. --stop proven ends a
recording as soon as nothing that remains can change the winner. --stop margin ends it as soon as the winner leads by
what was enough on the recordings of --calibrate; give some that have neither trained the model nor test it. Of an
archive with a train part, those are taken. --stop silence ends it after --silence steps without an event, once
everything is at rest.
"""
STOPS = ("proven", "margin", "silence")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add = parser.add_argument
    add("program", metavar="DIR", help="folder that locsnn-compile wrote")
    add("--events", required=True, metavar="FILE", help="recordings: .zip, folder, .npy, .npz, .pt, .h5, or of events")
    add("--profile", metavar="NAME|FILE", help="costs to show: a profile of the chip, or a YAML file like one")
    add("--engine", default="fast", metavar="NAME", help="fast or reference (default fast); equal integers")
    add("--stream", action="store_true", help="play step by step; show each change of the prediction, and the pace")
    add("--psi", type=float, metavar="X", help="with --stream or --stop margin: weigh branches by time, such as 10")
    add("--stop", metavar="HOW", help="stop early: proven, margin or silence")
    add("--calibrate", metavar="FILE", help="recordings to find the margin on")
    add("--min-agreement", type=float, metavar="X", help="of stops with the end, on those recordings (default 0.99)")
    add("--margin", type=float, metavar="X", help="the margin, where it is known")
    add("--silence", type=int, metavar="N", help="with --stop silence: steps without an event")
    add_step_options(parser)
    add("--scheduler", metavar="ADDRESS", help="play on the Dask cluster of this scheduler (needs the extra dask)")
    add("--json", action="store_true", help="print the result as JSON")


def run(args: argparse.Namespace) -> int:
    """Play every recording; print a line each, or JSON."""
    _check_options(args)
    from locsnn_compile.cli.run_stop import find_stops, known_margin, stop_lines
    from locsnn_compile.cli.run_stream import stream_all, stream_lines
    from locsnn_compile.cluster.dask_cluster import spread_over

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
        totals = hw.energy_pj(counts, program.chip.profile(program.chip.default_profile))
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
    from locsnn_compile.report.format import plural

    lines, played = [], tally["all"]
    if tally["known"]:
        lines.append(f"accuracy {tally['right'] / tally['known']:.3f} on {plural(tally['known'], 'recording')}")
    lines.append(
        f"mean per recording: {counts.synaptic_ops / played:.0f} synaptic operations, "
        f"{sum(totals.values()) / played / 1e6:.2f} µJ (profile {program.chip.default_profile}), "
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
