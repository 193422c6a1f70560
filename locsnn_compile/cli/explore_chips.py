"""What ``locsnn explore`` does with several chips: compile one network for each, and compare."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from hw_model.io.build_folder import write_build
from locsnn_compile.cli.explored_inputs import read_compared
from locsnn_compile.cli.options import given
from locsnn_compile.cli.shell import progress_bar
from locsnn_compile.errors import InputError
from locsnn_compile.explore.chips import ChipCommands, ChipsDocument, ChipStudy, try_chips
from locsnn_compile.explore.chips_result import chips_files, chips_lines
from locsnn_compile.settings import DIALS, Value

_OF_ONE_CHIP = {
    "--engines": "engines are timed on one chip",
    "--report-on": "it measures the front of the settings of one chip",
    "--workers": "chips are tried one after the other",
    "--scheduler": "chips are tried one after the other",
    "--min-agreement": "a setting is recommended on one chip",
    "--max-spike-error": "a setting is recommended on one chip",
    "--max-score-error": "a setting is recommended on one chip",
}
"""Options that several chips have no use for, and why."""


def explore_chips(args: argparse.Namespace, targets: Sequence[str], folder: Path) -> int:
    """Put one network on several chips; return the exit code.

    Raises ``InputError`` for options that several chips have no use for, and if no chip can hold
    the network.
    """
    for option in given(args, _OF_ONE_CHIP):
        raise InputError(option, _OF_ONE_CHIP[option], fix="Leave it out, or give one --target.")
    dials = {dial.name: _one_value(dial.option, getattr(args, dial.name)) for dial in DIALS}
    compared = read_compared(args, folder)
    study = ChipStudy(compared.network, compared.events.recordings, compared.calibration, dials)
    with progress_bar("trying chips", show=not args.quiet) as progress:
        outcomes = try_chips(study, targets, progress)
    folder.mkdir(parents=True, exist_ok=True)  # for copies of recordings that no file holds
    files = compared.written()
    commands = ChipCommands(
        compared.model, files.events, files.calibration_file, dials, files.reading_arguments
    )
    document = ChipsDocument.of(study, outcomes, commands)
    in_words = compared.events.words()
    contents = chips_files(document, in_words)
    write_build(folder, contents)
    if args.json:
        sys.stdout.write(contents["explore.json"].decode())
    elif not args.quiet:
        lines = chips_lines(document, in_words)
        print("\n".join([*lines, f"wrote {folder}/: {', '.join(contents)}"]))
    return 0


def _one_value(option: str, values: Sequence[Value] | None) -> Value | None:
    """Return the value of a dial for every chip; refuse several, which are compared on one chip."""
    if not values:
        return None
    if len(values) > 1:
        what = "several values are compared on one chip"
        measured = ", ".join(map(str, values))
        fix = "Give one value, or one --target."
        raise InputError(option, what, measured=measured, fix=fix)
    return values[0]
