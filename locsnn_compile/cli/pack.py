"""``locsnn pack``: put several checkpoints into one file, a committee.

Put checkpoints with the same input into one file, a committee, which adds their class scores.

example:
  locsnn pack examples/models/objects-hybrid.pt examples/models/objects-hybrid-loihi.pt -o both.pt --weights 1,2

`locsnn-compile both.pt` then compiles all of them into one program.
"""

# The docstring above is the help of the command, so it stays in these words.

import argparse
from pathlib import Path

from hw_model.io.extras import needed
from locsnn_compile.api import join
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.step_options import undivided_reading_options
from locsnn_compile.errors import InputError
from locsnn_compile.frontends.checkpoint import network_of
from locsnn_compile.models.checkpoint import Pack
from locsnn_compile.models.checkpoint_reader import read_checkpoint


def run(args: argparse.Namespace) -> int:
    """Read the checkpoints, weigh their class scores, and write the committee."""
    inputs = {f"MODEL {path!r}": path for path in args.model} | {"--calibration": args.calibration}
    check_places(inputs, [("--output", Path(args.output))])
    if Path(args.output).suffix != ".pt":
        raise InputError("--output", "it is not a .pt file", fix="Give a name that ends in .pt.")
    if args.weights and args.calibration:
        raise InputError(
            "--calibration", "the weights are given", fix="Leave out --calibration or --weights."
        )
    # Reading checkpoints needs no torch, but writing the .pt file does: say so before the work.
    needed("torch", "train", "locsnn pack")
    checkpoints = tuple(read_checkpoint(path) for path in args.model)
    committee = join(
        [network_of(checkpoint) for checkpoint in checkpoints],
        args.weights,
        args.calibration,
        undivided_reading_options(args),
    )
    weights = tuple(member.weight for member in committee.members)
    Pack(checkpoints, weights).save(args.output)
    for member in committee.members:
        print(f"{member.name}: weight {member.weight:.6g}")
    if not args.weights:
        # join() has appended the sentence on how it found the weights.
        print(committee.assumptions[-1])
    print(f"wrote {args.output}")
    return 0
