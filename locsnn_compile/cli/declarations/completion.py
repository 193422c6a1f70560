"""The only argument of ``locsnn completion``: the shell."""

import argparse

from locsnn_compile.cli.declarations.kinds import choice


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the argument of ``locsnn completion``."""
    parser.add_argument(
        "shell",
        metavar="SHELL",
        **choice("shell", ("bash", "zsh", "fish")),
        help="bash, zsh or fish",
    )
