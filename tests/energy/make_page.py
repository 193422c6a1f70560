"""Write docs/energy-130nm.md: what a recording costs on the open core in 130 nm cells, and what would cost less.

make energy           # after `make profile`, whose simulations it uses
"""

import csv

import mac
import make_profile
import memories
import numpy as np
import picojoules
import pricing
import runs

import hw_model as hw
from locsnn_compile.frontends import load
from locsnn_compile.pipeline import lower

PAGE = runs.ROOT / "docs/energy-130nm.md"
SEARCH = runs.ROOT / "docs/energy-130nm-memories.csv"
PRICES = (0.0, 1.0, 2.0, 4.0, 6.0, 8.0, 12.0, 20.0, 50.0)
MACS = {"CNN-3D": 1_568_520, "GRU-MLP": 2_641_152}
"""Multiply-accumulates per recording of Objects, as `ann_comparison` of a report gives them."""


def main() -> None:
    """Write the page."""
    built = make_profile.build(make_profile.given_library(__doc__))
    of_sets = {}
    for name, model in make_profile.SETS.items():
        program = runs.compiled(model)
        recordings = runs.real(name, "test", make_profile.CHECKED_ON)
        played = built.play(program, runs.stacked(program, recordings))
        of_sets[name] = (model, played, {wires: built.energy(played, wires) for wires in ("none", "modelled")})
    rows = search(built.files)
    with SEARCH.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            (
                "price of area, pJ per µm2",
                "area of macros, mm2",
                "accesses, µJ per recording",
                *(c.shape.name for c in rows[0][3]),
            )
        )
        writer.writerows((p, f"{a:.3f}", f"{e:.2f}", *(c.text for c in chosen)) for p, a, e, chosen in rows)
    PAGE.write_text(page(built, of_sets, rows, mac.measure(built.files)))


def search(files: runs.Library) -> list[tuple[float, float, float, list[memories.Choice]]]:
    """Return for prices of area: area (mm2), energy of accesses (µJ per recording) and the macros."""
    found = []
    for price in PRICES:
        chosen = runs.plan(files, price)
        found.append((price, sum(c.area for c in chosen) / 1e6, sum(map(runs.cost, chosen)) / 1e6, chosen))
    return found


def savings(built: runs.Built, played: object, spent: picojoules.Energy) -> list[tuple[str, float]]:
    """Return what each measure saves, in microjoules per recording, against the core without it."""
    chosen = {choice.shape.name: choice for choice in built.chosen}
    cycles = played.answers[:, 4:7].sum(axis=1).mean()
    rows = pricing.accesses(pricing.Made(built, [played], []))
    recordings = len(played.answers)
    always = sum(chosen[n].read_pj * (cycles - rows[n][0] / recordings) for n in ("fires", "sums", "tallies", "places"))
    clocked = float(spent.of("clock").mean())
    a_flop = _pj_of_a_tick(built)
    stopped = a_flop * len(built.circuit.flops) * cycles - clocked
    plain = [
        min((c for c in runs.options(built.files, s.shape) if c.pack == 1), key=lambda c: c.area) for s in built.chosen
    ]
    flat = sum(map(runs.cost, plain)) - sum(map(runs.cost, built.chosen))
    return [
        ("clocks that stop (`sg13g2_lgcp_1`) in place of clocks that always tick", stopped / 1e6),
        (
            "memories that are read only where somebody uses the word, in place of every cycle (four of them)",
            always / 1e6,
        ),
        ("banks and words packed into rows, in place of the least area", flat / 1e6),
    ]


def _pj_of_a_tick(built: runs.Built) -> float:
    """Return picojoules that a cycle costs in the clock pin of a flip-flop, with its share of the modelled tree."""
    toggles = np.zeros((built.circuit.nets, 1))
    ungated = np.ones(1)
    toggles[list(built.circuit.gates)] = 1
    accesses = np.zeros((100 * len(built.circuit.memories), 2, 1))
    cells, macros = built.files.cells, built.files.macros
    spent = picojoules.measure(built.circuit, cells, macros, built.times["modelled"], toggles, ungated, accesses, True)
    return float(spent.of("clock")[0]) / len(built.circuit.flops)


