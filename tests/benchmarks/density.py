"""Work, time and energy against the density of a recording, from empty to dense, in both phases: ``density.py --page PAGE``.

The compiled ``objects-hybrid`` plays recordings whose events are drawn; the densest has an event of every channel in every
step. Time is the least processor time of a batch of 16 over many turns, all densities in turn, on one core; work and energy
follow from counts.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

import numpy as np
from machine import machine
from numpy.typing import NDArray
from page_section import put_section
from workloads import example_levels

import hw_model as hw

DENSITIES = (0.0, 0.0001, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
BATCH = 16
HEAD = """## Work, time and energy against density

`python tests/benchmarks/density.py --page docs/research/benchmarks/recordings.md`: the compiled `objects-hybrid` on recordings whose events are
drawn, from none to one in every bin, {steps} steps of {channels} channels. Processor time per recording on one core, the least of {turns}
turns of a batch of {batch}; energy of profile {profile}. *Stop* is where `--stop proven` ends, of {all_steps} steps. Measured on {processor}.

| density | µs per recording | phase | updates | of them active | synaptic operations | steps skipped | nJ | stop |
| ---: | ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: |
"""


def recordings_of(density: float, steps: int, channels: int) -> NDArray[np.uint8]:
    """Return recordings (batch, steps, channels) with events drawn at a density."""
    r = np.random.default_rng(7)
    return (r.random((BATCH, steps, channels)) < density).astype(np.uint8)


def seconds_of(
    program: hw.ChipProgram, recordings: dict[float, NDArray[np.uint8]], turns: int
) -> dict[float, float]:
    """Return the least processor seconds of a recording at each density. One more turn is played, as the first one compiles."""
    least = dict.fromkeys(recordings, float("inf"))
    for _ in range(turns + 1):
        for density, batch in recordings.items():
            start = time.process_time()
            hw.simulate(program, batch, probe=())
            least[density] = min(least[density], (time.process_time() - start) / BATCH)
    return least


def rows_of(
    program: hw.ChipProgram, density: float, batch: NDArray[np.uint8], seconds: float
) -> list[str]:
    """Return a row of the table for each phase; figures of whole recordings are in the first."""
    profile = program.chip.profile(program.chip.default_profile)
    stop = hw.stop_when_proven(program, batch).steps.mean()
    rows = []
    for phase, counts in hw.simulate(program, batch, probe=()).counts_by_phase.items():
        is_first = not rows
        nj = sum(hw.energy_pj(counts, profile).values()) / BATCH / 1e3
        cells = (
            f"{100 * density:g} %" if is_first else "", f"{1e6 * seconds:.0f}" if is_first else "", phase,
            f"{counts.neuron_updates / BATCH:,.0f}", f"{100 * counts.neuron_updates_active / counts.neuron_updates:.1f} %",
            f"{counts.synaptic_ops / BATCH:,.0f}", f"{counts.skipped_steps / BATCH:.1f}", f"{nj:,.1f}",
            f"{stop:.1f}" if is_first else "",
        )  # fmt: skip
        rows.append(f"| {' | '.join(cells)} |")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--page", type=Path, help="write the table into this page")
    parser.add_argument("--turns", type=int, default=60)
    args = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    levels = example_levels("objects")
    steps, channels = levels.network.steps, levels.program.inputs[0].channels
    recordings = {density: recordings_of(density, steps, channels) for density in DENSITIES}
    seconds = seconds_of(levels.program, recordings, args.turns)
    rows = [
        row
        for d, batch in recordings.items()
        for row in rows_of(levels.program, d, batch, seconds[d])
    ]
    text = HEAD.format(
        steps=steps, channels=channels, turns=args.turns, batch=BATCH, processor=machine()["processor"],
        profile=levels.program.chip.default_profile, all_steps=sum(phase.steps or 0 for phase in levels.program.phases),
    ) + "\n".join(rows)  # fmt: skip
    print(text)
    if args.page is not None:
        put_section(args.page, "density", text)


if __name__ == "__main__":
    main()
