"""``locsnn compile``: compile a model; the same as `locsnn-compile`.

Compile a trained spiking network for a neuromorphic chip, check every spike, report the cost.

example:
  %(prog)s examples/models/objects-hybrid.pt --events examples/recordings/touches.npz

Without --events, the check plays the recordings in the model, or else synthetic touches; the report says which.
Exit codes: 0 done; 1 the chip cannot hold the model; 2 wrong usage or unreadable input; 3 a gate failed.
"""

# The docstring above is the help of the command, so it stays in these words.

import sys
from argparse import Namespace
from collections.abc import Sequence

from locsnn_compile.cli.declarations.shared import DEFAULT_TARGET
from locsnn_compile.cli.shell import (
    Parser,
    check_limits,
    parser_texts,
    run_guarded,
    with_declared_options,
)


def parser() -> Parser:
    """Return the argument parser of ``locsnn-compile``."""
    return with_declared_options(Parser("locsnn-compile", **parser_texts("compile")), "compile")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    return run_guarded(parser(), argv, run)


def run(args: Namespace) -> int:
    """Compile as ``args`` ask. Raises ``InputError`` and ``TargetError``."""
    check_limits("compile")
    if args.target == DEFAULT_TARGET:
        # Numba takes seconds to compile the loops of the fast engine if its cache is empty. For the
        # default chip it is clear without reading any file that they will be needed, so other
        # processes compile them during the slow imports below. For another chip this begins once
        # the chip has been read.
        from locsnn_compile.mesh.ahead import compile_loops_at_once

        compile_loops_at_once()
    # Imported here, because it is slow and the help does not need it.
    from locsnn_compile.cli.build import build

    return build(args)


if __name__ == "__main__":
    sys.exit(main())
