"""Plant every fault of Loihi's arithmetic, and find out which of two independent witnesses detects it.

    python tests/mutants/page_faults.py [CSV]

The page of a chip is the module that defines its arithmetic. The witnesses are the oracle, a second implementation that
does not import the page, and the open core's SystemVerilog, which is loaded with constants of the page without a fault.
Both play randomly drawn programs before any fault is planted. The plain engine, which computes with the page, then plays
the programs with each fault. Writes, for each fault and witness, the first kind of values that differs (:data:`TOLD_BY`).
Takes a few minutes, with Icarus Verilog.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
for folder in ("tests/mutants", ""):
    sys.path.insert(0, str(ROOT / folder))

from faults import Fault, faults_of  # noqa: E402
from tested import reasons  # noqa: E402

import hw_model as hw  # noqa: E402
from hw_model.rtl.cosimulation import play_on_core  # noqa: E402
from hw_model.rtl.simulators import sources  # noqa: E402
from tests.support import any_phases, benches  # noqa: E402
from tests.support import loihi_oracle as oracle  # noqa: E402
from tests.support.any_phases import FEW_ON_CORE  # noqa: E402

MODULES = tuple(f"hw_model.arithmetic.{name}" for name in ("fixed_point", "loihi", "on_integers"))
"""The page, in the order in which these modules import each other: a fault is planted by running them again."""
OF_THE_STEP = {
    "hw_model.arithmetic.fixed_point": {"kept", "half_range", "wrap", "clip", "effective_weight"},
    "hw_model.arithmetic.loihi": {
        "respond",
        "threshold",
        "reset",
        "count_down",
        "blocked_by_spike",
        "events",
        "acts_at",
        "keep_of",
        "bias_of",
        "threshold_of",
    },
}
"""The functions that compute a step, by module. All others only check which numbers fit the chip."""
TOLD_BY = (*oracle.KINDS, "events")
"""Kinds of values that are compared, in this order."""

WRAPS = "a program whose registers wrap"
FADES = "a program whose voltages go back to 0 one by one"


@cache
def case_of(seed: int | str) -> any_phases.Case:
    """Return a drawn program, or one of the two that are made by hand.

    It is built once, before any fault is planted: with a fault, the builder might refuse it or compute other constants.
    """
    if seed == WRAPS:
        return _wrapping()
    if seed == FADES:
        return _fading()
    return any_phases.case(int(seed), plain=True)


def _wrapping() -> any_phases.Case:
    """Return a program in which every register wraps or is clipped, in refractory steps too.

    Biases and weights are the largest that the chip holds, or near them.
    """
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    lines = builder.add_input("x", 4)
    soma = builder.add_compartments(
        "y",
        3,
        decay_u=[0, 390, 40],
        decay_v=[390, 0, 2000],
        threshold=[9, 10_000, 131_071],
        refractory=[4, 2, 1],
        bias=[524_160, 4095, -524_288],
    )
    child = builder.add_compartments(
        "y/child", 3, decay_u=40, decay_v=40, threshold=0, joined_to=soma
    )
    for target in (soma, child):
        builder.connect(lines, target, np.full((3, 4), 255), exponent=7, sign_mode="excitatory")
    builder.connect(lines, soma, np.full((3, 4), -200), exponent=6, sign_mode="inhibitory", delay=3)
    spikes = np.random.default_rng(0).random((2, 60, 4)) < 0.4
    return _case(builder, spikes.astype(np.uint8))


def _fading() -> any_phases.Case:
    """Return a program of a single inhibitory spike, after which the voltage rises to 0 through every value below it."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    lines = builder.add_input("x", 1)
    soma = builder.add_compartments("y", 1, decay_u=4096, decay_v=1, threshold=1)
    builder.connect(lines, soma, np.full((1, 1), -1), exponent=0, sign_mode="inhibitory")
    spikes = np.zeros((1, 80, 1), np.uint8)
    spikes[0, 0] = 1
    return _case(builder, spikes)


