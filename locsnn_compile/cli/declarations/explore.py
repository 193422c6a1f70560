"""Options of ``locsnn explore``, in the order of its help."""

import argparse

from locsnn_compile.cli.declarations.kinds import choice, number
from locsnn_compile.cli.declarations.shared import (
    add_chip,
    add_explored,
    add_format_options,
    add_numbering,
    add_sensor,
    add_times,
)
from locsnn_compile.frontends.formats import models_in_words
from locsnn_compile.settings import DIALS


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn explore``."""
    parser.add_argument("model", metavar="MODEL", help=f"{models_in_words()}")
    add_format_options(parser)
    parser.add_argument(
        "--events",
        metavar="FILE",
        help="recordings on which to compare (default: synthetic touches)",
    )
    parser.add_argument(
        "--part",
        metavar="PART",
        **choice("--part", ("train", "test")),
        help="train (default) or test, where the events are divided",
    )
    parser.add_argument(
        "--recordings",
        metavar="N",
        type=number("--recordings", int, low=1),
        help="use only N of them, evenly spread",
    )
    parser.add_argument(
        "--report-on",
        metavar="FILE",
        help=("other recordings on which to measure the front; they do not affect the choice"),
    )
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        help="recordings on which to calibrate (default: those of --events)",
    )
    add_times(parser)
    add_sensor(parser)
    add_numbering(parser)
    add_chip(parser, "--target", "chip name or chip file (default loihi-sim)", default="loihi-sim")
    for dial in DIALS:
        add_explored(parser, dial)
    parser.add_argument(
        "--engines",
        metavar="NAME",
        nargs="*",
        **choice("--engines", ("fast", "reference")),
        help="engines to time: fast, reference",
    )
    parser.add_argument(
        "--min-agreement",
        metavar="X",
        type=number("--min-agreement", float, low=0, high=1),
        help="recommend a setting that keeps this share of predictions",
    )
    parser.add_argument(
        "--max-spike-error",
        metavar="X",
        type=number("--max-spike-error", float, low=0, high=1),
        help="recommend a setting in which at most this share of spikes differs",
    )
    parser.add_argument(
        "--max-score-error",
        metavar="X",
        type=number("--max-score-error", float, low=0),
        help=(
            "recommend a setting in which class scores differ by at most this share of "
            "their spread between classes"
        ),
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", help="folder to write (default build/<model name>-explore)"
    )
    parser.add_argument(
        "--workers",
        metavar="N",
        type=number("--workers", int, low=1, high=256),
        help="measure in N processes of this machine",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="measure on the Dask cluster of this scheduler (needs dask)",
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print explore.json to standard output, and nothing else there",
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing")
