"""Options of ``locsnn rtl stream``, in the order of its help."""

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
    """Add the options of ``locsnn rtl stream``."""
    add_played(parser)
    parser.add_argument(
        "--port",
        metavar="PORT",
        required=True,
        help="serial device, or sim:verilator or sim:icarus",
    )
    parser.add_argument(
        "--baud",
        metavar="N",
        type=number("--baud", int, low=1),
        default=1000000,
        help="bits per second on the line (default 1000000)",
    )
    parser.add_argument(
        "--recordings",
        metavar="N",
        type=number("--recordings", int, low=1),
        help="play only the first N",
    )
    parser.add_argument(
        "--spikes",
        action="store_true",
        help="have the board report its spikes, and compare every one",
    )
    add_times(parser)
    add_division(parser)
    add_sensor(parser)
    add_numbering(parser)
    add_json(parser)
