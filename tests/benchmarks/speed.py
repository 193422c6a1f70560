"""Measure the fast engine beside a plain numpy loop, the machine's limit, and peers where ``make peers`` made them.

``python tests/benchmarks/speed.py docs/speed.md`` writes the page. All in one run, one after the other; two threads where
a tool has them. Networks: feed-forward CUBA-LIF of random even 8-bit weights, Bernoulli input, decays 1024 and 128.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

import hw_model as hw

ROOT = Path(__file__).parents[2]
NETWORKS = {
    "small": {"sizes": (156, 32, 20), "steps": 325, "rate": 0.03, "threshold": 1000, "batch": 256},
    "large": {"sizes": (1024, 1024, 1024, 10), "steps": 200, "rate": 0.02, "threshold": 4000, "batch": 32},
}
PEERS = ("nengo-loihi", "lava-dl")


def job_of(name: str) -> dict[str, Any]:
    """Return the network as plain values, in the format that the peers' drivers read."""
    n = NETWORKS[name]
    r = np.random.default_rng(0)
    sizes: tuple[int, ...] = n["sizes"]  # type: ignore[assignment]
    names = ["x", *(f"layer{i}" for i in range(len(sizes) - 1))]
    populations = [
        {
            "name": to, "size": size, "decay_u": [1024] * size, "decay_v": [128] * size, "threshold": [n["threshold"]] * size,
            "bias": [0] * size, "refractory": [1] * size, "vmin": 1 - 2**23, "vmax": 2**23 - 1,
        }
        for to, size in zip(names[1:], sizes[1:], strict=True)
    ]  # fmt: skip
    projections = [
        {
            "source": source, "target": to, "weights": (2 * r.integers(-127, 128, (after, before))).tolist(),
            "delay": [[0]], "exponent": 0, "weight_bits": 8, "sign_mode": "mixed",
        }
        for source, to, before, after in zip(names, names[1:], sizes, sizes[1:], strict=False)
    ]  # fmt: skip
    recordings = (r.random((n["batch"], n["steps"], sizes[0])) < n["rate"]).astype(np.uint8)
    return {"populations": populations, "projections": projections, "recordings": recordings}


def program_of(job: dict[str, Any]) -> hw.ChipProgram:
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    nodes = {"x": builder.add_input("x", job["recordings"].shape[2])}
    for p in job["populations"]:
        parameters = {key: p[key] for key in ("decay_u", "decay_v", "threshold")}
        nodes[p["name"]] = builder.add_compartments(p["name"], p["size"], **parameters)
    for s in job["projections"]:
        builder.connect(nodes[s["source"]], nodes[s["target"]], s["weights"])
    return builder.build()


def plain_numpy(job: dict[str, Any], spikes: np.ndarray) -> dict[str, np.ndarray]:  # type: ignore[type-arg]
    """A matrix product a layer and a Python loop over steps, on one recording."""

    def rz(x: Any, d: int) -> Any:
        return np.sign(x) * ((np.abs(x) * (4096 - d)) >> 12)

    found, played = {}, spikes
    for population, projection in zip(job["populations"], job["projections"], strict=True):
        weights = np.array(projection["weights"], dtype=np.float64)
        charge = (played.astype(np.float64) @ weights.T).astype(np.int64) << 6
        u = v = np.zeros(population["size"], dtype=np.int64)
        fired = np.zeros(charge.shape, dtype=np.uint8)
        for t in range(1, len(charge)):
            u = rz(u, 1024) + charge[t - 1]
            v = np.clip(rz(v, 128) + u, 1 - 2**23, 2**23 - 1)
            fired[t] = v > 64 * population["threshold"][0]
            v = np.where(fired[t], 0, v)
        found[population["name"]] = played = fired
    return found


@numba.njit(boundscheck=False)
def _add_rows(weights, charge, count):  # type: ignore[no-untyped-def]
    """Add ``count`` rows of 16-bit weights to rows of 32-bit charges: the memory traffic of synapses, and nothing else."""
    for k in range(count):
        row, due = weights[k % len(weights)], charge[k % len(charge)]
        for j in range(len(row)):
            due[j] += row[j]


def limit_ops_per_second(width: int) -> float:
    """Return synaptic operations a second of two threads that only add rows of this width."""
    from concurrent.futures import ThreadPoolExecutor

    weights = np.random.default_rng(0).integers(-127, 127, (1024, width)).astype(np.int16)
    count = 40_000_000 // width
    run = numba.njit(nogil=True, boundscheck=False)(_add_rows.py_func)
    run(weights, np.zeros((64, width), dtype=np.int32), 1)

    def one(_: int) -> None:
        run(weights, np.zeros((64, width), dtype=np.int32), count)

    def both() -> None:
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(one, range(2)))

    return 2 * count * width / median_seconds(both)


def median_seconds(run: Callable[[], object], times: int = 7) -> float:
    run()
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def peer_seconds(peer: str, job_file: Path) -> float | None:
    python = ROOT / ".peers" / peer / "bin/python"
    if not python.exists():
        return None
    command = [str(python), str(Path(__file__).with_name("time_peer.py")), peer, str(job_file)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def rows_of(name: str) -> list[str]:
    job = job_of(name)
    program, recordings = program_of(job), job["recordings"]
    result = hw.simulate(program, recordings)
    wanted = plain_numpy(job, recordings[0])
    assert all(np.array_equal(result.spikes[layer][0], spikes) for layer, spikes in wanted.items())
    ops = result.counts.synaptic_ops / len(recordings)
    ours = median_seconds(lambda: hw.simulate(program, recordings)) / len(recordings)
    found = {
        f"hw_model, batch of {len(recordings)}": ours,
        "hw_model, one recording": median_seconds(lambda: hw.simulate(program, recordings[0]), 30),
        "plain numpy loop": median_seconds(lambda: plain_numpy(job, recordings[0]), 5),
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "job.json"
        file.write_text(json.dumps({**job, "recordings": recordings[:32].tolist()}))
        for peer in PEERS:
            seconds = peer_seconds(peer, file)
            if seconds is not None:
                found[peer + (", batch of 32" if peer == "lava-dl" else "")] = seconds
    limit = limit_ops_per_second(max(NETWORKS[name]["sizes"][1:]))  # type: ignore[index]
    rows = [
        f"**{name}**: {ops:,.0f} synaptic operations a recording",
        "",
        "| tool | µs a recording | ratio |",
        "| --- | ---: | ---: |",
    ]
    rows += [f"| {tool} | {seconds * 1e6:,.1f} | {seconds / ours:,.1f} |" for tool, seconds in found.items()]
    rows += [
        "",
        f"{ops / ours / 1e9:.1f} of at most {limit / 1e9:.1f} billion synaptic operations a second (adding rows and nothing else).",
        "",
    ]
    return rows


def page() -> str:
    head = """# Speed

Written by `python tests/benchmarks/speed.py docs/speed.md` on two cores, after `make peers`: medians of one run, without
start-up and build. Ratios, not seconds, are the result.

Feed-forward CUBA-LIF networks of random even 8-bit weights, decays 1024 and 128, Bernoulli input. *small*: 156-32-20, 325
steps, 3 % input. *large*: 1024-1024-1024-10, 200 steps, 2 % input. Spikes were equal to those of the plain loop.
"""
    return "\n".join([head, *rows_of("small"), *rows_of("large")]).rstrip() + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", type=Path)
    parser.parse_args().page.write_text(page())
    sys.exit()
