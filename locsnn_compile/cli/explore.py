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

With several --target, or one chip that has a single setting, the network is put on each chip, by what is usual there or
with every combination of the values given: explore.csv, explore.json and explore.svg say what each loses and takes, and
why others refuse the network or a value. With bounds, chips that keep them are named (exit code 3 if there is none).
Engines are timed if --engines names them (timings.csv).
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import hw_model as hw
from hw_model.io.build_folder import check_folder, default_folder, write_build
from hw_model.targets.families import chip_named
from locsnn_compile.cli.explore_chips import explore_chips
from locsnn_compile.cli.explored_inputs import REPORTED, check_explored_places, read_compared
from locsnn_compile.cli.interrupt import EXIT_INTERRUPTED
from locsnn_compile.cli.shell import EXIT_GATE, progress_bar
from locsnn_compile.cli.step_options import file_reading
from locsnn_compile.cluster.spread import Spread, spread_over
from locsnn_compile.errors import InputError
from locsnn_compile.explore.events import report_events, written
from locsnn_compile.explore.exploration import Exploration
from locsnn_compile.explore.point import Point, Study
from locsnn_compile.explore.result import exploration_files, lines
from locsnn_compile.explore.sweep import Store, auto_bounds, sweep
from locsnn_compile.families import family_of
from locsnn_compile.settings import DIALS, Value, settings, weight_bits_of
from locsnn_compile.verification.error_bounds import ErrorBudget

ENGINES = ("fast", "reference")
DEFAULT_TARGET = "loihi-sim"
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
    check_explored_places(args, folder, WRITTEN)
    targets = tuple(dict.fromkeys(args.target or (DEFAULT_TARGET,)))
    try:
        with spread_over(args.scheduler, args.workers) as spread:
            if not _has_grid(targets):
                return explore_chips(args, targets, folder, spread)
            exploration = _explore(args, targets[0], wanted, folder, spread)
    except KeyboardInterrupt:
        print("Stopped. The same command resumes from here.", file=sys.stderr)
        return EXIT_INTERRUPTED
    files = exploration_files(exploration)
    write_build(folder, files)
    if args.json:
        sys.stdout.write(files["explore.json"].decode())
    elif not args.quiet:
        print("\n".join([*lines(exploration), f"wrote {folder}/: {', '.join(files)}"]))
    if exploration.recommendation.taken is None and not exploration.by_default:
        print(f"gate failed: {exploration.recommendation.why}.", file=sys.stderr)
        return EXIT_GATE
    return 0


def _has_grid(targets: Sequence[str]) -> bool:
    """Tell whether there is one chip, with several settings to choose from."""
    if len(targets) > 1:
        return False
    return family_of(chip_named(targets[0])).bounds_choose


def _explore(
    args: argparse.Namespace,
    target: str,
    wanted: Mapping[str, Sequence[Value]],
    folder: Path,
    spread: Spread,
) -> Exploration:
    """Measure the grid, and then the front on the recordings of --report-on."""
    chip = hw.chip(target)
    compared = read_compared(args, folder)
    network = compared.network
    reported_on = None
    if args.report_on:
        reported_on = report_events(network, args.report_on, file_reading(args))
    engines = ENGINES if args.engines is None else tuple(dict.fromkeys(args.engines))
    study = Study(
        network,
        compared.model.digest(),
        chip,
        compared.events.recordings,
        compared.calibration,
        engines,
    )
    store = Store(folder / "points", Point)
    with progress_bar("exploring", show=not args.quiet) as progress:
        tried = settings(network, wanted, weight_bits_of(chip, None))
        points = sweep(study, tried, store, spread, progress)
        asked_bounds = ErrorBudget(args.min_agreement, args.max_spike_error, args.max_score_error)
        budget = asked_bounds if asked_bounds.given else auto_bounds(study, points, store, spread)
    files = compared.written()
    if reported_on is not None and compared.rewritten:
        reported_on = written(replace(reported_on, file=None), folder / REPORTED)
    exploration = Exploration(
        study,
        compared.model,
        target,
        files.calibration_file,
        files.events,
        budget,
        not asked_bounds.given,
        points,
        reading_arguments=files.reading_arguments,
    )
    if reported_on is None:
        return exploration
    with progress_bar("reporting", show=not args.quiet) as progress:
        return exploration.report_on(reported_on, store, spread, progress)
