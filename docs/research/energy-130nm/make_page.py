"""Write docs/research/energy-130nm.md: what a recording costs on the open core in 130 nm cells, and what would cost less.

make energy           # after `make profile`, whose simulations it uses
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import mac
import make_profile
import memories
import plans
import pricing
import runs
from latches import Latches
from others import larger, ranking
from packing import packing
from page_text import table, wrapped
from savings import fillers, savings

import hw_model as hw
from locsnn_compile.report.pictures.chart import Curve, Panel, draw

TEMPLATE = Path(__file__).parent / "page.txt"
PAGE = runs.ROOT / "docs/research/energy-130nm.md"
FRONT = runs.ROOT / "docs/research/images/energy-130nm-memories.svg"
SEARCH = runs.ROOT / "docs/research/energy-130nm/memories.csv"
PRICES = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 20.0, 50.0)
ENDS = ("none", "modelled", "flat")
"""No wires, those of modules that are placed as blocks, and those of a flat layout."""
STRETCH = 30.0
"""Picojoules per synaptic operation that would be good."""
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
        writer.writerow(
            (
                "price of area, pJ per µm2",
                "area of memories, mm2",
                "accesses, µJ per recording",
                *names,
            )
        )
        writer.writerows(
            (row.price, f"{row.area:.3f}", f"{row.energy:.2f}", *(c.text for c in row.chosen))
            for row in rows
        )
    FRONT.write_bytes(picture(rows))
    priced = pricing.price(make_profile.made(built), "modelled")
    unit, more = mac.measure(built.files), larger(built.files)
    PAGE.write_text(page(built, of_sets, rows, unit, more, stretch(priced)))


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
        chosen = plans.plan(
            files, price, most=plans.MOST_AREA if price == plans.PRICE else float("inf")
        )
        area = sum(plans.area(files, c) for c in chosen) / 1e6
        energy = sum(plans.cost(files, c, traffic[c.shape.name]) for c in chosen) / 1e6
        found.setdefault((area, energy), Plan(price, area, energy, chosen))
    return list(found.values())


def picture(rows: list[Plan]) -> bytes:
    """Return the front as a file."""
    taken = next(row for row in rows if row.price == plans.PRICE)
    curves = (
        Curve(
            "plans of the search",
            tuple((row.area, row.energy) for row in sorted(rows, key=lambda row: row.area)),
        ),
        Curve("the one that is measured", ((taken.area, taken.energy),)),
    )
    panel = Panel(
        "accesses, µJ per recording", "area of memories, mm2", curves, x_log=False, y_log=False
    )
    return draw("Memories of the core", [panel])


def verdict(value: float, goal: float, at_least: bool = False) -> str:
    """Return whether a goal is reached."""
    return "reached" if (value >= goal if at_least else value <= goal) else "missed"


def stretch(priced: pricing.Priced) -> dict[str, float]:
    """Return what 30 pJ per synaptic operation would need on test recordings of Objects, by the prices of counts.

    ``per``: operations for each update. In picojoules: ``rest``, an operation with its share of lists; ``update``; and
    ``left``, what an update might cost. ``many``: operations for each update with which it would do.
    """
    program, recordings = (
        runs.compiled(make_profile.SETS["Objects"]),
        runs.real("Objects", "test", 20),
    )
    counts, updating = (
        hw.simulate(program, recordings, probe=()).counts,
        (*pricing.UPDATES, *pricing.ACTIVE),
    )
    ops, updates = counts.synaptic_ops, counts.neuron_updates
    rest = sum(pj * counts[name] for name, pj in priced.pj.items() if name not in updating) / ops
    update = sum(priced.pj[name] * counts[name] for name in updating) / updates
    over = STRETCH - rest
    return {
        "per": ops / updates,
        "rest": rest,
        "update": update,
        "left": over * ops / updates,
        "many": update / over,
    }


def page(
    built: runs.Built,
    of_sets: dict,
    rows: list[Plan],
    unit: dict[str, float],
    more: list[tuple[str, ...]],
    needs: dict[str, float],
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
    least, most = (
        of_mac + unit[f"{end} logic"] + unit[f"{end} clock"] for end in ("least", "most")
    )
    macs = table(("per recording of Objects", "operations", "µJ, least", "µJ, most"), [
        ("`objects-hybrid-loihi`, synaptic operations", f"{ops:,.0f}", f"{low.total.mean() / 1e6:.1f}", f"{high.total.mean() / 1e6:.1f}"),
        *((f"{n}, multiply-accumulates of 8 bits", f"{m:,}", f"{m * least / 1e6:.1f}", f"{m * most / 1e6:.1f}") for n, m in MACS.items()),
    ])  # fmt: skip
    cells, macros = built.leakage_nw
    with make_profile.CHECK.open() as file:
        off = [abs(float(row["difference"])) for row in csv.DictReader(file)]
    saved = sorted(savings(built, played, high), key=lambda p: -p[1])
    ours = next(row for row in rows if row.price == plans.PRICE)
    front = table(
        ("area of memories, mm2", "accesses, µJ per recording"),
        [
            (f"{row.area:.2f}", f"{row.energy:.1f}" + (" (this one)" if row is ours else ""))
            for row in rows
        ],
    )
    states = next(one for one in built.chosen if one.shape.name == "states")
    gated = len(
        [1 for f in built.circuit.flops if built.circuit.at(f, "CLK") in built.circuit.gates]
    )
    area = (built.cell_area + built.macro_area) / 1e6
    most_uj, per_op = high.total.mean() / 1e6, high.total.mean() / ops
    mhz = {wires: 1000 / built.times[wires].worst for wires in ENDS}
    latches = [i for i in built.circuit.order if built.files.cells[i.type].kind == "latch"]
    arrays = (
        sum(plans.area(built.files, one) for one in built.chosen if isinstance(one, Latches)) / 1e6
    )
    spiking, cnn, gru = most_uj, MACS["CNN-3D"] * most / 1e6, MACS["GRU-MLP"] * most / 1e6
    sides = [
        f"{n} takes {'less' if uj < spiking else 'more'} energy"
        for n, uj in (("CNN-3D", cnn), ("GRU-MLP", gru))
    ]
    if min(cnn, gru) > spiking:
        sides = ["CNN-3D and GRU-MLP take more energy"]
    return wrapped(TEMPLATE.read_text("utf-8").format(
        needs=needs, read=states.read_pj, totals=table(("network, 20 test recordings", "µJ per recording, no wires", "blocks", "flat", "pJ per synaptic operation", "synaptic operations", "cycles"), totals),
        parts=parts, macs=macs, saved=table(("measure", "µJ per recording"), [(what, f"{uj:.1f}") for what, uj in saved]), front=front,
        area=area, macro_area=built.macro_area / 1e6, cell_area=built.cell_area / 1e6, arrays=arrays, latches=len(latches),
        flops=len(built.circuit.flops), gated=gated, gates=len(built.circuit.gates), cells=len(built.netlist.instances) - len(built.circuit.memories),
        macros=len(built.circuit.memories), mhz=mhz, wires=built.wires.name, leak_cells=cells / 1e3, leak_macros=macros / 1e3,
        line=built.wires.line, off=max(off), next_off=sorted(off)[-2], mean_off=sum(off) / len(off), most_uj=most_uj, per_op=per_op,
        uj_flat=flat.total.mean() / 1e6, op_flat=flat.total.mean() / ops, mac=f"{least:.0f} to {most:.0f}", mac_memory=of_mac,
        glitches=unit["glitches"], glitch_bound=high.of("logic").mean() / 1e6 * (unit["glitches"] - 1), ranking=ranking(),
        mac_area=unit["area"], sides=" and ".join(sides), larger=table(
            ("network", "recordings", "synapses", "compartments", "memories, mm2", "synaptic operations", "updates", "accesses, µJ", "logic and clocks, µJ", "pJ per synaptic operation"), more),
        verdicts={"op": verdict(per_op, 60), "uj": verdict(most_uj, 16), "area": verdict(area, 3), "mhz": verdict(mhz["modelled"], 100, True),
                  "off": verdict(max(off), 0.05)},
        synapses=high.memory["synapses"].mean() / ops, states=high.memory["states"].mean() / ops,
        charges=(high.logic["accumulator"].mean() + high.clock["accumulator"].mean()) / ops,
        trained=make_profile.MADE_FROM + make_profile.QUIET, quiet=make_profile.QUIET,
        constants=sum(pj.mean() for name, pj in high.memory.items() if name.startswith(("leaks", "fires"))) / ops,
        clocks=high.of("clock").mean() / ops, both=(high.of("memory") + high.of("clock")).mean() / ops, compartments=runs.COMPARTMENTS,
        places=next(len(one.shape.held) for one in built.chosen if one.shape.name == "states"), fillers=fillers(), packing=packing(built.files), states_more=(plans.area(built.files, Latches(states.shape, 8)) - plans.area(built.files, states)) / 1e6, least_area=min(row.area for row in rows),
    ))  # fmt: skip


if __name__ == "__main__":
    main()
