"""``locsnn explore``: compare settings of the compiler and recommend one.

Compile a model with every setting of a grid, check each on the same recordings, and compare run time, error and energy.

example:
  locsnn explore examples/models/objects-hybrid.pt --events examples/recordings/touches.npz --weight-bits 4 6 8

Settings are compared on --events: on the train part of a divided archive or folder, otherwise on all recordings. Keep
test recordings apart and give them as --report-on: the settings on the front are measured on them once, and nothing is
chosen there. Finished points are kept in DIR/points, so the same command resumes where it was stopped.

It writes explore.csv, explore.json and explore.svg, with all points, the front, the recommended setting, and the
command that reproduces each point; measured times are in timings.csv and timings.svg. It recommends the cheapest
setting on the front within --min-agreement, --max-spike-error and --max-score-error (exit code 3 if there is none). If
none is given, the bounds are those of --strategy auto: no more changed predictions than dendrite at 8 bits, at most 1 %
more spikes that differ, and class scores off by at most 5 % more of their spread.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import hw_model as hw
from hw_model.io.build_folder import check_folder, default_folder, write_build
from locsnn_compile.cli.interrupt import EXIT_INTERRUPTED
from locsnn_compile.cli.options import given
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.shell import EXIT_GATE, progress_bar
from locsnn_compile.cli.step_options import (
    FILE_OPTIONS,
    STEP_OPTIONS,
    file_reading,
    on_sensor,
    reading_arguments,
    with_steps,
)
from locsnn_compile.cluster.spread import Spread, spread_over
from locsnn_compile.errors import InputError
from locsnn_compile.explore.events import as_read, choose_events, report_events, written
from locsnn_compile.explore.exploration import Exploration
from locsnn_compile.explore.point import ModelFile, Study
from locsnn_compile.explore.result import exploration_files, lines
from locsnn_compile.explore.sweep import Store, auto_bounds, sweep
from locsnn_compile.frontends.format_rows import LoadOptions
from locsnn_compile.request.recordings import calibration_recordings
from locsnn_compile.settings import DIALS, Value, check_matters, settings, weight_bits_of
from locsnn_compile.verification.error_bounds import ErrorBudget

ENGINES = ("fast", "reference")
READ = ("--config", "--events", "--report-on", "--calibration", "--target")
COPIES = ("events.npz", "calibration.npz", "reported.npz")
"""Recordings that commands need and that no other file holds as they were read."""
WRITTEN = ("explore.csv", "explore.json", "explore.svg", "timings.csv", "timings.svg")


def run(args: argparse.Namespace) -> int:
    """Explore as ``args`` ask; return the exit code. Raises ``InputError`` and ``TargetError``."""
    wanted: dict[str, list[Value]] = {dial.name: getattr(args, dial.name) or [] for dial in DIALS}
    if args.workers and args.scheduler:
        raise InputError(
            "--workers",
            "a scheduler has workers of its own",
            fix="Leave out --workers or --scheduler.",
        )
    folder = Path(args.output) if args.output else default_folder(args.model, "-explore")
    check_folder(folder, WRITTEN)
    _check_places(args, folder, WRITTEN)
    try:
        with spread_over(args.scheduler, args.workers) as spread:
            found = _explore(args, wanted, folder, spread)
    except KeyboardInterrupt:
        print("Stopped. The same command resumes from here.", file=sys.stderr)
        return EXIT_INTERRUPTED
    files = exploration_files(found)
    write_build(folder, files)
    if args.json:
        sys.stdout.write(files["explore.json"].decode())
    elif not args.quiet:
        print("\n".join([*lines(found), f"wrote {folder}/: {', '.join(files)}"]))
    if found.recommendation.taken is None and not found.by_default:
        print(f"gate failed: {found.recommendation.why}.", file=sys.stderr)
        return EXIT_GATE
    return 0


def _explore(
    args: argparse.Namespace, wanted: Mapping[str, Sequence[Value]], folder: Path, spread: Spread
) -> Exploration:
    """Measure the grid, and then the front on the recordings of --report-on."""
    model = ModelFile(args.model, LoadOptions.of(args))
    network, chip = on_sensor(with_steps(model.load(), args), args), hw.chip(args.target)
    reading = file_reading(args)
    files = (args.events, args.calibration, args.report_on, args.channel_order)
    if not any(files):
        for option in given(args, FILE_OPTIONS):
            raise InputError(option, "there are no events to read", fix="Give them with --events.")
    check_matters(network, {"calibration": "--calibration"} if args.calibration else {})
    events = choose_events(network, args.events, args.part, args.recordings, reading)
    reported_on = report_events(network, args.report_on, reading) if args.report_on else None
    again = reading_arguments(args)
    rewritten = events.file is None and again != reading_arguments(args, STEP_OPTIONS)
    if events.file is None:
        _check_places(args, folder, COPIES if rewritten else COPIES[:1])
    # By default never the recordings in the model: they may belong to its test part.
    calibration = (
        calibration_recordings(network, args.calibration, reading)
        if args.calibration
        else events.recordings
    )
    engines = ENGINES if args.engines is None else tuple(dict.fromkeys(args.engines))
    study = Study(network, model.digest(), chip, events.recordings, calibration, engines)
    store = Store(folder / "points")
    with progress_bar("exploring", show=not args.quiet) as progress:
        tried = settings(network, wanted, weight_bits_of(chip, None))
        points = sweep(study, tried, store, spread, progress)
        asked = ErrorBudget(args.min_agreement, args.max_spike_error, args.max_score_error)
        budget = asked if asked.given else auto_bounds(study, points, store, spread)
    events_copy, calibration_copy, reported_copy = (folder / name for name in COPIES)
    events = written(events, events_copy)
    calibration_file = args.calibration
    if rewritten:
        # One command reads all its files with the same options, and these were read already.
        again = reading_arguments(args, STEP_OPTIONS)
        if calibration_file is not None:
            calibration_file = written(as_read(calibration), calibration_copy).file
        if reported_on is not None:
            reported_on = written(replace(reported_on, file=None), reported_copy)
    found = Exploration(
        study,
        model,
        args.target,
        calibration_file,
        events,
        budget,
        not asked.given,
        points,
        reading_arguments=again,
    )
    if reported_on is None:
        return found
    with progress_bar("reporting", show=not args.quiet) as progress:
        return found.report_on(reported_on, store, spread, progress)


def _check_places(args: argparse.Namespace, folder: Path, names: Sequence[str]) -> None:
    """Refuse to overwrite inputs with files of these ``names`` in the output folder."""
    reads = {"MODEL": args.model, **given(args, READ)}
    check_places(reads, [], [(f"-o {str(folder)!r}", folder / name) for name in names])
