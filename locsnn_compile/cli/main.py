"""``locsnn``: the commands around the compiler."""

import sys
from collections.abc import Sequence

from locsnn_compile.cli.shell import Parser, add_command, add_common, guarded

COMMANDS = (
    "compile",
    "train",
    "pack",
    "run",
    "events",
    "explore",
    "diff",
    "stress",
    "targets",
    "completion",
)


def parser() -> Parser:
    """Return the argument parser, with a subparser for each command."""
    root = Parser("locsnn", description="Compile, train, run and inspect spiking networks.")
    add_common(root)
    commands = root.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in COMMANDS:
        add_command(commands, command)
    core = commands.add_parser("rtl", help="run programs on the open core, simulated or on a board")
    kinds = core.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in ("rtl/sim", "rtl/fit", "rtl/stream"):
        add_command(kinds, command)
    return root


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command that the first argument names; return its exit code."""
    return guarded(parser(), argv, lambda args: int(args.run(args)))


if __name__ == "__main__":
    sys.exit(main())
