"""Options of ``locsnn rtl fit``, in the order of its help."""

import argparse

from hw_model.description.boards import BOARDS
from locsnn_compile.cli.declarations.kinds import number
from locsnn_compile.cli.declarations.shared import add_json, add_program
from locsnn_compile.errors import InputError, did_you_mean


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn rtl fit``."""
    add_program(parser)
    parser.add_argument(
        "--device",
        metavar="NAME",
        help="ecp5-25f, ecp5-85f or ice40up5k (default: the program's target)",
    )
    board = parser.add_argument(
        "--board",
        metavar="NAME|YAML",
        type=_board_name,
        help=f"{', '.join(BOARDS)}, or the YAML file of your own (default: the device's first)",
    )
    # argcomplete looks for this attribute, which argparse does not declare.
    board.completer = lambda **_: list(BOARDS)  # type: ignore[attr-defined]
    parser.add_argument(
        "--seeds",
        metavar="N",
        type=number("--seeds", int, low=1),
        default=5,
        help="number of placements; the slowest clock counts (default 5)",
    )
    add_json(parser)


def _board_name(text: str) -> str:
    """Return the name of an included board, or the path of a description; refuse any other name."""
    if not text.endswith((".yaml", ".yml")) and text not in BOARDS:
        fix = did_you_mean(text, BOARDS)
        raise InputError(f"--board {text}", "it is not known", fix=fix)
    return text
