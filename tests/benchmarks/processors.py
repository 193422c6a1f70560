"""The engine against the limit of the machine, a row for each processor: ``processors.py --page docs/research/benchmarks.md``.

A batch of each network and the kernel of :mod:`limits` that also moves state run in turn, in processes that may use one core
or two. Rows of other processors stay in the table, because each machine can only add its own.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

from limits import TrafficLimit
from machine import cache_kib, processor
from page_section import put_section, section_of
from workloads import large, small

import hw_model as hw
from hw_model.engine.lanes import can

SECTION = "processors"
CORES = (1, 2)
HEAD = """## By processor

`python tests/benchmarks/processors.py --page docs/research/benchmarks.md` on each: microseconds of a recording in a batch, and the share of what the
machine can do at most with the state read and written (goal 50 %); the engine and the kernel in turn, medians of {turns}.

| processor | small, 1 core | small, 2 cores | large, 1 core | large, 2 cores |
| --- | ---: | ---: | ---: | ---: |
"""


def measure(turns: int) -> None:
    """Print microseconds of a recording and the share of the limit, for each network."""
    for workload in (small, large):
        network = workload().networks[0]
        program, batch = network.program(), len(network.recordings)
        limit = TrafficLimit(
            network, list(hw.simulate(program, network.recordings).spikes.values())
        )
        limit.rows_and_state()
        engine_seconds, limit_seconds = [], []
        for _ in range(turns):
            start = time.perf_counter()
            hw.simulate(program, network.recordings)
            engine_seconds.append((time.perf_counter() - start) / batch)
            limit_seconds.append(limit.rows_and_state())
        print(
            1e6 * statistics.median(engine_seconds),
            100 * statistics.median(limit_seconds) / statistics.median(engine_seconds),
        )


def measured_on(cores: int, turns: int) -> list[str]:
    """Return the cells of the table that a process measures which may use so many cores."""
    allowed_cores = sorted(os.sched_getaffinity(0))[:cores]
    process = subprocess.run(
        [sys.executable, __file__, "--measure", "--turns", str(turns)], capture_output=True, text=True, check=True,
        preexec_fn=lambda: os.sched_setaffinity(0, allowed_cores),
    )  # fmt: skip
    return [
        "{:,.0f} µs, {:.0f} %".format(*map(float, line.split()))
        for line in process.stdout.splitlines()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--page", type=Path, help="write the row into the table of this page")
    parser.add_argument("--turns", type=int, default=25)
    parser.add_argument(
        "--measure", action="store_true", help="measure in this process, and print figures alone"
    )
    args = parser.parse_args()
    if args.measure:
        measure(args.turns)
        return
    name = f"{processor()}, L1 {cache_kib().get('L1', 0)} KiB, {'with' if can('avx512vbmi2') else 'without'} AVX-512"
    (small_1, large_1), (small_2, large_2) = (measured_on(cores, args.turns) for cores in CORES)
    row = f"| {name} | {small_1} | {small_2} | {large_1} | {large_2} |"
    print(row)
    if args.page is not None:
        old_section = section_of(args.page.read_text(encoding="utf-8"), SECTION) or ""
        rows_of_others = [
            line
            for line in old_section.splitlines()
            if "µs" in line and not line.startswith(f"| {name} |")
        ]
        put_section(
            args.page,
            SECTION,
            HEAD.format(turns=args.turns) + "\n".join(sorted([*rows_of_others, row])),
        )


if __name__ == "__main__":
    main()
