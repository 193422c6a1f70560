"""``locsnn targets``: list the included chips.

List the included chips, or print the description of one as a start for your own chip file.

example:
  locsnn targets --show loihi-sim > my-chip.yaml
"""

import argparse

import hw_model as hw
from hw_model.targets import target_of
from hw_model.xylo.chips import xylo_chip, xylo_chip_document, xylo_chip_names
from locsnn_compile.report.words import sentence

XYLO_SAYS = "leaky neurons with decays by shifts, weights of 8 bits; energy is not known"


def run(args: argparse.Namespace) -> int:
    """List the chips, or print one."""
    if args.show:
        shown = str(args.show)
        is_xylo = shown in xylo_chip_names()
        print(xylo_chip_document(shown) if is_xylo else hw.chip(shown).document, end="")
        return 0
    for name in hw.chip_names():
        chip = hw.chip(name)
        priced = (
            f"energy profiles: {', '.join(chip.profiles)}"
            if chip.profiles
            else "energy is not known"
        )
        room = sentence(target_of(chip).called, chip=chip, priced=priced)
        print(f"{name}: {chip.description}\n  {room}")
    for name in xylo_chip_names():
        xylo = xylo_chip(name)
        print(f"{name}: {xylo.description}\n  a Xylo: {XYLO_SAYS}")
    return 0
