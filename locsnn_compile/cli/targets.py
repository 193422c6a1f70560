"""``locsnn targets``: list the included chips.

List the included chips, or print the description of one as a start for your own chip file.

example:
  locsnn targets --show loihi-sim > my-chip.yaml
"""

# The docstring above is the help of the command, so it stays in these words.

import argparse

from hw_model.targets.families import FAMILIES, family_of


def run(args: argparse.Namespace) -> int:
    """List the included chips or, with ``--show``, print the description of one."""
    if args.show:
        chip = str(args.show)
        # The description ends in a line break of its own.
        print(family_of(chip).document(chip), end="")
        return 0
    for family in FAMILIES:
        for name in family.names():
            print(family.lines(name))
    return 0
