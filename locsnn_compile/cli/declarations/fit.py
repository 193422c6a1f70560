"""Options of ``locsnn rtl fit``, in the order of its help."""

import argparse

from hw_model.description.boards import BOARDS
from locsnn_compile.cli.declarations.kinds import choice, number
from locsnn_compile.cli.declarations.shared import add_json, add_program


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn rtl fit``."""
    add_program(parser)
    parser.add_argument(
        "--device",
        metavar="NAME",
        help="ecp5-25f, ecp5-85f or ice40up5k (default: the program's target)",
    )
    parser.add_argument(
        "--board",
        metavar="NAME",
        **choice("--board", tuple(BOARDS)),
        help=f"{', '.join(BOARDS)} (default: the device's first)",
    )
    parser.add_argument(
        "--seeds",
        metavar="N",
        type=number("--seeds", int, low=1),
        default=5,
        help="number of placements; the slowest clock counts (default 5)",
    )
    add_json(parser)
