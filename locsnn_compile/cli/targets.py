"""``locsnn targets``: list the chips that ship.

List the chips that ship, or print a chip's description to start a chip file of your own from.

example:
  locsnn targets --show loihi-sim > my-chip.yaml
"""

import argparse


def run(args: argparse.Namespace) -> int:
    """List the chips, or print one."""
    import hw_model as hw

    if args.show:
        print(hw.chip(args.show).document, end="")
        return 0
    for name in hw.chip_names():
        chip = hw.chip(name)
        limits = chip.limits
        print(f"{name}: {chip.description}")
        if core := chip.open_core:
            held = f"{core.compartments} compartments, {core.axons} sources of spikes, {core.synapses} synapses"
            priced = f"energy profiles: {', '.join(chip.profiles)}" if chip.profiles else "energy is not known"
            print(f"  the program as a whole: {held}, {core.slots} slots; cycles are exact, {priced}")
            continue
        print(
            f"  {chip.chips} chip of {limits.cores_per_chip} cores; a core holds {limits.compartments_per_core} "
            f"compartments, {limits.input_axons_per_core} input axons, {limits.synapse_words_per_core} synapse words"
        )
        print(f"  energy profiles: {', '.join(chip.profiles)}")
    return 0
