"""Energy and latency: counts times costs, and nothing else. Here a picojoule is multiplied."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hw_model.activity import StepActivity
from hw_model.chip_description import Profile
from hw_model.counts import Counts
from hw_model.program import ChipProgram

FloatArray = npt.NDArray[np.float64]


def energy_pj(counts: Counts, profile: Profile) -> dict[str, float]:
    """Return picojoules by operation: each count times its cost. What a profile does not price is not in it."""
    return {name: counts[name] * cost for name, cost in profile.energy_pj.items()}


@dataclass(frozen=True, eq=False)
class Latency:
    """Time of one recording.

    A step of a phase lasts as long as its slowest core, the longest way that this core's packets can go, and the
    barrier; phases follow each other. Host input and the transpose buffer are not in it.
    """

    total_ns: float
    by_phase_ns: Mapping[str, float]
    critical_core: int
    """The core that decided most of the time."""


@dataclass(frozen=True, eq=False)
class StepTimes:
    """Where the time of one phase goes, arrays (steps, cores) in nanoseconds.

    ``work_ns[count]``: what a core works on each operation; ``way_ns``: the longest way of its packets, after its work.
    A step ends ``barrier_ns`` after the last core.
    """

    work_ns: Mapping[str, FloatArray]
    way_ns: FloatArray
    barrier_ns: float

    @property
    def core_ns(self) -> FloatArray:
        """Time from the start of a step until the last packet of each core has arrived."""
        working: FloatArray = sum(self.work_ns.values(), start=np.zeros_like(self.way_ns))
        return working + self.way_ns


def latency(program: ChipProgram, activity: Mapping[str, StepActivity], profile: Profile) -> Latency:
    """Return the time of one recording from its activity by phase."""
    critical = np.zeros(len(program.cores))
    by_phase = {}
    for phase, steps in activity.items():
        times = step_times(program, phase, steps, profile)
        core_ns = times.core_ns
        slowest = core_ns.argmax(axis=1)
        step_ns = core_ns.max(axis=1)
        by_phase[phase] = float(step_ns.sum() + times.barrier_ns * len(step_ns))
        numbers = np.array([core.number for core in program.cores_of(phase)])
        np.add.at(critical, numbers[slowest], step_ns)
    return Latency(sum(by_phase.values()), by_phase, int(critical.argmax()))


def step_times(program: ChipProgram, phase: str, steps: StepActivity, profile: Profile) -> StepTimes:
    """Return the times of every step and core of a phase: counts times times."""
    tiles = {program.chip.tile_of(core.slot) for core in program.cores_of(phase)}
    return StepTimes(
        work_ns={
            name: steps.count(name).astype(np.float64) * cost
            for name, cost in profile.time_ns.items()
            if name not in ("hops_x", "hops_y")
        },
        way_ns=_longest_way_ns(program, phase, profile) * (steps.count("hops") > 0),
        barrier_ns=profile.barrier_ns.ns(len(tiles), program.chip.mesh.tiles),
    )


def _longest_way_ns(program: ChipProgram, phase: str, profile: Profile) -> FloatArray:
    """Return the mesh time of the farthest destination of each core, (cores,)."""
    ways = []
    for core in program.cores_of(phase):
        hops = [program.chip.hops(core.slot, program.cores[to].slot) for to in np.unique(core.axons.out_core)]
        cost_x, cost_y = profile.time_ns.get("hops_x", 0.0), profile.time_ns.get("hops_y", 0.0)
        ways.append(max((x * cost_x + y * cost_y for x, y in hops), default=0.0))
    return np.array(ways)
