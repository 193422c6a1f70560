"""Options of ``locsnn targets``, in the order of its help."""

import argparse

from locsnn_compile.cli.completion import chips_of_all_families
from locsnn_compile.cli.declarations.shared import add_chip


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``locsnn targets``."""
    help = "print the description of a chip, by name or chip file"
    add_chip(parser, "--show", help, completer=chips_of_all_families)
