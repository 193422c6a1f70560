"""``locsnn``: the commands around the compiler.

Each command is a module of this package with a function ``run(args)``, and its docstring is its
help. ``compile`` is also a program of its own, ``locsnn-compile`` (``compile.py``).
"""

import sys
from collections.abc import Sequence

from locsnn_compile.cli.shell import Parser, add_command, add_common, run_guarded

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
"""In the order of the help."""
RTL_COMMANDS = ("rtl/sim", "rtl/fit", "rtl/stream")
"""Commands of ``locsnn rtl``, by the paths of their modules."""


def parser() -> Parser:
    """Return the argument parser, with a subparser for each command."""
    root = Parser("locsnn", description="Compile, train, run and inspect spiking networks.")
    add_common(root)
    commands = root.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in COMMANDS:
        add_command(commands, command)
    rtl = commands.add_parser("rtl", help="run programs on the open core, simulated or on a board")
    rtl_commands = rtl.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in RTL_COMMANDS:
        add_command(rtl_commands, command)
    return root


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command that the first argument names; return its exit code."""
    # add_command stores the function of each command as the default of ``run``.
    return run_guarded(parser(), argv, lambda args: int(args.run(args)))


if __name__ == "__main__":
    sys.exit(main())
