"""Every tool on the same networks and recordings, turn by turn, so that other work on the machine disturbs all alike.

Our spikes must equal those of a plain numpy loop; those of other tools are only counted where they differ.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import plain_numpy
import pytest
from child import peak_mib
from limits import TrafficLimit, median_seconds
from machine import machine
from peer_process import PeerProcess, why_missing
from workloads import RECORDINGS, WORKLOADS, Workload, example_levels, published_test_part

import hw_model as hw

pytestmark = pytest.mark.bench

MODES: Mapping[str, tuple[str, ...]] = {
    "nengo-loihi": ("emulator",),
    "brian2-loihi": ("cython",),
    "lava-dl": ("batch of 32", "one recording"),
    "sanafe": ("detailed", "simple"),
}
"""The modes of each peer; ratios on the pages are for the first."""
ONE_THREAD = {"nengo-loihi", "brian2-loihi", "sanafe"}
"""Tools that use one core. For them two processes also play at once, for a fair comparison with tools that use both cores."""
ROUNDS = {"small": 15, "large": 7, "objects": 7, "containers": 5}
"""Turns of every tool; fewer for workloads on which the slowest takes seconds."""
QUICK_ROUNDS = 2

Turn = Callable[[], float]


@dataclass
class Row:
    """A tool in a mode: seconds per recording, turn by turn."""

    tool: str
    mode: str
    turn: Turn
    version: str = ""
    spikes_differ: int | None = None
    peak_mib: float | None = None
    seconds: list[float] = field(default_factory=list)

    def result(self) -> dict[str, Any]:
        """Return the row as ``page_peers.py`` reads it: the median, and the middle half of all turns."""
        low, _, high = statistics.quantiles(self.seconds, n=4)
        return {
            "tool": self.tool, "mode": self.mode, "version": self.version, "spikes_differ": self.spikes_differ,
            "peak_mib": self.peak_mib, "seconds": statistics.median(self.seconds), "quartiles": [low, high],
            "turns": len(self.seconds),
        }  # fmt: skip


@pytest.mark.parametrize("name", WORKLOADS)
def test_spikes_equal_the_plain_loop_and_times_of_all_tools_are_recorded(
    name, benchmark, record, quick, tmp_path
):
    if name in ("objects", "containers") and not RECORDINGS.is_dir():
        pytest.skip("the published recordings are not beside the repository")
    workload = WORKLOADS[name]()
    programs = [network.program() for network in workload.networks]
    results = [
        play_batch(program, network)
        for program, network in zip(programs, workload.networks, strict=True)
    ]
    wanted = [plain_numpy.play(network, network.recordings[0]) for network in workload.networks]
    for result, spikes in zip(results, wanted, strict=True):
        assert all(
            np.array_equal(ours[0], theirs)
            for ours, theirs in zip(result.spikes.values(), spikes, strict=True)
        )
    batch = len(workload.networks[0].recordings)

    def ours() -> None:
        for program, network in zip(programs, workload.networks, strict=True):
            play_batch(program, network)

    with ExitStack() as stack:
        rows = [*own_rows(name, workload, programs), *peer_rows(stack, workload, wanted, tmp_path)]
        limits = [
            TrafficLimit(network, list(result.spikes.values()))
            for network, result in zip(workload.networks, results, strict=True)
        ]
        kernels = [
            Row("limit", kind, lambda kind=kind: sum(getattr(limit, kind)() for limit in limits))  # type: ignore[misc]
            for kind in ("plain", "rows", "rows_and_state")
        ]

        # The benchmark calls this before each of our turns, so that all tools take turns.
        def others() -> None:
            for row in [*rows, *kernels]:
                row.seconds.append(row.turn())

        rounds = QUICK_ROUNDS if quick else ROUNDS[name]
        benchmark.pedantic(ours, setup=others, rounds=rounds, warmup_rounds=1)
        for row in [*rows, *kernels]:
            del row.seconds[0]  # the warm-up of the row
        for row in rows:
            if row.tool in MODES and row.mode == MODES[row.tool][0]:
                row.peak_mib = row.turn.peer.peak_mib()  # type: ignore[attr-defined]
    own = Row(
        "hw_model", f"batch of {batch}", lambda: 0.0, peak_mib=peak_mib("play_workload.py", name)
    )
    own.seconds = [seconds / batch for seconds in benchmark.stats.stats.data]
    own.spikes_differ = 0
    found = {
        "name": name,
        "text": workload.text,
        "batch": batch,
        "synaptic_ops": sum(r.counts.synaptic_ops for r in results) / batch,
        "neuron_updates": sum(r.counts.neuron_updates for r in results) / batch,
        "spikes": sum(r.counts.spikes for r in results) / batch,
        "rows": [row.result() for row in [own, *rows]],
        "limits": {row.mode: row.result()["seconds"] for row in kernels},
        "machine": machine(),
    }
    benchmark.extra_info.update(found)
    record(f"side_by_side_{name}", found)


def play_batch(program: hw.ChipProgram, network: Any) -> hw.SimulationResult:
    """Play all recordings in one call."""
    return hw.simulate(program, network.recordings)


def own_rows(name: str, workload: Workload, programs: list[hw.ChipProgram]) -> Iterator[Row]:
    """Yield rows for our engine on one recording at a time, the plain loop, and the example for which the workload stands."""

    def one() -> float:
        parts = zip(programs, workload.networks, strict=True)
        return sum(
            median_seconds(lambda p=p, n=n: hw.simulate(p, n.recordings[0]), 5) for p, n in parts
        )  # type: ignore[misc]

    def plain() -> float:
        return sum(
            median_seconds(lambda n=n: plain_numpy.play(n, n.recordings[0]), 1)
            for n in workload.networks
        )  # type: ignore[misc]

    yield Row("hw_model", "one recording", one, spikes_differ=0)
    yield Row("numpy", "plain loop over steps", plain, version=np.__version__, spikes_differ=0)
    if name in ("objects", "containers"):
        program, recordings = example_levels(name).program, published_test_part(name).spikes
        yield Row(
            "hw_model",
            f"the example itself, three compartments a neuron, batch of {len(recordings)}",
            lambda: median_seconds(lambda: hw.simulate(program, recordings), 1) / len(recordings),
        )


@dataclass(frozen=True)
class PeerTurn:
    """A turn of a peer in one process."""

    peer: PeerProcess
    mode: str

    def __call__(self) -> float:
        return self.peer.turn(self.mode)


def peer_rows(stack: ExitStack, workload: Workload, wanted: list[Any], folder: Path) -> list[Row]:
    """Start the peers that have an environment, all at once, and wait until all are ready; return their rows."""
    job = folder / "job.npz"
    workload.write_job(job)
    tools = [tool for tool in MODES if why_missing(tool) is None]
    started = {tool: [stack.enter_context(PeerProcess(tool, job)) for _ in range(1 + (tool in ONE_THREAD))] for tool in tools}  # fmt: skip
    rows = []
    for tool, peers in started.items():
        version, spikes = [peer.ready() for peer in peers][-1]
        differ = sum(
            int((mine != theirs).sum())
            for network, found in zip(wanted, spikes, strict=True)
            for mine, theirs in zip(network, found.values(), strict=True)
        )
        for mode in MODES[tool]:
            rows.append(Row(tool, mode, PeerTurn(peers[0], mode), version, differ))
        if tool in ONE_THREAD:
            turn = lambda peers=peers, mode=MODES[tool][0]: both(peers, mode)  # noqa: E731
            rows.append(Row(tool, f"{MODES[tool][0]}, two processes", turn, version, differ))
    return rows


def both(peers: list[PeerProcess], mode: str) -> float:
    """Let processes play at the same time; return seconds per recording, by the slower one."""
    for peer in peers:
        peer.start(mode)
    return max([peer.finish() for peer in peers]) / len(peers)
