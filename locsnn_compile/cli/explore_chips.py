"""What ``locsnn explore`` does with several chips, or one of one setting: one network on each."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from hw_model.io.build_folder import write_build
from hw_model.values import Frozen
from locsnn_compile.cli.explored_inputs import REPORTED, Compared, read_compared
from locsnn_compile.cli.shell import EXIT_GATE, progress_bar
from locsnn_compile.cli.step_options import file_reading
from locsnn_compile.cluster.spread import Spread
from locsnn_compile.explore.chip_points import (
    ChipFigures,
    ChipPoint,
    ChipSetting,
    ChipStudy,
    chip_settings,
    chips_of,
    try_chips,
)
from locsnn_compile.explore.chips import ChipCommands, chips_document
from locsnn_compile.explore.chips_result import chips_files, chips_lines, timings_file
from locsnn_compile.explore.events import Chosen, report_events, written
from locsnn_compile.explore.sweep import Store
from locsnn_compile.network.network import Network
from locsnn_compile.settings import DIALS, Value, check_matters
from locsnn_compile.verification.error_bounds import ErrorBudget


class _Tried(Frozen, eq=False):
    """What was measured, and the recordings of ``--report-on``, if there are any."""

    study: ChipStudy
    points: tuple[ChipPoint, ...]
    reported_on: Chosen | None
    reported: Mapping[ChipSetting, ChipFigures | None]


def explore_chips(
    args: argparse.Namespace, targets: Sequence[str], folder: Path, spread: Spread
) -> int:
    """Put one network on chips; return the exit code.

    Raises ``InputError`` for what fits no chip, and an error if no chip can hold the network.
    """
    compared = read_compared(args, folder)
    tried = _try(args, targets, compared, Store(folder / "points", ChipPoint), spread)
    budget = ErrorBudget(args.min_agreement, args.max_spike_error, args.max_score_error)
    commands = _commands(compared, tried.reported_on, folder)
    document = chips_document(tried.study, tried.points, commands, budget, tried.reported)
    in_words = compared.events.words()
    contents = chips_files(document, in_words)
    if tried.study.engines:
        contents["timings.csv"] = timings_file(tried.points)
    write_build(folder, contents)
    if args.json:
        sys.stdout.write(contents["explore.json"].decode())
    elif not args.quiet:
        reported_on = "" if tried.reported_on is None else tried.reported_on.words()
        lines = chips_lines(document, in_words, reported_on, tried.points)
        print("\n".join([*lines, f"wrote {folder}/: {', '.join(contents)}"]))
    if budget.given and not document.keep_bounds:
        print(f"gate failed: no chip keeps {budget.words()}.", file=sys.stderr)
        return EXIT_GATE
    return 0


def _try(
    args: argparse.Namespace,
    targets: Sequence[str],
    compared: Compared,
    store: Store[ChipPoint],
    spread: Spread,
) -> _Tried:
    """Measure every chip with every combination of the values given, then those that run once more."""
    network = compared.network
    reported_on = None
    if args.report_on:
        reported_on = report_events(network, args.report_on, file_reading(args))
    study = ChipStudy(
        network=network,
        model_digest=compared.model.digest(),
        chips=chips_of(targets),
        recordings=compared.events.recordings,
        calibration=compared.calibration,
        engines=tuple(dict.fromkeys(args.engines or ())),
    )
    settings = chip_settings(targets, _wanted(args, network))
    with progress_bar("trying chips", show=not args.quiet) as progress:
        points = try_chips(study, settings, store, spread, progress)
    reported: dict[ChipSetting, ChipFigures | None] = {}
    if reported_on is not None:
        running = [point.setting for point in points if point.figures is not None]
        again = replace(study, recordings=reported_on.recordings, engines=())
        with progress_bar("reporting", show=not args.quiet) as progress:
            for point in try_chips(again, running, store, spread, progress):
                reported[point.setting] = point.figures
    return _Tried(study, points, reported_on, reported)


def _wanted(args: argparse.Namespace, network: Network) -> dict[str, Sequence[Value]]:
    """Return the values given, by dial; refuse dials that change nothing for the network."""
    wanted = {dial.name: getattr(args, dial.name) or () for dial in DIALS}
    idle = {dial.name: dial.option for dial in DIALS if dial.idle and wanted[dial.name]}
    check_matters(network, idle)
    return wanted


def _commands(compared: Compared, reported_on: Chosen | None, folder: Path) -> ChipCommands:
    """Return what commands name; write copies of recordings that no file holds as they were read."""
    folder.mkdir(parents=True, exist_ok=True)
    files = compared.written()
    if reported_on is not None and compared.rewritten:
        reported_on = written(replace(reported_on, file=None), folder / REPORTED)
    return ChipCommands(
        model=compared.model,
        events=files.events,
        calibration_file=files.calibration_file,
        reading_arguments=files.reading_arguments,
        reported_on=reported_on,
    )
