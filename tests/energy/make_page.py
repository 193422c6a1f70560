"""Write docs/energy-130nm.md: what a recording costs on the open core in 130 nm cells, and what would cost less.

make energy           # after `make profile`, whose simulations it uses
"""

import csv
from dataclasses import dataclass, replace

import gates
import mac
import make_profile
import memories
import numpy as np
import picojoules
import pricing
import repeats
import runs
from latches import Latches

import hw_model as hw
from hw_model.rtl.images import CoreProgram
from locsnn_compile.frontends import load
from locsnn_compile.pipeline import lower
from locsnn_compile.report.pictures.chart import Curve, Panel, draw

PAGE = runs.ROOT / "docs/energy-130nm.md"
FRONT = runs.ROOT / "docs/images/energy-130nm-memories.svg"
SEARCH = runs.ROOT / "docs/energy-130nm-memories.csv"
PRICES = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 20.0, 50.0)
ENDS = ("none", "modelled", "flat")
"""No wires, those of modules that are placed as blocks, and those of a flat layout."""
BEST = {"containers-best": "Containers", "objects-best": "Objects"}
PLAYED = {"containers-best": 20}
"""Recordings of networks that are mapped on a core of their own."""
MACS = {"CNN-3D": 1_568_520, "GRU-MLP": 2_641_152}
"""Multiply-accumulates per recording of Objects, as `ann_comparison` of a report gives them."""


def main() -> None:
    """Write the page."""
    built = make_profile.build(make_profile.given_library(__doc__))
    of_sets = {}
    for name, model in make_profile.SETS.items():
        _, _, played = make_profile.played(built, name)[1]
        of_sets[name] = (model, played, {wires: built.energy(played, wires) for wires in ENDS})
    rows = search(built.files)
    with SEARCH.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        names = [c.shape.name for c in rows[0].chosen]
        writer.writerow(("price of area, pJ per µm2", "area of memories, mm2", "accesses, µJ per recording", *names))
        writer.writerows(
            (row.price, f"{row.area:.3f}", f"{row.energy:.2f}", *(c.text for c in row.chosen)) for row in rows
        )
    FRONT.write_bytes(picture(rows))
    priced = pricing.price(make_profile.made(built), "modelled")
    PAGE.write_text(page(built, of_sets, rows, mac.measure(built.files), larger(built.files, priced)))


@dataclass(frozen=True)
class Plan:
    """What the search finds at a price of area: square millimetres, and microjoules per recording for accesses."""

    price: float
    area: float
    energy: float
    chosen: list[memories.Choice | Latches]


def search(files: runs.Library) -> list[Plan]:
    """Return a plan for every price of area, each once."""
    traffic, found = runs.traffic_of(), {}
    for price in PRICES:
        chosen = runs.plan(files, price)
        area = sum(runs.area(files, c) for c in chosen) / 1e6
        energy = sum(runs.cost(files, c, traffic[c.shape.name]) for c in chosen) / 1e6
        found.setdefault((area, energy), Plan(price, area, energy, chosen))
    return list(found.values())


def picture(rows: list[Plan]) -> bytes:
    """Return the front as a file."""
    taken = next(row for row in rows if row.price == runs.PRICE)
    curves = (
        Curve("plans of the search", tuple((row.area, row.energy) for row in sorted(rows, key=lambda row: row.area))),
        Curve("the one that is measured", ((taken.area, taken.energy),)),
    )
    panel = Panel("accesses, µJ per recording", "area of memories, mm2", curves, x_log=False, y_log=False)
    return draw("Memories of the core", [panel])


