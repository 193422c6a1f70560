"""Our engines next to simulators of chips, in one run: xylosim for Xylo, Lava's fixed-point models for Loihi 2.

``chips_speed.py --page PAGE`` writes the table into a page. Each side plays one network of random weights from rest and
returns every spike; the fastest turn counts. tests/peers tests that both compute the same, and ``make peers`` makes the
environments. Lava starts an operating-system process for each part of a network, so its time for a few steps is subtracted.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from machine import machine
from numpy.typing import NDArray
from page_section import put_section

import hw_model as hw
from hw_model.values import Frozen
from hw_model.xylo.fast import play_fast
from hw_model.xylo.network import XyloNetwork, XyloPopulation

TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(TESTS / "peers"), str(TESTS.parent)]
from make_environments import python_of, why_missing  # noqa: E402

from tests.support.lava_folders import write_folder  # noqa: E402
from tests.support.witness_files import write_networks  # noqa: E402

STEPS = 1000
FEW_STEPS = 10
"""Steps of the run whose time, nearly all of it the start of processes, is subtracted from Lava's."""
TURNS = 5
LAVA_TURNS = 1
"""Lava takes so long that one turn must do."""
HEAD = """## Simulators of chips

`python tests/benchmarks/chips_speed.py --page docs/research/benchmarks/side-by-side.md`: one network of random weights for each chip, {steps:,}
steps, every spike returned. Processor time, the least of {turns} turns ({lava_turns} for Lava, whose start is not counted and whose
processes are added up). Measured on {processor}; the average load of other work was {load:.1f}.

| simulator | network | it takes | we take | times faster |
| --- | --- | ---: | ---: | ---: |
"""


class Pair(Frozen):
    """What a simulator and our engine take for one network, in processor seconds."""

    simulator: str
    network: str
    peer_seconds: float
    our_seconds: float

    @property
    def row(self) -> str:
        """A row of the table."""
        return (
            f"| {self.simulator} | {self.network} | {1e3 * self.peer_seconds:,.1f} ms "
            f"| {1e3 * self.our_seconds:,.2f} ms | {self.peer_seconds / self.our_seconds:,.1f} |"
        )


def least_seconds(play: Callable[[], object]) -> float:
    """Return the least processor seconds of some turns, after one that compiles."""
    play()
    seconds = []
    for _ in range(TURNS):
        started = time.process_time()
        play()
        seconds.append(time.process_time() - started)
    return min(seconds)


def timed_by(environment: str, script: str, *arguments: str) -> float:
    """Run a script of tests/peers in the environment of a peer; return the seconds that it prints last."""
    call = [str(python_of(environment)), str(TESTS / "peers" / script), *arguments]
    printed = subprocess.run(call, check=True, capture_output=True, text=True).stdout
    return float(printed.split()[-1])


def xylo_case(hidden: int) -> tuple[XyloNetwork, NDArray[np.int64]]:
    """Return a network of 16 inputs and 8 outputs, and rows of events for it."""
    generator = np.random.default_rng(hidden)

    def weights(*shape: int) -> NDArray[np.int64]:
        return generator.integers(-60, 61, shape)

    def population(size: int) -> XyloPopulation:
        return XyloPopulation(
            dash_syn=np.full((size, 1), 2), dash_mem=np.full(size, 4), threshold=np.full(size, 900)
        )

    network = XyloNetwork(
        population(hidden),
        population(8),
        weights(16, hidden, 1),
        weights(hidden, hidden, 1) // 12,
        weights(hidden, 8),
        shift_in=0,
        shift_hidden=0,
        shift_out=0,
    )
    return network, (generator.random((STEPS, 16)) < 0.2).astype(np.int64)


def against_xylosim(hidden: int) -> Pair:
    """Time one network in xylosim and in our engine."""
    network, events = xylo_case(hidden)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "networks.npz"
        write_networks(path, [(network, events)])
        peer = timed_by("xylosim", "time_xylosim.py", str(path), str(TURNS))
    ours = least_seconds(lambda: play_fast(network, events))
    return Pair("xylosim 0.1.3", f"16 - {hidden} recurrent - 8", peer, ours)


def loihi_case(hidden: int, steps: int) -> tuple[hw.ChipProgram, NDArray[np.uint8]]:
    """Return a recurrent network of 64 inputs and 16 outputs, and a recording."""
    generator = np.random.default_rng(hidden)
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"), "speed")
    lines = builder.add_input("x", 64)
    settings = {"decay_u": 1024, "decay_v": 256, "threshold": 2000}
    first = builder.add_compartments("h", hidden, **settings)
    last = builder.add_compartments("y", 16, **settings)
    for source, target in ((lines, first), (first, first), (first, last)):
        mantissas = 2 * generator.integers(-50, 55, (target.size, source.size))
        builder.connect(source, target, mantissas)
    spikes = (generator.random((STEPS, 64)) < 0.1).astype(np.uint8)
    return builder.build(), spikes[:steps]


def against_lava(hidden: int) -> Pair:
    """Time one network in Lava and in our engine."""
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        for steps in (FEW_STEPS, STEPS):
            written = write_folder(Path(folder) / str(steps), loihi_case(hidden, steps))
            seconds.append(timed_by("lava", "time_lava.py", str(written), str(LAVA_TURNS)))
    program, spikes = loihi_case(hidden, STEPS)
    ours = least_seconds(lambda: hw.simulate(program, spikes))
    network = f"64 - {hidden} recurrent - 16"
    return Pair("Lava 0.10.0, `fixed_pt`", network, seconds[1] - seconds[0], ours)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--page", type=Path, help="write the table into this page")
    page = parser.parse_args().page
    for environment in ("xylosim", "lava"):
        reason = why_missing(environment)
        if reason:
            raise SystemExit(f"{environment}: {reason}")
    load = os.getloadavg()[0]
    pairs = [*map(against_xylosim, (64, 256)), *map(against_lava, (64, 256))]
    head = HEAD.format(
        steps=STEPS,
        turns=TURNS,
        lava_turns=LAVA_TURNS,
        processor=machine()["processor"],
        load=load,
    )
    text = head + "\n".join(pair.row for pair in pairs)
    print(text)
    if page is not None:
        put_section(page, "chips", text)


if __name__ == "__main__":
    main()
