"""Time one epoch of the hybrid on Ev-Objects beside the same network in snnTorch and SpikingJelly.

    python tests/peers/make_environments.py
    python tests/benchmarks/training_speed.py --data FOLDER --page docs/research/benchmarks/training-speed.md

``FOLDER`` holds Ev-Objects.zip. All tools wait in processes of their own and take turns in one run; medians of ``--turns``.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "peers"))
from machine import machine
from make_environments import python_of, why_missing
from page_section import put_section

from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.train import train

PEERS = {"snntorch": "snnTorch", "spikingjelly": "SpikingJelly"}
BATCHES = (8, 16)
"""Recordings of a batch, around the 8 of our training settings."""
GOAL = 40
"""How many times less processor time an epoch should take than with a peer: what we set out to reach, not a measurement."""


class Peer:
    """A peer that waits in its own environment for a batch size, and answers with the seconds of an epoch."""

    def __init__(self, tool: str, job: Path) -> None:
        command = [
            str(python_of(tool)),
            str(Path(__file__).with_name("training_peer.py")),
            tool,
            str(job),
        ]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.version: str = self._answer()["version"]

    def epoch(self, batch: int) -> float:
        """Return the processor seconds of an epoch with batches of a size."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{batch}\n")
        self._process.stdin.flush()
        return float(self._answer()["seconds"])

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        answer: dict[str, Any] = json.loads(self._process.stdout.readline())
        return answer


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--page", type=Path, help="write the table into this page")
    parser.add_argument("--turns", type=int, default=3)
    args = parser.parse_args()
    recordings = read_recordings(args.data / "Ev-Objects.zip", split="train")
    missing = {tool: why_missing(tool) for tool in PEERS}
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder) / "recordings.npz"
        np.savez(job, spikes=recordings.spikes, labels=recordings.labels)
        peers = {tool: Peer(tool, job) for tool in PEERS if missing[tool] is None}
        try:
            seconds = measure(recordings, peers, args.turns)
        finally:
            for peer in peers.values():
                peer.close()
    text = section(
        len(recordings), seconds, {tool: peer.version for tool, peer in peers.items()}, args.turns
    )
    print(text)
    if args.page is not None:
        put_section(args.page, "training-speed", text)


def measure(
    recordings: Recordings, peers: dict[str, Peer], turns: int
) -> dict[tuple[str, int], list[float]]:
    """Return the seconds of every turn, by tool and batch size."""
    own_epoch(recordings.subset(range(16)), 16)  # numba compiles
    seconds: dict[tuple[str, int], list[float]] = {}
    for _ in range(turns):
        for batch in BATCHES:
            seconds.setdefault(("own", batch), []).append(own_epoch(recordings, batch))
            for tool, peer in peers.items():
                seconds.setdefault((tool, batch), []).append(peer.epoch(batch))
    return seconds


def own_epoch(recordings: Recordings, batch: int) -> float:
    """Return the processor seconds of an epoch of ``train``, from the difference between runs of one and of nine epochs.

    So preparing recordings and compiling do not count, as they do not in the peers.
    """
    config = TrainingConfig(
        batch_size=batch, event_dropout=0.0, channel_dropout=0.0, validation_fraction=0.0
    )
    few, many = 1, 9
    seconds = {}
    for epochs in (few, many):
        before = time.process_time()
        train(recordings, replace(config, epochs=epochs))
        seconds[epochs] = time.process_time() - before
    return (seconds[many] - seconds[few]) / (many - few)


def section(
    count: int, seconds: dict[tuple[str, int], list[float]], versions: dict[str, str], turns: int
) -> str:
    """Return the page's section."""
    medians = {key: statistics.median(values) for key, values in seconds.items()}
    rows = []
    for tool in ("own", *versions):
        name = "locsnn train" if tool == "own" else f"{PEERS[tool]} {versions[tool]}"
        cells = [f"{medians[tool, batch]:.2f}" for batch in BATCHES]
        ratios = [
            "" if tool == "own" else f"{medians[tool, batch] / medians['own', batch]:.0f}"
            for batch in BATCHES
        ]
        rows.append("| " + " | ".join([name, *cells, *ratios]) + " |")
    table = "\n".join(rows)
    times_less = [
        medians[tool, batch] / medians["own", batch] for tool in versions for batch in BATCHES
    ]
    names = " and ".join(PEERS[tool] for tool in versions)
    return f"""An epoch takes {min(times_less):.0f} to {max(times_less):.0f} times less processor time than with {names}. Each tool trains the hybrid network
on the {count} train recordings of Ev-Objects (250 steps, 78 channels, 32 hidden neurons per branch), measured in processor seconds on one thread, medians of {turns} turns that all tools take in one run: `python tests/benchmarks/training_speed.py --data FOLDER`.
Every tool uses its own second-order neurons (a synaptic current and a membrane), the same sizes, loss, optimizer and batches, and
one matrix product for all steps of a layer. snnTorch and SpikingJelly have no refractory kernel and reset the membrane instead
(`tests/benchmarks/training_peer.py`). The goal is a ratio of {GOAL}. Measured on {machine()["processor"]}.

| tool | batch {BATCHES[0]}, s | batch {BATCHES[1]}, s | ratio, batch {BATCHES[0]} | ratio, batch {BATCHES[1]} |
| --- | ---: | ---: | ---: | ---: |
{table}
"""


if __name__ == "__main__":
    main()