def savings(built: runs.Built, played: gates.Activity, spent: picojoules.Energy) -> list[tuple[str, float]]:
    """Return what each measure saves, in microjoules per recording, against the core without it."""
    traffic, files = runs.traffic_of(), built.files
    counts = hw.simulate(runs.compiled("objects-hybrid-loihi"), runs.real("Objects", "train", 4), probe=()).counts
    scale = played.answers[:, 2].mean() / (counts.synaptic_ops / 4)
    cycles = played.answers[:, 4:7].sum(axis=1).mean()
    clocked = float(spent.of("clock").mean())
    bits = len([i for i in built.circuit.order if files.cells[i.type].kind == "latch"])
    stopped = _pj_of_a_tick(built) * len(built.circuit.flops) * cycles - clocked
    in_macros = latched = flat = 0.0
    states, kept = next(c for c in built.chosen if c.shape.name == "states"), traffic["states"]
    assert isinstance(states, memories.Choice)
    lazy = (counts.neuron_updates / 4 - kept.reads) * states.read_pj
    lazy += (counts.neuron_updates_active / 4 - kept.writes) * states.write_pj
    for one in built.chosen:
        memory = traffic[one.shape.name]
        macros = [c for c in runs.options(files, memory) if isinstance(c, memories.Choice)]
        if isinstance(one, Latches):
            best = min(macros, key=lambda c: runs.cost(files, c, memory) + runs.PRICE * c.area)
            in_macros, latched = in_macros + runs.cost(files, best, memory), latched + runs.cost(files, one, memory)
        else:
            least = min((c for c in macros if c.pack == 1), key=lambda c: c.area)
            flat += runs.cost(files, least, memory) - runs.cost(files, one, memory)
    return [
        (
            "clocks that stop: of modules, of registers with an enable, and of eight bits of which none changes",
            stopped / 1e6,
        ),
        (f"latches in place of macros for the smallest memories ({bits:,} bits)", (in_macros - latched) * scale / 1e6),
        ("shallow banks and words packed into rows, in place of the least area", flat * scale / 1e6),
        ("states that are read and written only where the next step depends on them", lazy * scale / 1e6),
    ]


def _pj_of_a_tick(built: runs.Built) -> float:
    """Return picojoules that a cycle costs in the clock pin of a flip-flop, with its share of the modelled tree."""
    found = built.circuit
    toggles, ungated = np.zeros((found.nets, 1)), np.ones(1)
    toggles[[found.at(flop, "CLK") for flop in found.flops]] = 1
    only = replace(found, order=[], gates={net: gate for net, gate in found.gates.items()}, memories=[])
    spent = picojoules.measure(
        only,
        built.files.cells,
        built.files.macros,
        built.times["modelled"],
        toggles,
        ungated,
        np.zeros((0, 2, 1)),
        True,
    )
    return float(spent.of("clock")[0]) / len(found.flops)


def larger(files: runs.Library, priced: pricing.Priced) -> list[tuple[str, ...]]:
    """Return rows on the best networks, each on a core that holds it, with memories of the same search.

    One of windows is mapped and played like ours. Of the other, logic and clocks are the profile's.
    """
    rows = []
    for model, dataset in BEST.items():
        program, recordings = runs.compiled(model), runs.real(dataset, "test", PLAYED.get(model, 1))
        mapped = CoreProgram(program, recordings.shape[1])
        core, needs = runs.holding(mapped), mapped.needs
        done = repeats.parts_of(runs.counted_for(program, recordings, core), mapped, core.sizes)
        chosen = runs.plan(files, runs.PRICE, core, done)
        area = sum(runs.area(files, one) for one in chosen)
        counts = sum(hw.simulate(program, recordings, probe=()).per_recording, hw.Counts())
        many = len(recordings)
        if model in PLAYED:
            built = runs.Built(files, chosen, gated=True, core=core)
            played = built.play(program, runs.stacked(program, recordings))
            assert (played.answers[:, 0] == hw.simulate(program, recordings, probe=()).prediction).all()
            energy = built.energy(played, "modelled")
            spent, logic = energy.of("memory").mean(), (energy.of("logic") + energy.of("clock")).mean()
        else:
            spent = sum(runs.cost(files, one, done[one.shape.name]) for one in chosen)
            logic = sum((priced.pj[name] - priced.memory[name]) * counts[name] for name in priced.pj) / many
        ops = counts.synaptic_ops / many
        rows.append((
            f"`{model}`", "gate level" if model in PLAYED else "estimate", f"{needs.synapses:,}", f"{needs.compartments:,}",
            f"{area / 1e6:.1f}", f"{ops:,.0f}", f"{counts.neuron_updates / many:,.0f}", f"{spent / 1e6:.1f}",
            f"{logic / 1e6:.1f}", f"{(spent + logic) / ops:.0f}",
        ))  # fmt: skip
    return rows


