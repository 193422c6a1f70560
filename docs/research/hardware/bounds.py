"""Play random and hostile recordings to programs of shipped models, and keep how near each comes to its bound on time.

    python docs/research/hardware/bounds.py --recordings 10000 --state build/bounds.json [--csv bounds.csv]
    python docs/research/hardware/bounds.py --on-core objects-hybrid --target ecp5-85f --recordings 100

The second command plays them to the open core itself, in Verilator, and adds a row to bounds-on-core.csv.
A recording's bound is that for as many events per step as its busiest step has. What is done is kept in the state, so that an
interrupted run goes on; it ends with an error at the first recording that exceeds a bound.
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import hw_model as hw
import locsnn_compile as lc
from hw_model.io.files import replace_file
from hw_model.rtl.comparison import compare
from hw_model.rtl.device import on_core
from hw_model.rtl.simulators import sources
from hw_model.rtl.worst_case import core_costs
from hw_model.targets import target_of

MODELS = (
    "objects-hybrid",
    "containers-hybrid",
    "objects-hybrid-loihi",
    "containers-hybrid-loihi",
    "two-fingertips",
    "containers-window-16",
    "containers-best",
    "objects-best",
)
TOGETHER = 50
"""Recordings that are played at a time, all of one kind; then the state is written."""
SLACK = 1 + 1e-9
"""The largest share of a bound that is no fault: sums of floats in another order may differ by so much."""
Shape = tuple[int, int, int]
"""Recordings, steps and channels."""


def at_any_rate(r: np.random.Generator, shape: Shape) -> np.ndarray:
    """Every recording has a rate of its own.

    As all kinds do, return booleans of a shape, from a random generator.
    """
    return r.random(shape) < r.random((shape[0], 1, 1))


def by_channel(r: np.random.Generator, shape: Shape) -> np.ndarray:
    """Every channel has a rate of its own; most are silent or loud."""
    return r.random(shape) < r.beta(0.2, 0.2, (shape[0], 1, shape[2]))


def bursts(r: np.random.Generator, shape: Shape) -> np.ndarray:
    """All channels at once, from time to time."""
    bursting = r.random((shape[0], shape[1], 1)) < r.random((shape[0], 1, 1))
    return np.broadcast_to(bursting, shape)


def few_channels(r: np.random.Generator, shape: Shape) -> np.ndarray:
    """The same few channels in every step: inner spikes cost most of such a recording."""
    many = r.integers(1, shape[2] + 1, (shape[0], 1, 1))
    order = np.argsort(r.random((shape[0], 1, shape[2])), axis=2)
    return np.broadcast_to(order < many, shape)


def without_some(r: np.random.Generator, shape: Shape) -> np.ndarray:
    """All channels, but for some at some steps: nearly the most that there can be."""
    return r.random(shape) >= 0.3 * r.random((shape[0], 1, 1)) ** 3


KINDS: dict[str, Callable[[np.random.Generator, Shape], np.ndarray]] = {
    "any rate": at_any_rate,
    "by channel": by_channel,
    "bursts": bursts,
    "few channels": few_channels,
    "nearly all": without_some,
}


def program_of(model: str, target: str) -> hw.ChipProgram:
    """Compile a shipped model as the command does."""
    path = Path(__file__).parents[3] / "examples/models" / f"{model}.pt"
    return lc.compile(lc.load(path), target, diagnosis=False).program


def shares(program: hw.ChipProgram, rows: int, recordings: np.ndarray) -> dict[str, np.ndarray]:
    """Return the share of its bound that each recording takes, by quantity."""
    target = target_of(program.chip)
    result = hw.simulate(program, recordings, probe=("spikes", "activity"))
    latencies, _ = target.measure(program, recordings, result.activity, result.spikes)
    busiest = recordings.sum(axis=2, dtype=np.int64).max(axis=1)
    bounds = {int(events): hw.worst_case(program, rows, int(events)) for events in set(busiest)}
    shares_of_quantity: dict[str, list[float]] = {"step": [], "answer": [], "recording": []}
    for latency, events in zip(latencies, busiest.tolist(), strict=True):
        bound = bounds[events]
        shares_of_quantity["recording"].append(latency.total_ns / bound.recording_ns)
        if target.times_cores:
            shares_of_quantity["answer"].append(latency.after_last_row_ns / bound.answer_ns)
        if target.times_cores and bound.slowest_step_ns:
            shares_of_quantity["step"].append(latency.slowest_step_ns / bound.slowest_step_ns)
    return {name: np.array(values) for name, values in shares_of_quantity.items() if values}


def play_more(name: str, done: dict[str, Any], program: hw.ChipProgram, rows: int) -> None:
    """Play the next recordings of a program, and note in ``done`` how near they come.

    Kind and random numbers follow from the number of recordings that were played, so that a run that goes on draws the same.
    """
    first = done["recordings"]
    kind = list(KINDS)[first // TOGETHER % len(KINDS)]
    r = np.random.default_rng([first, len(name)])
    channels = sum(program.streams.values())
    recordings = KINDS[kind](r, (TOGETHER, rows, channels)).astype(np.uint8)
    for quantity, values in shares(program, rows, recordings).items():
        largest_share = float(values.max())
        if largest_share > SLACK:
            raise SystemExit(
                f"{name}: {kind}, recordings from {first} on: {quantity} is {largest_share} of its bound"
            )
        largest_before = done["nearest"].setdefault(quantity, [0.0, ""])
        if largest_share > largest_before[0]:
            done["nearest"][quantity] = [largest_share, kind]
    done["recordings"] += TOGETHER


def play(name: str, wanted: int, state: dict[str, Any], path: Path) -> None:
    """Play recordings to a program, ``MODEL on TARGET``, until ``wanted`` were played in all runs."""
    done = state.setdefault(name, {"recordings": 0, "nearest": {}})
    if done["recordings"] >= wanted:
        return
    model, target = name.split(" on ")
    program = program_of(model, target)
    rows = lc.load(Path(__file__).parents[3] / "examples/models" / f"{model}.pt").steps
    while done["recordings"] < wanted:
        play_more(name, done, program, rows)
        replace_file(path, json.dumps(state, indent=1).encode(), "--state")


def play_on_core(model: str, target: str, wanted: int) -> list[object]:
    """Play recordings of all kinds to the core in Verilator; return a row of bounds-on-core.csv."""
    program = program_of(model, target)
    rows = lc.load(Path(__file__).parents[3] / "examples/models" / f"{model}.pt").steps
    channels = sum(program.streams.values())
    costs = core_costs(on_core(program, rows, program.chip))
    shares: list[tuple[float, str]] = []
    values = 0
    for number, (kind, make) in enumerate(KINDS.items()):
        shape = (wanted // len(KINDS), rows, channels)
        recordings = make(np.random.default_rng(number), shape).astype(np.uint8)
        compared = compare(program, recordings, sources())
        if compared["mismatches"] or compared["cycle_mismatches"]:
            raise SystemExit(f"{model} on {target}: {kind}: the core differs from the simulator")
        values += compared["compared_values"]
        busiest = recordings.sum(axis=2, dtype=np.int64).max(axis=1)
        for cycles, events in zip(compared["cycles"], busiest.tolist(), strict=True):
            share = cycles / costs.recording(events)
            if share > 1:
                raise SystemExit(f"{model} on {target}: {kind}: {share} of the bound")
            shares.append((share, kind))
    least, _ = min(shares)
    most, nearest = max(shares)
    return [model, target, len(shares), values, f"{least:.3f}", f"{most:.3f}", nearest]


def append_on_core(row: list[object]) -> None:
    """Write a row at the end of bounds-on-core.csv."""
    path = Path(__file__).parent / "bounds-on-core.csv"
    is_new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if is_new:
            writer.writerow("program target recordings values least most kind".split())
        writer.writerow(row)


def table(state: dict[str, Any]) -> list[list[str]]:
    """Return a row for every program: recordings, and the largest share of each bound with its kind."""
    rows = [["program", "target", "recordings", "step", "answer", "recording", "kind"]]
    for name, done in state.items():
        model, target = name.split(" on ")
        nearest = done["nearest"]
        cells = [f"{nearest[key][0]:.3f}" if key in nearest else "" for key in rows[0][3:6]]
        rows.append([model, target, str(done["recordings"]), *cells, nearest["recording"][1]])
    return rows


def main() -> None:
    """Play the recordings that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=int, default=10_000)
    parser.add_argument("--target", default="loihi-sim")
    parser.add_argument("--models", nargs="*", default=list(MODELS))
    parser.add_argument("--state", type=Path)
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--on-core", metavar="MODEL")
    args = parser.parse_args()
    if args.on_core:
        append_on_core(play_on_core(args.on_core, args.target, args.recordings))
        return
    if args.state is None:
        parser.error("--state is needed")
    state: dict[str, Any] = json.loads(args.state.read_text()) if args.state.exists() else {}
    for model in args.models:
        play(f"{model} on {args.target}", args.recordings, state, args.state)
    if args.csv:
        with args.csv.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(table(state))


if __name__ == "__main__":
    main()
