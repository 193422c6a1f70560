"""Time and memory against size, from a graph to a recording played: ``scale.py SIZE...`` compartments, 250 synapses each.

    python tests/benchmarks/scale.py 10000 100000 --write

The networks are those of ``relay_networks.py``, on as many chips as they take. Each size runs in a process of its own, in the
order given. ``--write`` puts its row into ``docs/research/scale.csv``, in the place of an earlier one, and all rows into a section of
``docs/research/benchmarks/placing.md``. Seconds are processor seconds of all threads, which other work on the machine changes little;
``total_wall_s`` is time on the clock. The memory of a part is the most that its process had held when the part ended.
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
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from machine import machine
from page_section import put_section
from peak_memory import peak_mib
from relay_networks import LAYERS, check_relayed, local_graph, random_input

import hw_model as hw
from hw_model.description.chip import parse_chip
from hw_model.engine.lay_out import fast_layout
from hw_model.mapping.arrangement import arrange_cores
from hw_model.mapping.placement import place_cores
from hw_model.mapping.routing import route_axons
from hw_model.program.assemble import assemble

PAGE = Path(__file__).parents[2] / "docs/research/benchmarks/placing.md"
TABLE = PAGE.parents[1] / "scale.csv"
SECTION = "scale"
PARTS = ("build", "place", "arrange", "route", "assemble", "save", "load", "lay out", "play")
PAGE_TEXT = """## From a graph to a recording, against size

Made by `python tests/benchmarks/scale.py SIZE... --write`, all figures in [scale.csv](../scale.csv): the networks of *cost against
size*, 250 synapses per compartment, on as many chips as they take. A network is built, placed, arranged, routed and assembled, saved,
loaded, laid out for the engine, and plays a recording of 100 steps whose spikes are checked. Measured on
{processor}, under a load of {load} by other work: seconds are processor
seconds, of all threads.

{table}

What grows faster than the synapses, and why:

- *Sorting*: a projection is sorted by target and, for the engine, by source, in n log n.
- *Arranging* takes time with the cube of the slots. Boards of more than 1,024 slots keep network order instead.
- *Counts of every step and core* (`probe=("activity",)`, which latency needs) keep synapses by source and piece, with the square
  of the size. Predictions, spikes and totals do not.

A synapse takes 12 bytes in a graph and in a program, 4 to 8 in the engine's lists, and 32 in a file before it is packed. Memory is
highest where several of these are there at once, at {each:.0f} bytes per synapse between the first row and the last.{million}
"""
STEPS = 100
ACTIVITY = 0.02
CHIPS = 8
"""Chips for each 100,000 compartments, rounded up."""


class Clock:
    """Runs parts of the work; keeps the processor seconds of each, and the peak of memory in MiB when it ended."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.mib: dict[str, float] = {}

    def __call__(self, part: str, run: Callable[[], Any]) -> Any:
        start = time.process_time()
        result = run()
        self.seconds[part], self.mib[part] = time.process_time() - start, peak_mib()
        print(
            f"{part}: {self.seconds[part]:.1f} s, {self.mib[part]:.0f} MiB",
            file=sys.stderr,
            flush=True,
        )
        return result


def built(size: int, clock: Clock) -> hw.ChipProgram:
    """Build a network and turn it into a program. Graph and placement are local, so their memory is free again after this."""
    text = hw.chip("loihi-sim").document
    chip = parse_chip(
        text.replace("chips: 1 ", f"chips: {CHIPS * -(-size // 100_000)} "), where="board"
    )
    graph = clock("build", lambda: local_graph(size, chip))
    placed = clock("place", lambda: place_cores(graph, chip))
    placed = clock("arrange", lambda: arrange_cores(placed))
    routed = clock("route", lambda: route_axons(placed))
    return clock("assemble", lambda: assemble(routed))


def measure(size: int) -> dict[str, Any]:
    """Measure one size in this process; the spikes that are played are checked."""
    few = assemble(
        route_axons(place_cores(local_graph(100, hw.chip("loihi-sim")), hw.chip("loihi-sim")))
    )
    hw.simulate(few, random_input((1, STEPS, 10), ACTIVITY))  # loads compiled code
    clock, start = Clock(), time.perf_counter()
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
        "total_wall_s": round(time.perf_counter() - start, 1),
        **{f"{part}_peak_mib": round(clock.mib[part]) for part in PARTS},
        "file_mib": round(saved, 1),
    }


def section(rows: Sequence[dict[str, Any]]) -> str:
    """Return the section of the page."""
    head = (
        "compartments",
        "synapses",
        "cores",
        *PARTS,
        "all, s",
        "went by, s",
        "peak GiB",
        "file MiB",
    )
    lines = ["| " + " | ".join(head) + " |", "| ---: " * len(head) + "|"]
    for row in rows:
        sizes = [f"{int(row[name]):,}" for name in ("compartments", "synapses", "cores")]
        parts = [f"{float(row[f'{part}_s']):.1f}" for part in PARTS]
        most = max(float(row[f"{part}_peak_mib"]) for part in PARTS) / 1024
        cells = [
            *sizes,
            *parts,
            row["total_s"],
            row["total_wall_s"],
            f"{most:.1f}",
            row["file_mib"],
        ]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    mib = [max(float(row[f"{part}_peak_mib"]) for part in PARTS) for row in rows]
    synapses = [int(row["synapses"]) for row in rows]
    bytes_per_synapse = (mib[-1] - mib[0]) * 2**20 / max(1, synapses[-1] - synapses[0])
    million_gib = mib[-1] / 1024 + (250_000_000 - synapses[-1]) * bytes_per_synapse / 2**30
    unmeasured = f" By that\nfigure a million compartments take {million_gib:.0f} GiB; they have not been run."
    load = " to ".join(
        dict.fromkeys(
            f"{pick(float(row['load_before']) for row in rows):.0f}" for pick in (min, max)
        )
    )
    figures = {
        "each": bytes_per_synapse,
        "million": unmeasured if synapses[-1] < 250_000_000 else "",
    }
    return PAGE_TEXT.format(
        processor=rows[-1]["processor"], load=load, table="\n".join(lines), **figures
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sizes", type=int, nargs="+", metavar="SIZE", help="compartments")
    parser.add_argument(
        "--write",
        action="store_true",
        help="write the table and the page; rows of other sizes stay",
    )
    parser.add_argument("--child", action="store_true", help="measure one size here and print JSON")
    args = parser.parse_args()
    if args.child:
        print(json.dumps(measure(args.sizes[0])))
        return
    rows = {}
    if TABLE.exists():
        rows = {int(row["compartments"]): row for row in csv.DictReader(TABLE.open())}
    for size in args.sizes:
        command = [sys.executable, __file__, str(size), "--child"]
        load = os.getloadavg()[0]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        rows[size] = json.loads(done.stdout) | {
            "load_before": round(load, 1),
            "processor": machine()["processor"],
        }
        print(rows[size])
        if args.write:
            with TABLE.open("w", newline="") as stream:
                writer = csv.DictWriter(stream, list(rows[size]), lineterminator="\n")
                writer.writeheader()
                writer.writerows(rows[key] for key in sorted(rows))
            put_section(PAGE, SECTION, section([rows[key] for key in sorted(rows)]))


if __name__ == "__main__":
    main()
