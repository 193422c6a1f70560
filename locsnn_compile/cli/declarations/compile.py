"""Options of ``locsnn-compile``, in the order of its help.

An option that several commands share is declared by a function of ``shared.py``. Where such a function adds several, a
comment names them.
"""

import argparse

from locsnn_compile.cli.completion import chips_of_all_families
from locsnn_compile.cli.declarations.kinds import choice, number
from locsnn_compile.cli.declarations.shared import (
    DEFAULT_TARGET,
    EVENT_FILES,
    add_chip,
    add_dial,
    add_division,
    add_document,
    add_error_bounds,
    add_folder,
    add_format_options,
    add_numbering,
    add_profile,
    add_psi,
    add_quiet,
    add_recordings,
    add_scheduler,
    add_sensor,
    add_times,
    add_weights,
)
from locsnn_compile.emitters import EMIT_KINDS
from locsnn_compile.frontends.formats import models_in_words
from locsnn_compile.settings import DIALS, SPIKE_WORTH


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn-compile``."""
    parser.add_argument(
        "model",
        metavar="MODEL",
        nargs="+",
        help=f"{models_in_words()}; several become one program, which adds their class scores",
    )
    add_weights(parser)
    add_chip(
        parser,
        "--target",
        f"chip name or chip file (default {DEFAULT_TARGET})",
        default=DEFAULT_TARGET,
        completer=chips_of_all_families,
    )
    add_profile(
        parser,
        "costs of operations in the report: a profile of the chip, or your own YAML "
        "file (default: the chip's first)",
    )
    add_folder(parser, "build/<model name>")
    add_recordings(parser, "--events", f"recordings to check on: {EVENT_FILES}")
    # A dial is a choice of the compiler that --strategy auto and explore can vary, such as the
    # weight bits. The first, the strategy, decides most and comes first in the help.
    first_dial, *other_dials = DIALS
    add_dial(parser, first_dial)
    # Between the dials in the help, because --strategy auto compares settings on these recordings, and weights are
    # rounded for them.
    add_recordings(
        parser,
        "--calibration",
        "recordings for rounding and settings (an archive's train part; default: the "
        "model's own, or synthetic)",
    )
    for dial in sorted(other_dials, key=lambda dial: dial.name):
        add_dial(parser, dial)
    add_format_options(parser)  # such as --config: options that only some formats of models take
    add_numbering(parser)  # --channel-order
    # --step-seconds, --steps, --threshold, --start, --time-unit, --max-steps, --classes.
    add_times(parser)
    add_division(parser)  # --split, --fold
    # --axes, --grid, --layout, --channels, --polarities, --columns, and what to merge or leave out: --merge-polarities,
    # --only-taxels, --only-polarity, --merge-channels
    add_sensor(parser)
    add_psi(
        parser,
        "how late the time-weighted prediction shifts to the location branch "
        "(default: the model's own, or 10)",
    )
    parser.add_argument(
        "--events-per-step",
        metavar="N",
        type=number("--events-per-step", int, low=0),
        help=(
            "bound the time of any recording with at most N events in a step "
            "(default: the busiest step of the check)"
        ),
    )
    parser.add_argument(
        "--emit",
        metavar="KIND",
        action="extend",
        nargs="+",
        default=[],
        **choice("--emit", EMIT_KINDS),
        help=f"also write: {', '.join(EMIT_KINDS)}",
    )
    parser.add_argument(
        "--recording",
        metavar="K",
        type=int,  # its range depends on the recordings, so it is checked when they have been read
        help="the recording to emit, counted from 0 (default 0)",
    )
    parser.add_argument(
        "--probe",
        metavar="POPULATION[INDEX]",
        action="append",
        default=[],
        help="a neuron to show with --emit vcd",
    )
    add_document(parser, "report.json")
    add_quiet(parser)
    add_error_bounds(
        parser,
        agreement="exit 3 if prediction agreement is below X (0..1)",
        spikes="exit 3 if more than this share of spikes differs (0..1)",
        scores=(
            "exit 3 if class scores differ by more than this share of their spread between classes"
        ),
    )
    parser.add_argument(
        "--spike-worth",
        metavar="X",
        type=number("--spike-worth", float, low=0),
        help=(
            "without bounds, --strategy auto loses another percent of the spikes only to save X "
            f"percent of the cost (default {SPIKE_WORTH:g})"
        ),
    )
    parser.add_argument(
        "--max-energy-nj",
        metavar="X",
        type=number("--max-energy-nj", float, low=0),
        help="exit 3 if a recording takes more than X nanojoules on average",
    )
    parser.add_argument(
        "--max-latency-us",
        metavar="X",
        type=number("--max-latency-us", float, low=0),
        help="exit 3 if a recording takes more than X microseconds on average",
    )
    parser.add_argument(
        "--max-cores",
        metavar="N",
        type=number("--max-cores", int, low=0),
        help="exit 3 if more than N cores are used",
    )
    parser.add_argument("--junit", metavar="FILE", help="write the gates as JUnit XML")
    add_scheduler(parser, "play the recordings on the Dask cluster of this scheduler")
    parser.add_argument(
        "--options",
        metavar="FILE",
        help="YAML file of this command's options by name; the command line takes precedence",
    )
