"""Time this version of the engine against another one: ``against.py CHECKOUT [--page PAGE]``.

    git worktree add ../before COMMIT && python tests/benchmarks/against.py ../before --page docs/research/benchmarks.md

CHECKOUT is a folder with the other version. A process of each version plays the same jobs, turn by turn, on one core. A
figure is the least processor time of all calls, which is what other work on the machine disturbs least.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).parents[2]
JOBS = {
    "small, one recording": 300,
    "small, one empty recording": 300,
    "small, a batch of 32": 8,
    "objects-hybrid, one recording": 200,
    "objects-hybrid, one empty recording": 200,
    "objects-hybrid, a batch of 32": 5,
    "large, one recording": 8,
    "sparse lists, one recording": 5,
    "sparse lists with delays, one recording": 5,
    "full layers with delays, one recording": 8,
    "objects-hybrid, a session row by row": 5,
    "objects-hybrid, a session at once": 12,
    "objects-hybrid, location branch anew for each row": 1,
}
"""The jobs, and how many calls of each are timed in a turn."""
HEAD = """## Against the version before

`git worktree add ../before {commit} && python tests/benchmarks/against.py ../before --page docs/research/benchmarks.md`: a process of each
version, in turn and on one core, the least processor time of {turns} turns. Measured on {processor}, next to other work.
*Sparse lists* is 2000-2000-2000-2000, one pair in ten connected, 100 steps, 3 % input; *full layers* 500-500-500, all
connected, each pair with one of three delays.

| job | before, µs | now, µs | ratio |
| --- | ---: | ---: | ---: |
"""


def work() -> None:
    """Read names of jobs, a line each, and print the least seconds of a call for each.

    This runs in a process whose packages are those of one version. The engine must use one thread, and versions ask for the
    number of cores in different ways.
    """
    os.cpu_count = lambda: 1
    os.sched_getaffinity = lambda _: {0}
    jobs: dict[str, Callable[[], object]] = {}
    for line in sys.stdin:
        name = line.strip()
        if name not in jobs:
            jobs[name] = job(name)
            jobs[name]()
        seconds = []
        for _ in range(JOBS[name]):
            start = time.process_time()
            jobs[name]()
            seconds.append(time.process_time() - start)
        print(min(seconds), flush=True)


def job(name: str) -> Callable[[], object]:
    """Return the call of a job, prepared as far as possible. Imports are here, so that they are those of the worker's version."""
    import numpy as np
    from workloads import example_levels, large, published_test_part, small

    import hw_model as hw

    network, what = name.split(", ")
    if network in ("small", "large"):
        drawn = (small if network == "small" else large)().networks[0]
        program, recordings = drawn.program(), drawn.recordings
    elif network.startswith("sparse"):
        program, recordings = drawn_program(
            (2000,) * 4, share=0.1, delays=3 if "delays" in network else 1
        )
    elif network.startswith("full"):
        program, recordings = drawn_program((500,) * 3, share=1.0, delays=3)
    else:
        levels = example_levels("objects")
        program, recordings = levels.program, published_test_part("objects").spikes
        # The recording with the median number of events comes first; then, for batches, the 31 with the fewest.
        recordings = recordings[
            np.argsort(recordings.sum(axis=(1, 2)))[[len(recordings) // 2, *range(31)]]
        ]
        if "location branch" in what:
            from hybrid_branches import branch_program, known_after_each_step

            program = branch_program(levels.compartments, "location")
            known_rows = known_after_each_step(recordings[0])
            return lambda: [hw.simulate(program, rows).scores for rows in known_rows]
    if "session" in what:
        session = hw.Session(program)
        parts = recordings[0] if "row by row" in what else [recordings[0]]
        return lambda: (session.reset(), [session.push(part) for part in parts])
    played = recordings[:32] if "batch" in what else recordings[0] * np.uint8("empty" not in what)
    return lambda: hw.simulate(program, played)


def drawn_program(sizes: tuple[int, ...], share: float, delays: int):  # type: ignore[no-untyped-def]
    """Return a program of layers in which a share of all pairs is connected, with so many different delays, and a recording."""
    import numpy as np
    from scipy import sparse

    import hw_model as hw

    r = np.random.default_rng(0)
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    previous = builder.add_input("x", sizes[0])
    for k, (sources, targets) in enumerate(pairwise(sizes)):
        layer = builder.add_compartments(
            f"h{k}", targets, decay_u=1024, decay_v=128, threshold=1500
        )
        weights = sparse.random(targets, sources, share, random_state=k, format="csr")
        weights.data = 2 * r.integers(1, 128, weights.nnz) * r.choice([-1, 1], weights.nnz)
        delays_of_synapses = sparse.csr_array(
            (r.integers(0, delays, weights.nnz), weights.indices, weights.indptr), weights.shape
        )
        builder.connect(
            previous,
            layer,
            sparse.csr_array(weights.astype(np.int64)),
            delay=delays_of_synapses if delays > 1 else 0,
        )
        previous = layer
    return builder.build(), (r.random((1, 100, sizes[0])) < 0.03).astype(np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("checkout", type=Path)
    parser.add_argument("--page", type=Path, help="write the table into this page")
    parser.add_argument("--turns", type=int, default=5)
    args = parser.parse_args()
    from machine import machine
    from page_section import put_section

    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    workers = [
        subprocess.Popen(
            [sys.executable, Path(__file__), "--work"], env={**os.environ, "PYTHONPATH": str(tree.resolve())},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )
        for tree in (args.checkout, ROOT)
    ]  # fmt: skip
    rows = []
    for name in JOBS:
        least_seconds = [float("inf"), float("inf")]
        for _ in range(args.turns):
            for i, worker in enumerate(workers):
                worker.stdin.write(f"{name}\n")
                worker.stdin.flush()
                least_seconds[i] = min(least_seconds[i], float(worker.stdout.readline()))
        before_us, now_us = (1e6 * seconds for seconds in least_seconds)
        rows.append(f"| {name} | {before_us:,.0f} | {now_us:,.0f} | {before_us / now_us:.2f} |")
        print(rows[-1], flush=True)
    for worker in workers:
        worker.stdin.close()
        worker.wait()
    revision = ["git", "-C", str(args.checkout), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(revision, capture_output=True, text=True, check=True).stdout.strip()
    if args.page is not None:
        head = HEAD.format(commit=commit, turns=args.turns, processor=machine()["processor"])
        put_section(args.page, "against", head + "\n".join(rows))


if __name__ == "__main__":
    work() if "--work" in sys.argv else main()
