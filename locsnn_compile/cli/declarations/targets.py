"""Options of ``locsnn targets``, in the order of its help."""

import argparse

from locsnn_compile.cli.completion import chips


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn targets``."""
    target = parser.add_argument(
        "--show", metavar="CHIP", help="print the description of a chip, by name or chip file"
    )
    target.completer = chips  # type: ignore[attr-defined]
