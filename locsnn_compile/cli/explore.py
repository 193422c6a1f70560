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

# The docstring above is the help of the command, so it stays in these words. A setting is one value
# for each dial of the compiler: strategy, weight bits and split weights (settings.py). A point is a
# setting that was compiled and checked. The front holds the points that no other point beats in
# error, energy and time at once.

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import hw_model as hw
from hw_model.io.build_folder import check_folder, default_folder, write_build
from hw_model.simulation import Engine
from hw_model.targets.families import chip_named
from locsnn_compile.cli.declarations.shared import DEFAULT_TARGET
from locsnn_compile.cli.explore_chips import explore_chips
from locsnn_compile.cli.explored_inputs import REPORTED, check_explored_places, read_compared
from locsnn_compile.cli.interrupt import EXIT_INTERRUPTED
from locsnn_compile.cli.shell import EXIT_GATE, progress_bar
from locsnn_compile.cli.step_options import file_reading_options
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

ENGINES: tuple[Engine, ...] = ("fast", "reference")
"""The engines that are timed if ``--engines`` is not given."""
WRITTEN = ("explore.csv", "explore.json", "explore.svg", "timings.csv", "timings.svg")
"""The files in the output folder, which also gets the folder of the points."""


def run(args: argparse.Namespace) -> int:
    """Explore as ``args`` ask; return the exit code. Raises ``InputError`` and ``TargetError``."""
    # An option of a dial that was not given is None: then the usual values of the dial are tried.
    values_to_try: dict[str, list[Value]] = {
        dial.name: getattr(args, dial.name) or [] for dial in DIALS
    }
    if args.workers and args.scheduler:
        raise InputError(
            "--workers",
            "a scheduler has workers of its own",
            fix="Leave out --workers or --scheduler.",
        )
    folder = Path(args.output) if args.output else default_folder(args.model, "-explore")
    check_folder(folder, WRITTEN)
    check_explored_places(args, folder, WRITTEN)
    targets = tuple(dict.fromkeys(args.target or (DEFAULT_TARGET,)))  # without repeats, in order
    try:
        with spread_over(args.scheduler, args.workers) as spread:
            if not _has_grid(targets):
                return explore_chips(args, targets, folder, spread)
            exploration = _explore(args, targets[0], values_to_try, folder, spread)
    except KeyboardInterrupt:
        # Every finished point is a file by now, and is not measured again.
        print("Stopped. The same command resumes from here.", file=sys.stderr)
        return EXIT_INTERRUPTED
    files = exploration_files(exploration)
    write_build(folder, files)
    if args.json:
        sys.stdout.write(files["explore.json"].decode())
    elif not args.quiet:
        print("\n".join([*lines(exploration), f"wrote {folder}/: {', '.join(files)}"]))
    # Bounds that the user gave are a gate; the default ones only guide the recommendation.
    if exploration.recommendation.taken is None and not exploration.by_default:
        print(f"gate failed: {exploration.recommendation.why}.", file=sys.stderr)
        return EXIT_GATE
    return 0


def _has_grid(targets: Sequence[str]) -> bool:
    """Return whether there is a single chip, and several settings of it to choose from."""
    if len(targets) > 1:
        return False
    return family_of(chip_named(targets[0])).bounds_choose


def _explore(
    args: argparse.Namespace,
    target: str,
    values_to_try: Mapping[str, Sequence[Value]],
    folder: Path,
    spread: Spread,
) -> Exploration:
    """Measure the grid of settings, and then the front on the recordings of ``--report-on``.

    ``values_to_try`` are the values that the user gave, by dial.
    """
    chip = hw.chip(target)
    compared = read_compared(args, folder)
    network = compared.network
    reported_on = None
    if args.report_on:
        # Read before the sweep, so that a file that cannot be used is refused before hours of work.
        reported_on = report_events(network, args.report_on, file_reading_options(args))
    engines = ENGINES if args.engines is None else tuple(dict.fromkeys(args.engines))
    study = Study(
        network=network,
        model_digest=compared.model.digest(),
        chip=chip,
        recordings=compared.events.recordings,
        calibration=compared.calibration,
        engines=engines,
    )
    store = Store(folder / "points", Point)
    with progress_bar("exploring", show=not args.quiet) as progress:
        widest_bits = weight_bits_of(chip, bits=None)
        grid = settings(network, values_to_try, widest_bits)
        points = sweep(study, grid, store, spread, progress)
        bounds = ErrorBudget(args.min_agreement, args.max_spike_error, args.max_score_error)
        budget = bounds if bounds.given else auto_bounds(study, points, store, spread)
    files = compared.written()
    if reported_on is not None and compared.rewritten:
        # The printed commands read all files with the same options, so these recordings need a
        # copy as soon as the others have one.
        reported_on = written(replace(reported_on, file=None), folder / REPORTED)
    exploration = Exploration(
        study=study,
        model=compared.model,
        target=target,
        calibration=files.calibration_file,
        events=files.events,
        budget=budget,
        by_default=not bounds.given,
        points=points,
        reading_arguments=files.reading_arguments,
    )
    if reported_on is None:
        return exploration
    with progress_bar("reporting", show=not args.quiet) as progress:
        return exploration.report_on(reported_on, store, spread, progress)