def ranking() -> str:
    """Return a table of strategies and weight bits, by the profile of this page and by ``davies2018``."""
    ours, theirs = hw.chip("locsnn-130nm").profile("ihp-sg13g2"), hw.chip("loihi-sim").profile("davies2018")
    network = load(runs.ROOT / "examples/models/objects-hybrid.pt")
    recordings = np.load(runs.ROOT / "examples/recordings/touches.npz")["spikes"].transpose(0, 2, 1)
    rows = []
    for bits in (4, 8):
        for strategy in ("reset", "delay-line", "dendrite", "paired-dendrite"):
            program = lower(network, hw.chip("loihi-sim"), bits, strategy).program
            counts = hw.simulate(program, recordings, probe=()).counts
            uj = [sum(hw.energy_pj(counts, one).values()) / len(recordings) / 1e6 for one in (theirs, ours)]
            many = (counts.synaptic_ops, counts.neuron_updates)
            rows.append(
                (f"{strategy}, {bits}-bit", *(f"{x:.1f}" for x in uj), *(f"{n / len(recordings):,.0f}" for n in many))
            )
    return table(("setting", "µJ, davies2018", "µJ, ihp-sg13g2", "synaptic operations", "updates"), rows)


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a table, numbers to the right."""
    line = "| --- |" + " ---: |" * (len(head) - 1)
    return "\n".join(("| " + " | ".join(head) + " |", line, *("| " + " | ".join(row) + " |" for row in rows))) + "\n"


def page(built: runs.Built, of_sets: dict, rows: list, unit: dict[str, float]) -> str:
    """Return the page."""
    _, played, ends = of_sets["Objects"]
    low, high = ends["none"], ends["modelled"]
    ops = played.answers[:, 2].mean()
    totals = []
    for name, (model_name, its, energies) in of_sets.items():
        a, b = (energies[w].total.mean() for w in ("none", "modelled"))
        per = its.answers[:, 2].mean()
        totals.append(
            (
                f"`{model_name}`, {name}",
                f"{a / 1e6:.1f} to {b / 1e6:.1f}",
                f"{a / per:.0f} to {b / per:.0f}",
                f"{per:,.0f}",
                f"{its.answers[:, 1].mean():,.0f}",
            )
        )
    kinds = [
        ("memories: " + n, x.mean(), x.mean())
        for n, x in sorted(high.memory.items(), key=lambda p: -p[1].mean())
        if x.mean() > 1e5
    ]
    kinds += [
        ("logic: " + n, low.logic[n].mean(), x.mean())
        for n, x in sorted(high.logic.items(), key=lambda p: -p[1].mean())
        if x.mean() > 1e5
    ]
    kinds += [
        ("clock: " + n, low.clock[n].mean(), x.mean())
        for n, x in sorted(high.clock.items(), key=lambda p: -p[1].mean())
        if x.mean() > 1e5
    ]
    parts = table(
        ("part", "µJ, least", "µJ, most", "pJ per synaptic operation, most"),
        [(n, f"{a / 1e6:.2f}", f"{b / 1e6:.2f}", f"{b / ops:.1f}") for n, a, b in kinds],
    )
    of_mac = unit["weights"] + unit["activations"]
    least, most = (of_mac + unit[f"{end} logic"] + unit[f"{end} clock"] for end in ("least", "most"))
    macs = table(("per recording of Objects", "operations", "µJ, least", "µJ, most"), [
        ("`objects-hybrid-loihi`, synaptic operations", f"{ops:,.0f}", f"{low.total.mean() / 1e6:.1f}", f"{high.total.mean() / 1e6:.1f}"),
        *((f"{n}, multiply-accumulates of 8 bits", f"{m:,}", f"{m * least / 1e6:.1f}", f"{m * most / 1e6:.1f}") for n, m in MACS.items()),
    ])  # fmt: skip
    cells, macros = built.leakage_nw
    with make_profile.CHECK.open() as file:
        off = [abs(float(row["difference"])) for row in csv.DictReader(file)]
    saved = table(
        ("measure", "µJ per recording"),
        [(what, f"{uj:.1f}") for what, uj in sorted(savings(built, played, high), key=lambda p: -p[1])],
    )
    front = table(
        ("area of macros, mm2", "accesses, µJ per recording"), [(f"{a:.2f}", f"{e:.1f}") for _, a, e, _ in rows]
    )
    gated = len([1 for f in built.circuit.flops if built.circuit.at(f, "CLK") in built.circuit.gates])
    area = (built.cell_area + built.macro_area) / 1e6
    most_uj, per_op = high.total.mean() / 1e6, high.total.mean() / ops
    fast, slow = built.times["none"].worst, built.times["modelled"].worst
    return TEXT.format(
        totals=table(("network, 20 test recordings", "µJ per recording", "pJ per synaptic operation", "synaptic operations", "cycles"), totals),
        parts=parts, macs=macs, saved=saved, front=front, area=area, macro_area=built.macro_area / 1e6, cell_area=built.cell_area / 1e6,
        flops=len(built.circuit.flops), gated=gated, gates=len(built.circuit.gates), cells=len(built.netlist.instances) - len(built.circuit.memories),
        macros=len(built.circuit.memories), fast=fast, slow=slow, mhz=1000 / fast, slow_mhz=1000 / slow, wires=built.wires.name,
        line=built.wires.line, leak_cells=cells / 1e3, leak_macros=macros / 1e3, off=max(off), mean_off=sum(off) / len(off),
        most_uj=most_uj, per_op=per_op, mac=f"{least:.0f} to {most:.0f}", mac_memory=of_mac, glitches=unit["glitches"],
        logic=high.of("logic").mean() / 1e6, glitch_bound=high.of("logic").mean() / 1e6 * (unit["glitches"] - 1),
        ranking=ranking(), charges=high.memory["charges"].mean() / ops, mac_area=unit["area"],
    )  # fmt: skip


TEXT = """\
# Energy in 130 nm

