"""Options of ``locsnn rtl sim``, in the order of its help."""

import argparse

from locsnn_compile.cli.declarations.kinds import number
from locsnn_compile.cli.declarations.shared import (
    add_division,
    add_json,
    add_numbering,
    add_played,
    add_sensor,
    add_times,
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn rtl sim``."""
    add_played(parser)
    parser.add_argument(
        "--simulator",
        metavar="NAME",
        default="verilator",
        help="verilator (default) or icarus, which is slow",
    )
    parser.add_argument(
        "--recordings",
        metavar="N",
        type=number("--recordings", int, low=1),
        help="play only the first N",
    )
    add_times(parser)
    add_division(parser)
    add_sensor(parser)
    add_numbering(parser)
    add_json(parser)
