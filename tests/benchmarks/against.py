"""Time this version against another one, whose checkout is given: ``against.py CHECKOUT [--page PAGE]``.

    git worktree add ../before COMMIT && python tests/benchmarks/against.py ../before --page docs/research/benchmarks.md

A process of each version plays the same jobs, turn by turn, on one core. A figure is the least processor time of all
calls, which is what other work on the machine disturbs least.
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
"""What is timed, and how often in a turn."""
HEAD = """## Against the version before

`git worktree add ../before {commit} && python tests/benchmarks/against.py ../before --page docs/research/benchmarks.md`: a process of each
version, in turn and on one core, the least processor time of {turns} turns. Measured on {processor}, next to other work.
*Sparse lists* is 2000-2000-2000-2000, one pair in ten connected, 100 steps, 3 % input; *full layers* 500-500-500, all
connected, each pair with one of three delays.

| job | before, µs | now, µs | ratio |
| --- | ---: | ---: | ---: |
"""


def work() -> None:
    """Read names of jobs, a line each, and print seconds of a call."""
    os.cpu_count = lambda: 1
    os.sched_getaffinity = lambda _: {0}
    jobs: dict[str, Callable[[], object]] = {}
    for line in sys.stdin:
        name = line.strip()
        if name not in jobs:
            jobs[name] = job(name)
            jobs[name]()
        found = []
        for _ in range(JOBS[name]):
            start = time.process_time()
            jobs[name]()
            found.append(time.process_time() - start)
        print(min(found), flush=True)


def job(name: str) -> Callable[[], object]:
    """Return a call of this version."""
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
    """Return a program of layers, of whose pairs a share is connected, with so many delays, and recordings for it."""
    import numpy as np
    from scipy import sparse

    import hw_model as hw

    r = np.random.default_rng(0)
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    before = builder.add_input("x", sizes[0])
    for k, (sources, targets) in enumerate(pairwise(sizes)):
        here = builder.add_compartments(f"h{k}", targets, decay_u=1024, decay_v=128, threshold=1500)
        weights = sparse.random(targets, sources, share, random_state=k, format="csr")
        weights.data = 2 * r.integers(1, 128, weights.nnz) * r.choice([-1, 1], weights.nnz)
        late = sparse.csr_array(
            (r.integers(0, delays, weights.nnz), weights.indices, weights.indptr), weights.shape
        )
        builder.connect(
            before,
            here,
            sparse.csr_array(weights.astype(np.int64)),
            delay=late if delays > 1 else 0,
        )
        before = here
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
        least = [float("inf"), float("inf")]
        for _ in range(args.turns):
            for i, worker in enumerate(workers):
                worker.stdin.write(f"{name}\n")
                worker.stdin.flush()
                least[i] = min(least[i], float(worker.stdout.readline()))
        before, now = (1e6 * seconds for seconds in least)
        rows.append(f"| {name} | {before:,.0f} | {now:,.0f} | {before / now:.2f} |")
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