def ranking() -> str:
    """Return a table of strategies and weight bits, by the profile of this page and by ``davies2018``."""
    ours, theirs = hw.chip("locsnn-130nm").profile("ihp-sg13g2"), hw.chip("loihi-sim").profile("davies2018")
    network = load(runs.ROOT / "examples/models/objects-hybrid.pt")
    recordings = np.load(runs.ROOT / "examples/recordings/touches.npz")["spikes"].transpose(0, 2, 1)
    rows, by_profile = [], []
    for bits in (4, 8):
        for strategy in ("reset", "delay-line", "dendrite", "paired-dendrite"):
            program = lower(network, hw.chip("loihi-sim"), bits, strategy).program
            counts = hw.simulate(program, recordings, probe=()).counts
            uj = [sum(hw.energy_pj(counts, one).values()) / len(recordings) / 1e6 for one in (theirs, ours)]
            by_profile.append(uj)
            many = (counts.synaptic_ops, counts.neuron_updates)
            rows.append(
                (f"{strategy}, {bits}-bit", *(f"{x:.1f}" for x in uj), *(f"{n / len(recordings):,.0f}" for n in many))
            )
    same = (np.argsort([a for a, _ in by_profile]) == np.argsort([b for _, b in by_profile])).all()
    costs = []
    for one in (ours, theirs):
        pj = one.energy_pj
        rest, active = (
            pj.get("neuron_updates", 0.0) + pj.get(f"neuron_updates_{name}", 0.0) for name in ("inactive", "active")
        )
        op = pj["synaptic_ops"]
        costs.append((active / op, rest / op))
    found = table(("setting", "µJ, davies2018", "µJ, ihp-sg13g2", "synaptic operations", "updates"), rows)
    order = "is the same" if same else "is another"
    (active, rest), (davies_active, davies_rest) = costs
    return (
        f"{found}\nThe order {order}. Here an active update costs as much as {active:.1f} synaptic operations, and one at rest as "
        f"{rest:.1f};\nby `davies2018` these are {davies_active:.1f} and {davies_rest:.1f}.\n"
    )


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a table, numbers to the right."""
    line = "| --- |" + " ---: |" * (len(head) - 1)
    return "\n".join(("| " + " | ".join(head) + " |", line, *("| " + " | ".join(row) + " |" for row in rows))) + "\n"


def verdict(value: float, goal: float, at_least: bool = False) -> str:
    """Return whether a goal is reached."""
    return "reached" if (value >= goal if at_least else value <= goal) else "missed"


def page(
    built: runs.Built, of_sets: dict, rows: list[Plan], unit: dict[str, float], more: list[tuple[str, ...]]
) -> str:
    """Return the page."""
    _, played, ends = of_sets["Objects"]
    low, high, flat = (ends[wires] for wires in ENDS)
    ops = played.answers[:, 2].mean()
    totals = []
    for name, (model_name, its, energies) in of_sets.items():
        a, b, c = (energies[wires].total.mean() for wires in ENDS)
        per = its.answers[:, 2].mean()
        totals.append((
            f"`{model_name}`, {name}", f"{a / 1e6:.1f}", f"**{b / 1e6:.1f}**", f"{c / 1e6:.1f}",
            f"{a / per:.0f} to **{b / per:.0f}**", f"{per:,.0f}", f"{its.answers[:, 1].mean():,.0f}",
        ))  # fmt: skip
    kinds = []
    for kind, text in (("memory", "macros"), ("logic", "logic"), ("clock", "clock")):
        most = getattr(high, kind)
        for part, pj in sorted(most.items(), key=lambda p: -p[1].mean()):
            if pj.mean() > 1e5:
                kinds.append(
                    (
                        f"{text}: {part.replace('_same', ' (shared)').replace('_own', ' (own)')}",
                        getattr(low, kind)[part].mean(),
                        pj.mean(),
                    )
                )
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
    saved = sorted(savings(built, played, high), key=lambda p: -p[1])
    ours = next(row for row in rows if row.price == runs.PRICE)
    front = table(
        ("area of memories, mm2", "accesses, µJ per recording"),
        [(f"{row.area:.2f}", f"{row.energy:.1f}" + (" (this one)" if row is ours else "")) for row in rows],
    )
    gated = len([1 for f in built.circuit.flops if built.circuit.at(f, "CLK") in built.circuit.gates])
    area = (built.cell_area + built.macro_area) / 1e6
    most_uj, per_op = high.total.mean() / 1e6, high.total.mean() / ops
    mhz = {wires: 1000 / built.times[wires].worst for wires in ENDS}
    latches = [i for i in built.circuit.order if built.files.cells[i.type].kind == "latch"]
    arrays = sum(runs.area(built.files, one) for one in built.chosen if isinstance(one, Latches)) / 1e6
    spiking, cnn, gru = most_uj, MACS["CNN-3D"] * most / 1e6, MACS["GRU-MLP"] * most / 1e6
    sides = [f"{n} takes {'less' if uj < spiking else 'more'} energy" for n, uj in (("CNN-3D", cnn), ("GRU-MLP", gru))]
    if min(cnn, gru) > spiking:
        sides = ["CNN-3D and GRU-MLP take more energy"]
    return TEXT.format(
        totals=table(("network, 20 test recordings", "µJ per recording, no wires", "blocks", "flat", "pJ per synaptic operation", "synaptic operations", "cycles"), totals),
        parts=parts, macs=macs, saved=table(("measure", "µJ per recording"), [(what, f"{uj:.1f}") for what, uj in saved]), front=front,
        area=area, macro_area=built.macro_area / 1e6, cell_area=built.cell_area / 1e6, arrays=arrays, latches=len(latches),
        flops=len(built.circuit.flops), gated=gated, gates=len(built.circuit.gates), cells=len(built.netlist.instances) - len(built.circuit.memories),
        macros=len(built.circuit.memories), mhz=mhz, wires=built.wires.name, leak_cells=cells / 1e3, leak_macros=macros / 1e3,
        line=built.wires.line, off=max(off), next_off=sorted(off)[-2], mean_off=sum(off) / len(off), most_uj=most_uj, per_op=per_op,
        uj_flat=flat.total.mean() / 1e6, op_flat=flat.total.mean() / ops, mac=f"{least:.0f} to {most:.0f}", mac_memory=of_mac,
        glitches=unit["glitches"], glitch_bound=high.of("logic").mean() / 1e6 * (unit["glitches"] - 1), ranking=ranking(),
        mac_area=unit["area"], sides=" and ".join(sides), larger=table(
            ("network", "by", "synapses", "compartments", "memories, mm2", "synaptic operations", "updates", "accesses, µJ", "logic and clocks, µJ", "pJ per synaptic operation"), more),
        verdicts={"op": verdict(per_op, 60), "uj": verdict(most_uj, 16), "area": verdict(area, 3), "mhz": verdict(mhz["modelled"], 100, True),
                  "off": verdict(max(off), 0.05)},
        synapses=high.memory["synapses"].mean() / ops, states=high.memory["states"].mean() / ops,
        charges=(high.logic["accumulator"].mean() + high.clock["accumulator"].mean()) / ops,
        trained=make_profile.MADE_FROM + make_profile.QUIET, quiet=make_profile.QUIET,
        constants=sum(pj.mean() for name, pj in high.memory.items() if name.startswith(("leaks", "fires"))) / ops,
        clocks=high.of("clock").mean() / ops, both=(high.of("memory") + high.of("clock")).mean() / ops, least_area=min(row.area for row in rows),
    )  # fmt: skip


TEXT = """\
# Energy in 130 nm

