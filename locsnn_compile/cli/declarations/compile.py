"""Options of ``locsnn-compile``, in the order of its help."""

import argparse

from locsnn_compile.cli.completion import chips_of_all_families
from locsnn_compile.cli.declarations.kinds import choice, number
from locsnn_compile.cli.declarations.shared import (
    add_chip,
    add_dial,
    add_division,
    add_format_options,
    add_numbering,
    add_sensor,
    add_times,
    add_weights,
)
from locsnn_compile.emitters import EMIT_KINDS
from locsnn_compile.frontends.formats import models_in_words
from locsnn_compile.settings import DIALS


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
        "chip name or chip file (default loihi-sim)",
        default="loihi-sim",
        completer=chips_of_all_families,
    )
    parser.add_argument(
        "--profile",
        metavar="NAME|FILE",
        help=(
            "costs of operations in the report: a profile of the chip, or your own YAML "
            "file (default: the chip's first)"
        ),
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", help="folder to write (default build/<model name>)"
    )
    parser.add_argument(
        "--events",
        metavar="FILE",
        help="recordings to check on: .zip, folder, .npy, .npz, .pt, .h5, or event files",
    )
    first_dial, *other_dials = DIALS
    add_dial(parser, first_dial)
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        help=(
            "recordings for rounding and settings (an archive's train part; default: the "
            "model's own, or synthetic)"
        ),
    )
    for dial in sorted(other_dials, key=lambda dial: dial.name):
        add_dial(parser, dial)
    add_format_options(parser)
    add_numbering(parser)
    add_times(parser)
    add_division(parser)
    add_sensor(parser)
    parser.add_argument(
        "--psi",
        metavar="X",
        type=number("--psi", float, low=0),
        help=(
            "how late the time-weighted prediction shifts to the location branch "
            "(default: the model's own, or 10)"
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
        type=int,
        help="the recording to emit, counted from 0 (default 0)",
    )
    parser.add_argument(
        "--probe",
        metavar="POPULATION[INDEX]",
        action="append",
        default=[],
        help="a neuron to show with --emit vcd",
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print report.json to standard output, and nothing else there",
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing")
    parser.add_argument(
        "--min-agreement",
        metavar="X",
        type=number("--min-agreement", float, low=0, high=1),
        help="exit 3 if prediction agreement is below X (0..1)",
    )
    parser.add_argument(
        "--max-spike-error",
        metavar="X",
        type=number("--max-spike-error", float, low=0, high=1),
        help="exit 3 if more than this share of spikes differs (0..1)",
    )
    parser.add_argument(
        "--max-score-error",
        metavar="X",
        type=number("--max-score-error", float, low=0),
        help=(
            "exit 3 if class scores differ by more than this share of their spread between classes"
        ),
    )
    parser.add_argument(
        "--max-energy-nj",
        metavar="X",
        type=number("--max-energy-nj", float),
        help="exit 3 if a recording takes more than X nanojoules on average",
    )
    parser.add_argument(
        "--max-latency-us",
        metavar="X",
        type=number("--max-latency-us", float),
        help="exit 3 if a recording takes more than X microseconds on average",
    )
    parser.add_argument(
        "--max-cores",
        metavar="N",
        type=number("--max-cores", int, low=0),
        help="exit 3 if more than N cores are used",
    )
    parser.add_argument("--junit", metavar="FILE", help="write the gates as JUnit XML")
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="play the recordings on the Dask cluster of this scheduler",
    )
    parser.add_argument(
        "--options",
        metavar="FILE",
        help=("YAML file of this command's options by name; the command line takes precedence"),
    )
