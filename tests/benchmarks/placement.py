"""Measure placing and routing: time and memory against size, and the hops that arranging cores saves.

Run ``python tests/benchmarks/placement.py docs/benchmarks.md`` to write the page; each size in a process of its own, so
that its peak memory is its own.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import sparse

import hw_model as hw
from hw_model.arrangement import arrange_cores, core_traffic, slot_distances, total_hops
from hw_model.graph import CompartmentGraph
from hw_model.placement import place_cores
from hw_model.program import assemble
from hw_model.routing import route_axons

SIZES = (1_000, 3_000, 10_000, 30_000, 100_000)
SYNAPSES_PER_COMPARTMENT = 200
ROOT = Path(__file__).parents[2]


def board(chips: int) -> hw.Chip:
    return replace(hw.chip("loihi-sim"), chips=chips)


def layered_graph(size: int, chip: hw.Chip, *, layers: int = 10, reach: int = 400, seed: int = 0) -> CompartmentGraph:
    """Layers in a row; a compartment hears 200 of the 400 that lie nearest to it in the layer before."""
    r = np.random.default_rng(seed)
    width = size // layers
    builder = hw.ProgramBuilder(chip, name="layered")
    before = builder.add_input("x", width)
    for layer in range(layers):
        here = builder.add_compartments(f"layer{layer}", width, decay_u=1024, decay_v=128, threshold=1000)
        fan_in = min(SYNAPSES_PER_COMPARTMENT, width)
        near = min(reach, width)
        offsets = np.argsort(r.random((width, near)), axis=1)[:, :fan_in]
        sources = (np.arange(width)[:, None] + offsets - near // 2) % width
        weights = 2 * r.integers(1, 127, sources.size) * r.choice([-1, 1], sources.size)
        targets = np.repeat(np.arange(width), fan_in)
        builder.connect(before, here, sparse.coo_array((weights, (targets, sources.ravel())), shape=(width, width)))
        before = here
    return builder.graph()


def random_graph(size: int, chip: hw.Chip, *, fan_in: int, seed: int = 0) -> CompartmentGraph:
    """A sparse recurrent population: every compartment hears ``fan_in`` others, wherever they are."""
    r = np.random.default_rng(seed)
    builder = hw.ProgramBuilder(chip, name="random sparse")
    x = builder.add_input("x", size)
    n = builder.add_compartments("n", size, decay_u=1024, decay_v=128, threshold=1000)
    builder.connect(x, n, sparse.eye_array(size, dtype=np.int64) * 2)
    targets = np.repeat(np.arange(size), fan_in)
    weights = sparse.coo_array((np.full(size * fan_in, 2), (targets, r.integers(0, size, size * fan_in))), (size, size))
    weights.sum_duplicates()
    weights.data[:] = 2
    builder.connect(n, n, weights)
    return builder.graph()


def example_graph(chip: hw.Chip) -> CompartmentGraph:
    from locsnn_compile.frontends import load
    from locsnn_compile.passes.lower_neurons import lower_neurons
    from locsnn_compile.passes.quantize import quantize

    return lower_neurons(quantize(load(ROOT / "examples/models/objects-hybrid.pt"), chip), chip)


def measure_size(size: int) -> dict[str, float]:
    """Build, place, arrange, route and assemble a layered graph; seconds, cores, synapses and peak GiB."""
    chip = board(8)
    seconds = {}

    def timed(name, run):
        start = time.perf_counter()
        result = run()
        seconds[name] = time.perf_counter() - start
        return result

    graph = timed("build", lambda: layered_graph(size, chip))
    placed = timed("place", lambda: place_cores(graph, chip))
    arranged = timed("arrange", lambda: arrange_cores(placed))
    program = timed("route", lambda: assemble(route_axons(arranged)))
    return {
        "compartments": size,
        "synapses": sum(len(core.axons.target) for core in program.cores),
        "cores": len(program.cores),
        **seconds,
        "gib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }


def hops_table() -> list[str]:
    few = replace(board(1), limits=replace(board(1).limits, compartments_per_core=16))
    networks = (
        ("objects-hybrid, cores of 16 compartments", example_graph(few), few),
        ("random sparse recurrent, 8,000 compartments, 16 synapses each", random_graph(8000, board(1), fan_in=16), board(1)),
        ("layered, 20,000 compartments, 200 synapses each", layered_graph(20_000, board(1)), board(1)),
    )  # fmt: skip
    rows = [
        "| network | cores | hops a step, network order | arranged | saved | seconds to arrange |",
        "|" + " --- |" * 6,
    ]
    for name, graph, chip in networks:
        placed = place_cores(graph, chip)
        start = time.perf_counter()
        arranged = arrange_cores(placed)
        seconds = time.perf_counter() - start
        traffic, distance = core_traffic(placed), slot_distances(chip, chip.cores)
        before, after = (total_hops(traffic, distance, p.slots) for p in (placed, arranged))
        rows.append(
            f"| {name} | {placed.cores} | {before:,.0f} | {after:,.0f} | {1 - after / before:.0%} | {seconds:.2f} |"
        )
    return rows


def size_table() -> list[str]:
    rows = [
        "| compartments | synapses | cores | build s | place s | arrange s | route s | total s | s per million synapses | peak GiB |",
        "|" + " ---: |" * 10,
    ]
    for size in SIZES:
        done = subprocess.run(
            [sys.executable, __file__, "--size", str(size)], capture_output=True, text=True, check=True
        )
        m = json.loads(done.stdout)
        work = m["build"] + m["place"] + m["arrange"] + m["route"]
        rows.append(
            f"| {m['compartments']:,} | {m['synapses']:,} | {m['cores']} | {m['build']:.2f} | {m['place']:.2f} | "
            f"{m['arrange']:.2f} | {m['route']:.2f} | {work:.2f} | {work / m['synapses'] * 1e6:.2f} | {m['gib']:.2f} |"
        )
    return rows


def page() -> str:
    text = f"""# Benchmarks

Written by `python tests/benchmarks/placement.py docs/benchmarks.md`, on two cores. Seconds differ from machine to
machine; how they grow does not.

## Placing and routing against size

Ten layers in a row, {SYNAPSES_PER_COMPARTMENT} synapses a compartment from the 400 sources nearest to it, 8-bit mixed weights, a board of
eight chips. *build* makes the graph through `ProgramBuilder`, checks included; *route* assembles the program too.

{{sizes}}

Time grows with the number of synapses; arranging grows with the slots of the board instead, cubed, and is left out above
1,024 slots.

## Hops that arranging cores saves

Expected hops a step if every compartment spikes once, cores in network order against arranged.

{{hops}}
"""
    return text.replace("{sizes}", "\n".join(size_table())).replace("{hops}", "\n".join(hops_table()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", nargs="?", type=Path)
    parser.add_argument("--size", type=int)
    args = parser.parse_args()
    if args.size:
        print(json.dumps(measure_size(args.size)))
    else:
        args.page.write_text(page())


if __name__ == "__main__":
    main()
