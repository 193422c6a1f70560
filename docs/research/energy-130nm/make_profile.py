"""Make the energy profile of `locsnn-130nm` from the libraries and gate-level activity, and check it on other recordings.

make profile          # writes hw_model/chips/locsnn-130nm.yaml and docs/research/energy-130nm/check.csv
"""

import argparse
import csv
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import arrays
import gates
import numpy as np
import plans
import pricing
import runs
from latches import Latches

import hw_model as hw
from hw_model.rtl.images import layouts

CHIP = runs.ROOT / "hw_model/chips/locsnn-130nm.yaml"
CHECK = runs.ROOT / "docs/research/energy-130nm/check.csv"
SETS = {"Objects": "objects-hybrid-loihi", "Containers": "containers-hybrid-loihi"}
MADE_FROM = 24
"""Training recordings of a set that the profile is fitted to, one of each class in turn."""
QUIET = 8
"""Further training recordings: those with the fewest events, which tell updates and operations apart."""
CHECKED_ON = 20
"""Test recordings of a set that the profile is checked on. With the others at most 64 are played, the lanes of a simulation."""
SUPPLY = "1.2 V, 25 C, typical"


def build(folder: Path) -> runs.Built:
    """Return the core in the cells and macros of a folder."""
    files = runs.Library(folder)
    return runs.Built(files, plans.plan(files, most=plans.MOST_AREA), gated=True)


def given_library(what: str | None) -> Path:
    """Return the folder with the liberty files that the command line names; ``what`` says what the script is for."""
    parser = argparse.ArgumentParser(description=what)
    parser.add_argument(
        "--liberty", type=Path, default=runs.LIBRARY, help="folder with the liberty files"
    )
    folder: Path = parser.parse_args().liberty
    if not (folder / runs.CELLS).is_file():
        sys.exit(f"{folder.name}: no liberty files here. Give their folder with --liberty.")
    return folder


def main() -> None:
    """Write the chip file and the check."""
    built = build(given_library(__doc__))
    ends = {wires: pricing.price(made(built), wires) for wires in ("none", "modelled")}
    CHIP.write_text(chip_file(built, ends["none"], ends["modelled"]))
    rows = []
    for name in SETS:
        picojoules_of = pricing.compare(
            built, ends["modelled"], *played(built, name)[1], "modelled"
        )
        rows += [
            (
                name,
                recording,
                f"{by_profile:.0f}",
                f"{at_gate_level:.0f}",
                f"{by_profile / at_gate_level - 1:.4f}",
                f"{in_memories:.0f}",
            )
            for recording, (by_profile, at_gate_level, in_memories) in enumerate(picojoules_of)
        ]
        print(
            f"{name}: the profile is {np.abs(picojoules_of[:, 0] / picojoules_of[:, 1] - 1).max():.1%} off at most"
        )
    with CHECK.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            (
                "set",
                "recording",
                "profile, pJ",
                "gate level, pJ",
                "difference",
                "memories at gate level, pJ",
            )
        )
        writer.writerows(rows)


# A program, its recordings and what the netlist did while it played them.
Played = tuple[hw.ChipProgram, np.ndarray, gates.Activity]


@cache
def played(built: runs.Built, name: str) -> tuple[Played, Played]:
    """Play a set's recordings once; return those that the profile is made from, and those that it is checked on."""
    program = runs.compiled(SETS[name])
    train, test = runs.training(name, MADE_FROM, QUIET), runs.real(name, "test", CHECKED_ON)
    activity = built.play(
        program, runs.stacked(program, np.concatenate((train, test))), probes=True
    )
    train_count = len(train)
    return (program, train, activity.part(0, train_count)), (
        program,
        test,
        activity.part(train_count, train_count + len(test)),
    )


def made(built: runs.Built) -> pricing.Made:
    """Return what the profile is made of: training recordings of both sets."""
    return pricing.make(built, [played(built, name)[0] for name in SETS])


def chip_file(built: runs.Built, least: pricing.Priced, most: pricing.Priced) -> str:
    """Return the chip file, with the profile in it."""
    cells, macros = built.leakage_nw
    plan = "".join(f"#   {c.shape.name:<12}{c.text}\n" for c in built.chosen)
    every = sorted(built.files.macros.values(), key=lambda m: (m.ports, m.words, m.bits))
    lines = "".join(
        f"#   {m.file}: read {m.read_pj} (line {m.lines['read']}), write {m.write_pj} (line {m.lines['write']})\n"
        for m in every
    )
    constants = "".join(f"      {name}: {pj:.2f}\n" for name, pj in most.pj.items())
    ranges = "".join(
        f"      {name}: [{least.pj[name]:.2f}, {pj:.2f}]\n" for name, pj in most.pj.items()
    )
    sources = "".join(f"      {name}: {text}\n" for name, text in SOURCES.items())
    core = "".join(f"  {name}: {value}\n" for name, value in plans.capacity(built.chosen).items())
    words = "".join(
        f"  {name}: {many}\n" for name, many in plans.memory_words(built.chosen).items()
    )
    return TEXT.format(
        words=words, of_process=macros_of(built), plan=plan, macros=lines, core=core, constants=constants, ranges=ranges, sources=sources,
        area=(built.cell_area + built.macro_area) / 1e6, cell_area=built.cell_area / 1e6,
        leakage=(cells + macros) / 1e6,
        period=built.times["none"].worst, slow=built.times["modelled"].worst, fixed=most.fixed,
        half=layouts(replace(built.core.sizes, step=0, places=0))["synapses"].width // 2,
    )  # fmt: skip