The open core of [hardware](hardware.md), mapped to the standard cells and memory macros of IHP SG13G2, an open 130 nm process
(1.2 V, 25 C, typical). The process publishes what an access and a transition cost; this page adds them up. There is no layout
and no chip: figures are of synthesis (yosys) and of gate-level simulation. `make profile` and `make energy` make all of it from
the liberty files, which are not part of this project.

    locsnn-compile examples/models/objects-hybrid-loihi.pt --target locsnn-130nm

## What a recording costs

All dynamic energy, from cleaning the memories to the class, with a host that is always ready. The lower end has no wires; the
upper end has the wire load that the library selects for this area of cells (`{wires}`, line {line} of its file) and a clock tree
with a buffer for every sixteen pins.

{totals}
| | goal | reached |
| --- | ---: | ---: |
| pJ per synaptic operation, upper end | 60 | {per_op:.0f}: missed |
| µJ per recording, upper end | 16 | {most_uj:.0f}: missed |
| area without pads, mm2 | 3 | {area:.2f}: missed |
| clock, MHz | 100 | {mhz:.0f} without wires; {slow_mhz:.0f} with them: missed |
| profile against gate level, 40 recordings that it has not seen | 5 % | {off:.1%} at most, {mean_off:.1%} on average: reached |

{cells:,} cells take {cell_area:.2f} mm2 and {macros} macros {macro_area:.2f} mm2; {flops:,} flip-flops, {gated:,} of them behind {gates} clock gates. The clock is a
graph-based static analysis over the liberty tables: ideal clock, worse of both edges, no false paths. Leakage is apart:
{leak_cells:.1f} µW of cells and {leak_macros:.1f} µW of macros, by `cell_leakage_power` of the files.

## Where it goes

Objects, parts above 0.1 µJ:

{parts}
**What limits it.** Charges under way cost {charges:.0f} pJ per synaptic operation, for a read and a write of a 16-bit macro: no macro
that the process offers makes the two cheaper than 32 pJ. An update reads 100 bits of constants, which many compartments share,
and reads and writes 54 bits of state. Less takes another architecture: charges in latches, constants by profile, several
synapses per cycle from one row.

## Three savings

Against the same core without the measure, computed from counted cycles and accesses:

{saved}
The choice of macros is a search over macros, banks and words per row for the accesses of a recording of Objects, at a price of
area ([all plans](energy-130nm-memories.csv)):

{front}
## The profile

Profile `ihp-sg13g2` of `hw_model/chips/locsnn-130nm.yaml` prices counts of the simulator, so that any program that fits is
reported on without the library. Accesses are priced by the macros' files; logic and clocks by gate-level activity of eight
training recordings of each set, in cycles of delivery per synaptic operation and in cycles of updates per update. On 20 test
recordings of each set it is {off:.1%} off at most ([all](energy-130nm-check.csv)). A script that knows neither RTL nor library
(`tests/energy/sums.py`) adds up the same accesses from the simulator's spikes and currents, and is within 2 %.

## The ranking of settings

`objects-hybrid` on `touches.npz`, the same counts by both profiles; what has delays, or charges of more than 16 bits, needs a
larger core than this one.

{ranking}
The order is the same. Here an update costs four synaptic operations when it is active and more than three at rest, where
`davies2018` has 3.4 and 2.2, so that helper compartments cost more: `reset` gains on `dendrite`. Narrower weights save
nothing in a word of fixed width, only where weights become 0 and are pruned.

## Conventional networks in the same cells

A multiply-accumulate unit of 8 bits (`tests/energy/mac.sv`, {mac_area:,.0f} µm2) takes {mac} pJ for each product, {mac_memory:.0f} pJ of it for
weights and activations from 64-bit rows of 1,024-word macros, eight to a row. Weights are normal and half of the activations
are 0.

{macs}
CNN-3D takes less than the spiking network, GRU-MLP more, though the spiking network has a sixth and a tenth of their operations: a
synaptic operation adds to one of many charges in memory, and a product to a sum in a register. Not comparable: the unit has no control, no schedule and no memory for what it computes; reuse of a row
would lower its energy, moving of partial results would raise it.

SYNtzulA (2025), in the same process, publishes 36.5 pJ per synaptic operation at 125 MHz and 6.8 mm2 with pads. Its figure is of
other networks, with another neuron, and is not broken down like this; this core takes {per_op:.0f}.

## What is left out

| what | bound |
| --- | --- |
| transitions before gates settle (glitches) | with a unit of delay per gate the multiply-accumulate unit has {glitches:.1f} times the transitions; if all logic had, {glitch_bound:.1f} µJ |
| wires and clock tree | the range; a layout may exceed it |
| waiting for a sensor in real time | only leakage, if the clock of the core stops |
| cleaning of memories and readout | in the figures above, not in the profile: less than 1 % |
| pads, host, loading of weights | not known |
"""

if __name__ == "__main__":
    main()
