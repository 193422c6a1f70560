"""``locsnn targets``: list the included chips.

List the included chips, or print the description of one as a start for your own chip file.

example:
  locsnn targets --show loihi-sim > my-chip.yaml
"""

import argparse

from hw_model.targets.families import FAMILIES, family_of


def run(args: argparse.Namespace) -> int:
    """List the chips, or print one."""
    if args.show:
        shown = str(args.show)
        print(family_of(shown).document(shown), end="")
        return 0
    for family in FAMILIES:
        for name in family.names():
            print(family.lines(name))
    return 0
