"""Time and memory against size, from a graph to a recording played: ``scale.py SIZE...`` compartments, 250 synapses each.

    python tests/benchmarks/scale.py 10000 100000 --csv docs/scale.csv

The networks are those of ``relay_networks.py``, on as many chips as they take. Each size runs in a process of its own, in the
order given; a size that the CSV has already is measured again and replaced. The memory of a part is the most that its
process had held when it ended.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from machine import machine
from peak_memory import peak_mib
from relay_networks import LAYERS, check_relayed, local_graph, random_input

import hw_model as hw
from hw_model.description.chip import parse_chip
from hw_model.engine.layout import fast_layout
from hw_model.mapping.arrangement import arrange_cores
from hw_model.mapping.placement import place_cores
from hw_model.mapping.routing import route_axons
from hw_model.program.assemble import assemble

PARTS = ("build", "place", "arrange", "route", "assemble", "save", "load", "lay out", "play")
STEPS = 100
ACTIVITY = 0.02
CHIPS = 8
"""For each 100,000 compartments, and at least."""


class Clock:
    """Seconds of each part, and the peak of memory in MiB when it ended."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.mib: dict[str, float] = {}

    def __call__(self, part: str, run: Callable[[], Any]) -> Any:
        start = time.perf_counter()
        found = run()
        self.seconds[part], self.mib[part] = time.perf_counter() - start, peak_mib()
        print(f"{part}: {self.seconds[part]:.1f} s, {self.mib[part]:.0f} MiB", file=sys.stderr, flush=True)
        return found


def built(size: int, clock: Clock) -> hw.ChipProgram:
    """Take a network to a program; the levels between are gone when this returns."""
    text = hw.chip("loihi-sim").document
    chip = parse_chip(text.replace("chips: 1 ", f"chips: {CHIPS * -(-size // 100_000)} "), where="board")
    graph = clock("build", lambda: local_graph(size, chip))
    placed = clock("place", lambda: place_cores(graph, chip))
    placed = clock("arrange", lambda: arrange_cores(placed))
    del graph
    routed = clock("route", lambda: route_axons(placed))
    del placed
    return clock("assemble", lambda: assemble(routed))


def measure(size: int) -> dict[str, Any]:
    """Measure one size in this process; the spikes that are played are checked."""
    clock = Clock()
    with tempfile.TemporaryDirectory() as folder:
        program = built(size, clock)
        clock("save", lambda: program.save(folder))
        saved = sum(path.stat().st_size for path in Path(folder).iterdir()) / 2**20
        synapses, cores = sum(len(core.axons.target) for core in program.cores), len(program.cores)
        del program
        program = clock("load", lambda: hw.load_program(folder))
    clock("lay out", lambda: fast_layout(program, program.phases[0].name))
    recordings = random_input((1, STEPS, size // LAYERS), ACTIVITY)
    result = clock("play", lambda: hw.simulate(program, recordings))
    check_relayed(recordings, result)
    return {
        "compartments": size,
        "synapses": synapses,
        "cores": cores,
        "chips": -(-cores // program.chip.limits.cores_per_chip),
        **{f"{part}_s": round(clock.seconds[part], 2) for part in PARTS},
        "total_s": round(sum(clock.seconds.values()), 1),
        **{f"{part}_peak_mib": round(clock.mib[part]) for part in PARTS},
        "file_mib": round(saved, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sizes", type=int, nargs="+", metavar="SIZE", help="compartments")
    parser.add_argument("--csv", type=Path, help="table to write; rows of other sizes stay")
    parser.add_argument("--child", action="store_true", help="measure one size here and print JSON")
    args = parser.parse_args()
    if args.child:
        print(json.dumps(measure(args.sizes[0])))
        return
    rows = {}
    if args.csv and args.csv.exists():
        rows = {int(row["compartments"]): row for row in csv.DictReader(args.csv.open())}
    for size in args.sizes:
        command = [sys.executable, __file__, str(size), "--child"]
        load = os.getloadavg()[0]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        rows[size] = json.loads(done.stdout) | {"load_before": round(load, 1), "processor": machine()["processor"]}
        print(rows[size])
        if args.csv:
            with args.csv.open("w", newline="") as stream:
                writer = csv.DictWriter(stream, list(rows[size]), lineterminator="\n")
                writer.writeheader()
                writer.writerows(rows[key] for key in sorted(rows))


if __name__ == "__main__":
    main()
