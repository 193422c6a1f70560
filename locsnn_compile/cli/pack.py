"""``locsnn pack``: put several checkpoints into one file, a committee.

Put checkpoints with the same input into one file, a committee, which adds their class scores.

example:
  locsnn pack examples/models/objects-hybrid.pt examples/models/objects-hybrid-loihi.pt -o both.pt --weights 1,2

`locsnn-compile both.pt` then compiles all of them into one program.
"""

# The docstring above is the help of the command, so it stays in these words.
# Without --weights, `join` finds weights with which the class scores of all members vary alike: on the recordings of
# --calibration, or else on those that the checkpoints carry.

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
    # Without the option, the path of --calibration is None, which the check skips.
    inputs = {f"MODEL {path!r}": path for path in args.model} | {"--calibration": args.calibration}
    # The output must not replace a file that is read.
    check_places(inputs, [("--output", Path(args.output))])
    if Path(args.output).suffix != ".pt":
        raise InputError("--output", "it is not a .pt file", fix="Give a name that ends in .pt.")
    if args.weights and args.calibration:
        raise InputError(
            "--calibration", "the weights are given", fix="Leave out --calibration or --weights."
        )
    # Reading checkpoints needs no torch, but writing the .pt file does: say so before the work.
    needed(package="torch", extra="train", where="locsnn pack")
    checkpoints = tuple(read_checkpoint(path) for path in args.model)
    committee = join(
        [network_of(checkpoint) for checkpoint in checkpoints],
        weights=args.weights,
        calibration=args.calibration,
        # How --calibration is read. All its recordings are used: the command has no options that divide them.
        reading=undivided_reading_options(args),
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
