"""Options of ``locsnn pack``, in the order of its help."""

import argparse

from locsnn_compile.cli.declarations.shared import (
    add_recordings,
    add_sensor,
    add_times,
    add_weights,
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn pack``."""
    parser.add_argument(
        "model", metavar="MODEL", nargs="+", help="checkpoints (.pt) of `locsnn train`"
    )
    parser.add_argument("-o", "--output", metavar="FILE", required=True, help="file to write (.pt)")
    add_weights(parser)
    add_recordings(
        parser, "--calibration", "recordings on which to find weights (default: the models' own)"
    )
    add_times(parser)
    add_sensor(parser)
