"""Options of ``locsnn explore``, in the order of its help."""

import argparse

from locsnn_compile.cli.declarations.kinds import choice, number
from locsnn_compile.cli.declarations.shared import (
    DEFAULT_TARGET,
    add_chips,
    add_document,
    add_error_bounds,
    add_explored,
    add_folder,
    add_format_options,
    add_numbering,
    add_quiet,
    add_recordings,
    add_scheduler,
    add_sensor,
    add_times,
)
from locsnn_compile.frontends.formats import models_in_words
from locsnn_compile.settings import DIALS


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn explore``."""
    parser.add_argument("model", metavar="MODEL", help=models_in_words())
    add_format_options(parser)
    add_recordings(
        parser, "--events", "recordings on which to compare (default: synthetic touches)"
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
    add_recordings(
        parser,
        "--report-on",
        "other recordings on which to measure the front; they do not affect the choice",
    )
    add_recordings(
        parser, "--calibration", "recordings on which to calibrate (default: those of --events)"
    )
    add_times(parser)
    add_sensor(parser)
    add_numbering(parser)
    add_chips(
        parser,
        "--target",
        f"chip name or chip file (default {DEFAULT_TARGET}); given several times, the network on "
        "each of them",
    )
    # A dial is a choice of the compiler, such as the weight bits: explore tries several values.
    for dial in DIALS:
        add_explored(parser, dial)
    parser.add_argument(
        "--engines",
        metavar="NAME",
        nargs="*",
        **choice("--engines", ("fast", "reference")),
        help="engines to time: fast, reference",
    )
    add_error_bounds(
        parser,
        agreement="recommend a setting that keeps this share of predictions",
        spikes="recommend a setting in which at most this share of spikes differs",
        scores=(
            "recommend a setting in which class scores differ by at most this share of "
            "their spread between classes"
        ),
    )
    add_folder(parser, "build/<model name>-explore")
    parser.add_argument(
        "--workers",
        metavar="N",
        type=number("--workers", int, low=1, high=256),
        help="measure in N processes of this machine",
    )
    add_scheduler(parser, "measure on the Dask cluster of this scheduler (needs dask)")
    add_document(parser, "explore.json")
    add_quiet(parser)