def macros_of(built: runs.Built) -> str:
    """Return what memories can be made of: the macros of the process, and the arrays of latches of the plan."""
    kinds = {
        f"{m.ports}P {m.words}x{m.bits}": (m.words, m.bits, m.ports, m)
        for m in built.files.macros.values()
    }
    for array in built.chosen:
        if isinstance(array, Latches):
            words, bits = len(array.shape.held), array.shape.bits
            words = array.shape.words if array.shape.period else words
            kinds[f"latches {words}x{bits}"] = (words, bits, 2, arrays.measure(built.files, array))
    return "".join(
        f"  {name}: {{words: {words}, bits: {bits}, ports: {ports}, {'banks: 1, ' * name.startswith('latches')}area: {costs.area:.0f}, "
        f"read_pj: {costs.read_pj:.4f}, write_pj: {costs.write_pj:.4f}}}\n"
        for name, (words, bits, ports, costs) in sorted(
            kinds.items(), key=lambda kind: (kind[0][:2], kind[1][:2])
        )
    )


SOURCES = {
    "synaptic_ops": "macros synapses (two in a word); gates, latches and clocks",
    "neuron_updates": "macros of constants; gates, latches and clocks of any update",
    "neuron_updates_active": "macros states; what gates, latches and clocks take more than at rest",
    "spikes": "macros axons and synapses (the rest of a row)",
    "input_events": "macros axons, synapses (the rest of a row) and bitmap",
    "transpose_events": "macros axons and synapses (the rest of a row)",
}
TEXT = """\
# The open core of this project in the cells and memory macros of IHP SG13G2, an open 130 nm process. Nothing was made of it:
# there is no layout, and figures are of synthesis and gate-level simulation (docs/research/energy-130nm.md). `make profile` writes
# this file from the liberty files of the process, revision 5cccb16 of 2026-03-11, which are not part of this project.
#
# {area:.2f} mm2 of cells ({cell_area:.2f}) and macros, without wires, pads and gaps. The longest path takes {period:.1f} ns without wires,
# {slow:.1f} ns with wires of modules that are placed as blocks. Memories:
{plan}#
# Picojoules of an access on the clock pin, by file of sram/ and line of its `internal_power`:
{macros}name: locsnn-130nm
description: the open core in standard cells and memory macros of a 130 nm process
chips: 1
clock_ghz: 0.1                 # by a static analysis without wires

registers:                     # those of loihi-sim, except for the delays
  charge_bits: 21
  current_bits: 23
  voltage_bits: 23
  threshold_mantissa_bits: 17
  bias_mantissa_bits: 12
  bias_exponent_max: 7
  refractory_max: 63
  delay_max: 0                 # slots less two: what dendrites need

open_core:                     # parameters of locsnn_core.sv
{core}
memory_words:                  # of memories that are smaller than the parameters say
{words}
macros:                        # of the process, and arrays of latches at gate level: square micrometres, picojoules of a row
{of_process}
# One core hosts all cores of a program, phase after phase. The program as a whole has to fit the open core, so none of
# these limits is the first to be met.
mesh:
  columns: 1
  rows: 1
  cores_per_tile: 1024

limits:
  cores_per_chip: 1024
  compartments_per_core: 512
  input_axons_per_core: 1024
  output_axons_per_core: 8192
  synapse_words_per_core: 16384
  synapse_formats_per_core: 16
  compartment_profiles_per_core: 512
  threshold_profiles_per_core: 512

synapse_memory:                # a synapse is half a word, told in full
  word_bits: {half}
  run_length: 1
  run_header_bits: 0

profiles:
  ihp-sg13g2:
    source: "liberty files of IHP SG13G2 at {supply}; gate-level activity of the open core on recordings of touch"
    voltage_v: 1.2
    basis: "gate level without delays; upper end with modelled wires and a clock tree, lower end without; no layout"
    energy_pj:
{constants}    energy_pj_range:
{ranges}    sources:
{sources}    time_ns: {{}}
    barrier_ns: {{one_tile: 0.0, all_tiles: 0.0}}
    static_power:
      chip_mw: {leakage:.5f}
      source: "cell_leakage_power of cells and macros in the liberty files"
    not_included:
      - what: cleaning of the memories
        bound_recording_pj: {fixed:.0f}
        bound_source: writes of macros at gate level
      - transitions of gates before they settle (glitches)
      - pads, input and output, supply and clock generation
""".replace("{supply}", SUPPLY)

if __name__ == "__main__":
    main()
