"""Options of ``locsnn run``, in the order of its help."""

import argparse

from locsnn_compile.cli.declarations.kinds import choice, number
from locsnn_compile.cli.declarations.shared import (
    add_division,
    add_json,
    add_least_agreement,
    add_numbering,
    add_played,
    add_profile,
    add_psi,
    add_recordings,
    add_scheduler,
    add_sensor,
    add_times,
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn run``."""
    add_played(parser)
    add_profile(parser, "costs of operations: a profile of the chip, or your own YAML file")
    parser.add_argument(
        "--engine",
        metavar="NAME",
        **choice("--engine", ("fast", "reference")),
        default="fast",
        help="fast or reference (default fast); both give the same integers",
    )
    parser.add_argument(
        "--stream",
        action="store_true",
        help="play step by step; show each change of the prediction, and the pace",
    )
    add_psi(
        parser, "with --stream or --stop margin: psi of the time-weighted prediction, such as 10"
    )
    _add_early_stop(parser)
    add_times(parser)
    add_division(parser)
    add_sensor(parser)
    add_numbering(parser)
    add_scheduler(parser, "play on the Dask cluster of this scheduler (needs dask)")
    add_json(parser)


def _add_early_stop(parser: argparse.ArgumentParser) -> None:
    """Add the options on stopping a recording before its last step."""
    parser.add_argument(
        "--stop",
        metavar="HOW",
        **choice("--stop", ("proven", "margin", "silence")),
        help="stop early: when the class is proven, leads by a margin, or in silence",
    )
    add_recordings(
        parser,
        "--calibrate",
        "with --stop margin: validation recordings on which to find the margin",
    )
    add_least_agreement(
        parser,
        "with --calibrate: share of these recordings to predict as after the last "
        "step (default 0.99)",
    )
    parser.add_argument(
        "--margin",
        metavar="X",
        type=number("--margin", float, above=0),
        help=(
            "with --stop margin: the margin, if you know it, as a difference of class "
            "scores (docs/how-to/streaming.md)"
        ),
    )
    parser.add_argument(
        "--silence",
        metavar="N",
        type=number("--silence", int, low=1),
        help="with --stop silence: steps without an event",
    )
