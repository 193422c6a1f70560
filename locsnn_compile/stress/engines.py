"""Every way to compute a program must give the same integers: which of them does not."""

from __future__ import annotations

from typing import Any

import numpy as np

import hw_model as hw
from hw_model.engine.trace import ByteArray
from hw_model.simulation import SimulationResult
from locsnn_compile.pipeline import Levels
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.stress.cases.case import POPULATION
from locsnn_compile.stress.sides import Sides

PROBES: tuple[Any, ...] = ("spikes", "u", "v", "potential")


def odd_one_out(levels: Levels, sides: Sides, recordings: ByteArray, found: SimulationResult) -> str | None:
    """Name the first of four that differs from ``found``, what the fast engine made of recordings; None if none does.

    The population's own integer arithmetic and the float64 twin play all recordings; the reference engine, and the
    fast one without skipping, the first.
    """
    integers = evaluate(
        levels.quantized.on_grid(), recordings, potentials=True, registers=levels.program.chip.registers
    )
    spikes, potential = found.spikes[POPULATION], found.potential[POPULATION]
    if not (np.array_equal(integers.spikes[POPULATION], spikes) and _equal(integers.potential, found.potential)):
        return "the integer evaluation of the population"
    twin = sides.free()
    if not (np.array_equal(twin.spikes[POPULATION], spikes) and np.array_equal(twin.potential[POPULATION], potential)):
        return "the float64 twin of the compartments"
    first = hw.simulate(levels.program, recordings[:1], probe=PROBES)
    if not _same(first, hw.simulate(levels.program, recordings[:1], engine="reference", probe=PROBES)):
        return "the reference engine"
    if not _same(first, hw.simulate(levels.program, recordings[:1], probe=PROBES, skip=False)):
        return "the fast engine without skipping"
    return None


def _equal(one: Any, other: Any) -> bool:
    return np.array_equal(one[POPULATION], other[POPULATION])


def _same(one: SimulationResult, other: SimulationResult) -> bool:
    """Compare spikes, registers, counts but for skipped steps, and wraps and clips by population."""
    counted = [{**dict(result.counts), "skipped_steps": 0} for result in (one, other)]
    return (
        counted[0] == counted[1]
        and one.events == other.events
        and all(
            np.array_equal(array, getattr(other, kind)[name])
            for kind in PROBES
            for name, array in getattr(one, kind).items()
        )
    )
