"""``locsnn compile``: compile a model; the same as `locsnn-compile`.

Compile a trained spiking network for a neuromorphic chip, check every spike, report the cost.

example:
  %(prog)s examples/models/objects-hybrid.pt --events examples/recordings/touches.npz

Without --events, the check plays the recordings in the model, or else synthetic touches; the report says which.
Exit codes: 0 done; 1 the chip cannot hold the model; 2 wrong usage or unreadable input; 3 a gate failed.
"""

import sys
from argparse import Namespace
from collections.abc import Sequence

from locsnn_compile.cli.shell import Parser, check_limits, declared, guarded, texts_of

DEFAULT_TARGET = "loihi-sim"
"""Its loops are compiled ahead; what others need is known once they are read."""


def parser() -> Parser:
    """Return the argument parser of ``locsnn-compile``."""
    return declared(Parser("locsnn-compile", **texts_of("compile")), "compile")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    return guarded(parser(), argv, run)


def run(args: Namespace) -> int:
    """Compile as ``args`` ask. Raises ``InputError`` and ``TargetError``."""
    check_limits("compile")
    if args.target == DEFAULT_TARGET:
        from locsnn_compile.mesh.ahead import compile_loops_at_once

        compile_loops_at_once()
    from locsnn_compile.cli.build import build  # the help does not wait for it

    return build(args)


if __name__ == "__main__":
    sys.exit(main())
