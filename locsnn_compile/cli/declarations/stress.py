"""Options of ``locsnn stress``, in the order of its help."""

import argparse
from pathlib import Path

from locsnn_compile.cli.declarations.shared import DEFAULT_TARGET, add_chip, add_json


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn stress``."""
    help = f"chip name or chip file (default {DEFAULT_TARGET})"
    add_chip(parser, "--target", help, default=DEFAULT_TARGET)
    parser.add_argument(
        "--quick",
        action="store_true",
        help="play only some of the rows, and shorter long runs; takes seconds, not minutes",
    )
    add_json(parser, "print all rows as JSON")
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        type=Path,
        help="write a page; a table of all rows (.csv) and pictures go next to it",
    )