The open core of [hardware](hardware.md), mapped to the standard cells and memory macros of IHP SG13G2, an open 130 nm process
(1.2 V, 25 C, typical). The process publishes what an access and a transition cost; this page adds them up. There is no layout
and no chip: figures are of synthesis (yosys) and of gate-level simulation. `make profile` and `make energy` make all of it from
the liberty files, which are not part of this project.

    locsnn-compile examples/models/objects-hybrid-loihi.pt --target locsnn-130nm

## What a recording costs

All dynamic energy, from cleaning the memories to the class, with a host that is always ready. The lower end has no wires. The
upper end ("blocks") has a clock tree with a buffer for every sixteen pins, and wires as for a core whose modules are placed as
blocks: a net has the wire load that the library selects for the area of the module that it lies in, or for all logic where it
connects modules. "Flat" gives every net of the logic the load for all of it (`{wires}`, line {line} of the file), the
library's own mode, which older figures of this page had.

{totals}
| | goal | blocks | flat |
| --- | ---: | ---: | ---: |
| pJ per synaptic operation | 60 | {per_op:.0f}: {verdicts[op]} | {op_flat:.0f} |
| µJ per recording | 16 | {most_uj:.0f}: {verdicts[uj]} | {uj_flat:.0f} |
| clock, MHz ({mhz[none]:.0f} without wires) | 100 | {mhz[modelled]:.0f}: {verdicts[mhz]} | {mhz[flat]:.0f} |
| area without pads, mm2 | 3 | {area:.2f}: {verdicts[area]} | |
| profile against gate level, 40 recordings that it has not seen | 5 % | {off:.1%} at most, {mean_off:.1%} on average: {verdicts[off]} | |

{cells:,} cells take {cell_area:.2f} mm2, {arrays:.2f} of it arrays of {latches:,} latches, and {macros} macros {macro_area:.2f} mm2; {flops:,} flip-flops,
{gated:,} of them behind some of {gates:,} clock gates, of which most open a row of latches. The clock is a graph-based static analysis over the
liberty tables: ideal clock, worse of both edges, no false paths. Leakage is apart: {leak_cells:.1f} µW of cells and {leak_macros:.1f} µW of
macros, by `cell_leakage_power` of the files. In the gate-level simulation every class, count, current, voltage and spike of the
40 recordings equals the simulator's.

