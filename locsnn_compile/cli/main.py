"""``locsnn``: the commands around the compiler."""

from __future__ import annotations

from collections.abc import Sequence

from locsnn_compile.cli import diff, events, explore, run, stress, targets, train
from locsnn_compile.cli.shell import Parser, guarded


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command that the first argument names; return its exit code."""
    parser = Parser("locsnn", description="Train, run and inspect spiking networks; `locsnn-compile` compiles them.")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in (train, run, events, explore, diff, stress, targets):
        command.add_parser(commands)
    args = parser.parse_args(argv)
    return guarded(lambda: int(args.run(args)))