def _case(builder: hw.ProgramBuilder, spikes: np.ndarray) -> any_phases.Case:
    return any_phases.Case(builder.build(), builder.graph(), {"x": spikes}, None)


PLAYED = (*FEW_ON_CORE, WRAPS, FADES)
Values = Mapping[str, np.ndarray]
"""The arrays that a program gave in all recordings, by kind of value and group of compartments."""


def faults() -> list[Fault]:
    """Return the faults of the functions of a step, without those that are known to change no result."""
    return [
        fault
        for module, scopes in OF_THE_STEP.items()
        for fault in faults_of(module)
        if fault.scope in scopes and fault.name not in reasons()
    ]


def plant(fault: Fault | None) -> None:
    """Put a fault into the loaded modules, or, with None, restore them.

    All of them run again in place, so that names that one imports from another are replaced too.
    """
    for name in MODULES:
        module = import_module(name)
        path = Path(str(module.__file__))
        sound = path.read_text()
        text = fault.applied() if fault is not None and fault.module == name else sound
        exec(compile(text, str(path), "exec"), vars(module))


def by_engine(seed: int | str) -> Values:
    """Return the values of the plain engine for a program, with the fault that is planted."""
    case = case_of(seed)
    kinds = oracle.KINDS
    played = hw.simulate(case.program, case.spikes, case.steps, engine="reference", probe=kinds)
    return _values(played)


def by_core(seed: int | str) -> Values:
    """Return the values of the core's SystemVerilog for a program."""
    case = case_of(seed)
    result, _ = play_on_core(
        case.program, case.spikes, case.steps, oracle.KINDS, "icarus", sources(), benches.SIZES
    )
    return _values(result)


def by_oracle(seed: int | str) -> Values:
    """Return the values of the oracle for a program."""
    case = case_of(seed)
    batch = len(next(iter(case.spikes.values())))
    recordings = [{name: array[b] for name, array in case.spikes.items()} for b in range(batch)]
    results = [
        oracle.play(case.graph, case.program.chip, recording, case.steps)
        for recording in recordings
    ]
    values = {
        f"{kind} {group}": np.stack([result.arrays[kind][group] for result in results])
        for kind in oracle.KINDS
        for group in results[0].arrays[kind]
    }
    # The engine and the core count events over all recordings, the oracle in each.
    for group in results[0].events:
        counts = [[result.events[group][event] for event in oracle.EVENTS] for result in results]
        values[f"events {group}"] = np.sum(counts, axis=0)
    return values


def _values(result: hw.SimulationResult) -> Values:
    """Return the values of a simulation that are compared."""
    values = {
        f"{kind} {group}": array
        for kind in oracle.KINDS
        for group, array in getattr(result, kind).items()
    }
    for group, counts in result.events.items():
        values[f"events {group}"] = np.array([counts[event] for event in oracle.EVENTS])
    return values


def told_by(sound: Values, faulty: Values) -> str:
    """Return the first kind of values that differs with a fault; "" if none does."""
    for kind in TOLD_BY:
        keys = [key for key in sound if key.startswith(f"{kind} ") and key in faulty]
        if any(not np.array_equal(sound[key], faulty[key]) for key in keys):
            return kind
    return ""


def table() -> list[dict[str, str]]:
    """Return a row for each fault: its name, and the first kind of values of each witness that differs."""
    witnesses = {"oracle": by_oracle, "rtl": by_core}
    sound = {name: [play(seed) for seed in PLAYED] for name, play in witnesses.items()}
    rows = []
    for fault in faults():
        plant(fault)
        try:
            faulty = [by_engine(seed) for seed in PLAYED]
        finally:
            plant(None)
        row = {"fault": fault.name}
        for name, of_seeds in sound.items():
            differing = [told_by(*pair) for pair in zip(of_seeds, faulty, strict=True)]
            row[name] = min(filter(None, differing), key=TOLD_BY.index, default="")
        rows.append(row)
    return rows


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".csv")
    rows = table()
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    for name in ("oracle", "rtl"):
        print(f"{name}: {sum(bool(row[name]) for row in rows)} of {len(rows)} faults")
