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
"""Picojoules per recording that the search takes a square micrometre to be worth; each price gives a plan of memories."""
ENDS = ("none", "modelled", "flat")
"""Models of wires: none, those of modules that are placed as blocks, and those of a flat layout."""
STRETCH = 30.0
"""Picojoules per synaptic operation of a stretch goal; the page says what it would take."""
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
    """What the search finds at a price of area: square millimetres, microjoules per recording for accesses, and the memories."""

    price: float
    area: float
    energy: float
    chosen: list[memories.Choice | Latches]


def search(files: runs.Library) -> list[Plan]:
    """Return a plan for every price of area; prices that give the same plan give one row."""
    traffic, plan_of_cost = runs.traffic_of(), {}
    for price in PRICES:
        chosen = plans.plan(
            files, price, most=plans.MOST_AREA if price == plans.PRICE else float("inf")
        )
        area = sum(plans.area(files, c) for c in chosen) / 1e6
        energy = sum(plans.cost(files, c, traffic[c.shape.name]) for c in chosen) / 1e6
        plan_of_cost.setdefault((area, energy), Plan(price, area, energy, chosen))
    return list(plan_of_cost.values())


def picture(rows: list[Plan]) -> bytes:
    """Return the picture of area against energy of all plans, as the bytes of an SVG file."""
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

    ``per``: operations for each update. In picojoules: ``rest``, an operation with its share of lists; ``update``, an update;
    and ``left``, what an update could cost at most. ``many``: operations for each update at which today's update would be
    cheap enough.
    """
    program, recordings = (
        runs.compiled(make_profile.SETS["Objects"]),
        runs.real("Objects", "test", count=20),
    )
    counts, updating = (
        hw.simulate(program, recordings, probe=()).counts,
        (*pricing.UPDATES, *pricing.ACTIVE),
    )
    ops, updates = counts.synaptic_ops, counts.neuron_updates
    rest = sum(pj * counts[name] for name, pj in priced.pj.items() if name not in updating) / ops
    update = sum(priced.pj[name] * counts[name] for name in updating) / updates
    left_pj = STRETCH - rest
    return {
        "per": ops / updates,
        "rest": rest,
        "update": update,
        "left": left_pj * ops / updates,
        "many": update / left_pj,
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
    for name, (model_name, activity, energies) in of_sets.items():
        pj_no_wires, pj_blocks, pj_flat = (energies[wires].total.mean() for wires in ENDS)
        ops_of_recording = activity.answers[:, 2].mean()
        totals.append((
            f"`{model_name}`, {name}", f"{pj_no_wires / 1e6:.1f}", f"**{pj_blocks / 1e6:.1f}**", f"{pj_flat / 1e6:.1f}",
            f"{pj_no_wires / ops_of_recording:.0f} to **{pj_blocks / ops_of_recording:.0f}**", f"{ops_of_recording:,.0f}", f"{activity.answers[:, 1].mean():,.0f}",
        ))  # fmt: skip
    part_rows = []
    for kind, text in (("memory", "macros"), ("logic", "logic"), ("clock", "clock")):
        most = getattr(high, kind)
        for part, pj in sorted(most.items(), key=lambda p: -p[1].mean()):
            if pj.mean() > 1e5:
                part_rows.append(
                    (
                        f"{text}: {part.replace('_same', ' (shared)').replace('_own', ' (own)')}",
                        getattr(low, kind)[part].mean(),
                        pj.mean(),
                    )
                )
    parts = table(
        ("part", "µJ, least", "µJ, most", "pJ per synaptic operation, most"),
        [
            (n, f"{pj_no_wires / 1e6:.2f}", f"{pj_blocks / 1e6:.2f}", f"{pj_blocks / ops:.1f}")
            for n, pj_no_wires, pj_blocks in part_rows
        ],
    )
    mac_memory_pj = unit["weights"] + unit["activations"]
    least, most = (
        mac_memory_pj + unit[f"{end} logic"] + unit[f"{end} clock"] for end in ("least", "most")
    )
    macs = table(("per recording of Objects", "operations", "µJ, least", "µJ, most"), [
        ("`objects-hybrid-loihi`, synaptic operations", f"{ops:,.0f}", f"{low.total.mean() / 1e6:.1f}", f"{high.total.mean() / 1e6:.1f}"),
        *((f"{n}, multiply-accumulates of 8 bits", f"{m:,}", f"{m * least / 1e6:.1f}", f"{m * most / 1e6:.1f}") for n, m in MACS.items()),
    ])  # fmt: skip
    cells, macros = built.leakage_nw
    with make_profile.CHECK.open() as file:
        errors = [abs(float(row["difference"])) for row in csv.DictReader(file)]
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
    clock_mhz = {wires: 1000 / built.times[wires].worst for wires in ENDS}
    latches = [i for i in built.circuit.order if built.files.cells[i.type].kind == "latch"]
    arrays = (
        sum(plans.area(built.files, one) for one in built.chosen if isinstance(one, Latches)) / 1e6
    )
    spiking, cnn, gru = most_uj, MACS["CNN-3D"] * most / 1e6, MACS["GRU-MLP"] * most / 1e6
    comparisons = [
        f"{n} takes {'less' if uj < spiking else 'more'} energy"
        for n, uj in (("CNN-3D", cnn), ("GRU-MLP", gru))
    ]
    if min(cnn, gru) > spiking:
        comparisons = ["CNN-3D and GRU-MLP take more energy"]
    return wrapped(TEMPLATE.read_text("utf-8").format(
        needs=needs, read=states.read_pj, totals=table(("network, 20 test recordings", "µJ per recording, no wires", "blocks", "flat", "pJ per synaptic operation", "synaptic operations", "cycles"), totals),
        parts=parts, macs=macs, saved=table(("measure", "µJ per recording"), [(what, f"{uj:.1f}") for what, uj in saved]), front=front,
        area=area, macro_area=built.macro_area / 1e6, cell_area=built.cell_area / 1e6, arrays=arrays, latches=len(latches),
        flops=len(built.circuit.flops), gated=gated, gates=len(built.circuit.gates), cells=len(built.netlist.instances) - len(built.circuit.memories),
        macros=len(built.circuit.memories), mhz=clock_mhz, wires=built.wires.name, leak_cells=cells / 1e3, leak_macros=macros / 1e3,
        line=built.wires.line, off=max(errors), next_off=sorted(errors)[-2], mean_off=sum(errors) / len(errors), most_uj=most_uj, per_op=per_op,
        uj_flat=flat.total.mean() / 1e6, op_flat=flat.total.mean() / ops, mac=f"{least:.0f} to {most:.0f}", mac_memory=mac_memory_pj,
        glitches=unit["glitches"], glitch_bound=high.of("logic").mean() / 1e6 * (unit["glitches"] - 1), ranking=ranking(),
        mac_area=unit["area"], sides=" and ".join(comparisons), larger=table(
            ("network", "recordings", "synapses", "compartments", "memories, mm2", "synaptic operations", "updates", "accesses, µJ", "logic and clocks, µJ", "pJ per synaptic operation"), more),
        verdicts={"op": verdict(per_op, 60), "uj": verdict(most_uj, 16), "area": verdict(area, 3), "mhz": verdict(clock_mhz["modelled"], goal=100, at_least=True),
                  "off": verdict(max(errors), 0.05)},
        synapses=high.memory["synapses"].mean() / ops, states=high.memory["states"].mean() / ops,
        charges=(high.logic["accumulator"].mean() + high.clock["accumulator"].mean()) / ops,
        trained=make_profile.MADE_FROM + make_profile.QUIET, quiet=make_profile.QUIET,
        constants=sum(pj.mean() for name, pj in high.memory.items() if name.startswith(("leaks", "fires"))) / ops,
        clocks=high.of("clock").mean() / ops, both=(high.of("memory") + high.of("clock")).mean() / ops, compartments=runs.COMPARTMENTS,
        places=next(len(one.shape.held) for one in built.chosen if one.shape.name == "states"), fillers=fillers(), packing=packing(built.files), states_more=(plans.area(built.files, Latches(states.shape, 8)) - plans.area(built.files, states)) / 1e6, least_area=min(row.area for row in rows),
    ))  # fmt: skip


if __name__ == "__main__":
    main()