## Where it goes

Objects, parts above 0.1 µJ. Latches are logic and clocks of their part: those of charges are the accumulator's.

{parts}
**What limits it.** Synapses cost {synapses:.0f} pJ per operation, 40 bits for two of them: the process has no macro that reads a bit for
less than 0.6 pJ. Adding to a charge costs {charges:.0f} pJ, in latches. States cost {states:.0f} pJ per operation, 54 bits that are read and
written where the next step depends on them, and the constants of compartments {constants:.0f} pJ. Macros and
clocks together take {both:.0f} pJ, {clocks:.0f} of it clocks; logic takes the rest. To come much lower, a core would have to add up the
synapses of a compartment in a register before they reach a memory. The memories with the least area would take {least_area:.2f} mm2: 3 mm2 are out of reach with the synapses of
these networks, 14,274 of 20 bits.

## The largest savings

Against the same core without the measure, computed from counted cycles and accesses:

{saved}
Memories are chosen by a search over macros, banks, words per row and arrays of latches, for the accesses of training recordings
of Objects at a price of area ([all plans](energy-130nm-memories.csv)). Cycles are the same for all plans. Besides, even and odd
compartments lie in banks of one port, so that one is read while another is written; constants that compartments share are not
read again; lists of an even number of words come first, so that they begin with a row; and bits that are 0 in every program that
fits are not made. `--emit rtl` writes such a plan for the program (`memories.csv`), from the macros of the chip file, with accesses
estimated from counts; a plan that leaves out a bit or holds one twice is refused.

{front}
![Accesses against area](images/energy-130nm-memories.svg)

## The profile

Profile `ihp-sg13g2` of `hw_model/chips/locsnn-130nm.yaml` prices counts of the simulator, so that any program that fits is
reported on without the library. Accesses are priced by the macros' files; logic, latches and clocks by what {trained} training
recordings of each set take at gate level, {quiet} of them those with the fewest events. An operation, an update and an active one have
the prices with the least relative errors. On 20 test recordings of each set the profile is {off:.1%} off at most, and {next_off:.1%} on the next
([all](energy-130nm-check.csv)). A script that knows neither RTL nor library
(`tests/energy/sums.py`) adds up the accesses of macros from the simulator's spikes and currents, and is within 2 %.

## The ranking of settings

`objects-hybrid` on `touches.npz`, the same counts by both profiles; what has delays, or charges of more than 16 bits, needs a
larger core than this one.

{ranking}Narrower weights save nothing in a word of fixed width, only where weights become 0 and are pruned.

## Larger networks

The best networks do not fit this core. On one that holds them, with memories of the same search and charges in macros, per
recording:

{larger}
`containers-best` is a network of windows (`window-snn`). Its core was mapped to cells and macros like the one above, and played
20 test recordings at gate level, with modelled wires; every class is the simulator's. Each of its compartments is updated three
times, and hardly any is active. `objects-best` is an estimate: nothing of that size was mapped, logic and
clocks are the profile's, with the latches of this core in their price, and its dense charges, 16 slots for each compartment, take
most of the area.

## Conventional networks in the same cells

A multiply-accumulate unit of 8 bits (`tests/energy/mac.sv`, {mac_area:,.0f} µm2) takes {mac} pJ for each product, {mac_memory:.0f} pJ of it for
weights and activations from 64-bit rows of 256-word macros, eight to a row. Weights are normal and half of the activations
are 0.

{macs}
{sides} than the spiking network, which has a sixth and a tenth of their operations. A synaptic
operation adds to one of many charges in memory; a product is added to a sum in a register. Not comparable: the unit has no control, no
schedule and no memory for what it computes. Reuse of a row would lower its energy, moving of partial results would raise it.

SYNtzulA (2025), in the same process, publishes 36.5 pJ per synaptic operation at 125 MHz and 6.8 mm2 with pads. Its figure is of
other networks, with another neuron, and is not broken down like this; this core takes {per_op:.0f}.

## What is left out

| what | bound |
| --- | --- |
| transitions before gates settle (glitches) | with a unit of delay per gate the multiply-accumulate unit has {glitches:.1f} times the transitions; if all logic had, {glitch_bound:.1f} µJ |
| wires and clock tree | the range; a layout may exceed it |
| waiting for a sensor in real time | only leakage, if the clock of the core stops |
| cleaning of macros | in the figures above, not in the profile: less than 1 % |
| pads, host, loading of weights | not known |
"""

if __name__ == "__main__":
    main()
