"""``locsnn explore`` with several chips, or with one chip that has a single setting.

The network is compiled for each chip, with every combination of the values that the user gave for
dials (settings of the compiler such as the weight bits). A point is one such attempt: its figures,
or the reason why the chip refused it. Nothing is recommended, because the costs of different chips
cannot be compared.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from hw_model.io.build_folder import write_build
from hw_model.values import Frozen
from locsnn_compile.cli.explored_inputs import REPORTED, Compared, read_compared
from locsnn_compile.cli.shell import EXIT_GATE, progress_bar
from locsnn_compile.cli.step_options import file_reading_options
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


class _Measured(Frozen, eq=False):
    """The points, and the figures of the same settings on the recordings of ``--report-on``.

    ``reported_on`` is None, and ``reported`` empty, without that option.
    """

    study: ChipStudy
    points: tuple[ChipPoint, ...]
    reported_on: Chosen | None
    reported: Mapping[ChipSetting, ChipFigures | None]


def explore_chips(
    args: argparse.Namespace, targets: Sequence[str], folder: Path, spread: Spread
) -> int:
    """Compile one network for each chip, compare the results, and return the exit code.

    Raises ``InputError`` for recordings or options that fit no chip, and the error of the chips
    (``InputError`` or ``TargetError``) if none of them can hold the network.
    """
    compared = read_compared(args, folder)
    measured = _measure(args, targets, compared, Store(folder / "points", ChipPoint), spread)
    budget = ErrorBudget(args.min_agreement, args.max_spike_error, args.max_score_error)
    commands = _commands(compared, measured.reported_on, folder)
    document = chips_document(measured.study, measured.points, commands, budget, measured.reported)
    events_words = compared.events.words()
    contents = chips_files(document, events_words)
    if measured.study.engines:
        contents["timings.csv"] = timings_file(measured.points)
    write_build(folder, contents)
    if args.json:
        sys.stdout.write(contents["explore.json"].decode())
    elif not args.quiet:
        reported_words = "" if measured.reported_on is None else measured.reported_on.words()
        lines = chips_lines(document, events_words, reported_words, measured.points)
        print("\n".join([*lines, f"wrote {folder}/: {', '.join(contents)}"]))
    if budget.given and not document.keep_bounds:
        print(f"gate failed: no chip keeps {budget.words()}.", file=sys.stderr)
        return EXIT_GATE
    return 0


def _measure(
    args: argparse.Namespace,
    targets: Sequence[str],
    compared: Compared,
    store: Store[ChipPoint],
    spread: Spread,
) -> _Measured:
    """Measure every chip with every combination of the values given.

    With ``--report-on``, measure those that the chips did not refuse once more, on these recordings.
    """
    network = compared.network
    reported_on = None
    if args.report_on:
        reported_on = report_events(network, args.report_on, file_reading_options(args))
    study = ChipStudy(
        network=network,
        model_digest=compared.model.digest(),
        chips=chips_of(targets),
        recordings=compared.events.recordings,
        calibration=compared.calibration,
        engines=tuple(dict.fromkeys(args.engines or ())),
    )
    settings = chip_settings(targets, _values_to_try(args, network))
    with progress_bar("trying chips", show=not args.quiet) as progress:
        points = try_chips(study, settings, store, spread, progress)
    reported: dict[ChipSetting, ChipFigures | None] = {}
    if reported_on is not None:
        running = [point.setting for point in points if point.figures is not None]
        # Engines have been timed on the first recordings.
        report_study = replace(study, recordings=reported_on.recordings, engines=())
        with progress_bar("reporting", show=not args.quiet) as progress:
            for point in try_chips(report_study, running, store, spread, progress):
                reported[point.setting] = point.figures
    return _Measured(study, points, reported_on, reported)


def _values_to_try(args: argparse.Namespace, network: Network) -> dict[str, Sequence[Value]]:
    """Return the values that the user gave, by dial; refuse dials that change nothing here."""
    values = {dial.name: getattr(args, dial.name) or () for dial in DIALS}
    may_be_idle = {dial.name: dial.option for dial in DIALS if dial.idle and values[dial.name]}
    check_matters(network, may_be_idle)
    return values


def _commands(compared: Compared, reported_on: Chosen | None, folder: Path) -> ChipCommands:
    """Return the files and options that the printed commands name.

    Writes copies of recordings that no file holds as they were read.
    """
    # write_build makes the folder, but only later, and the copies lie in it.
    folder.mkdir(parents=True, exist_ok=True)
    files = compared.written()
    if reported_on is not None and compared.rewritten:
        # One command reads all its files with the same options: these need a copy as well.
        reported_on = written(replace(reported_on, file=None), folder / REPORTED)
    return ChipCommands(
        model=compared.model,
        events=files.events,
        calibration_file=files.calibration_file,
        reading_arguments=files.reading_arguments,
        reported_on=reported_on,
    )
