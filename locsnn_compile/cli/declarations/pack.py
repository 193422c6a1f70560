"""Options of ``locsnn pack``, in the order of its help.

The command puts several checkpoints into one file, a *committee*: a network that adds the weighted class scores of all.
"""

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
    # How the events of --calibration become recordings: --step-seconds, --steps, --threshold and others.
    add_times(parser)
    add_sensor(parser)
