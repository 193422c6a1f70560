"""Entry of report.json on latency: total, spread, breakdowns, critical paths, links, and the pace of a sensor."""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated

import numpy as np

from hw_model.accounting.cost import PARTS
from hw_model.accounting.mesh_routes import routes_of
from hw_model.accounting.usage import PhaseUsage
from hw_model.program.chip_program import ChipProgram
from hw_model.targets import target_of
from locsnn_compile.report.figures.entries import INLINED, NULLS, Entry
from locsnn_compile.report.figures.spread import (
    ClassCost,
    Course,
    Ends,
    Place,
    Quantiles,
    RecordingCost,
    by_class,
    by_core,
    course,
    quantiles,
    worst_recording,
)
from locsnn_compile.verification.matching import Match

_PATHS = 8
"""Critical paths that are listed: those that took most time."""


class CoreTime(Entry):
    """How long a core works, whether or not anything waits for it, and how long it was the last."""

    place: Annotated[Place, INLINED]
    busy_ns: Mapping[str, float]
    last_ns: float


class CriticalPath(Entry):
    """Which core was last and whose packet it waited for, with the time of the steps that this decided."""

    phase: str
    sender: int
    last: int
    ns: float


class LinkUse(Entry):
    """The packets on a link of the mesh, from tile to tile."""

    phase: str
    from_: tuple[int, int]
    to: tuple[int, int]
    packets: float
    most_in_a_step: int


class SlowestTime(RecordingCost):
    """The recording that takes longest."""

    ns: float

    @property
    def cost(self) -> float:
        """The time in nanoseconds."""
        return self.ns


class ClassTime(ClassCost):
    """The time of the recordings of a class."""

    min_ns: float
    mean_ns: float
    max_ns: float

    @property
    def ends(self) -> tuple[float, float, float]:
        """The least, the mean and the longest time."""
        return self.min_ns, self.mean_ns, self.max_ns


class MeanAndMost(Entry):
    """A time, as the mean and the most over the recordings."""

    mean: float
    max: float


class RealTime(Entry):
    """How the chip keeps up with a sensor whose steps last ``step_ns``; None where it takes no time."""

    step_ns: float
    factor: float | None
    slowest_factor: float | None
    slowest_step_ns: float | None
    slowest_step_factor: float | None


class MeshTimes(Entry):
    """What the time of cores on a mesh consists of."""

    by_branch_ns: Mapping[str, float]
    by_part_ns: Mapping[str, float]
    by_branch_part_ns: Mapping[str, Mapping[str, float]]
    by_step_ns: Mapping[str, Course]
    by_core: tuple[CoreTime, ...]
    critical_paths: tuple[CriticalPath, ...]
    links: tuple[LinkUse, ...]


class LatencyFigures(Entry):
    """``latency`` by the default profile of the chip; means per recording, except for the spread.

    Where a target times whole recordings alone, it is not known what their times consist of:
    ``mesh``, the critical core and the time after the last row are None.
    """

    profile: str | None
    basis: str
    timed: bool
    per_sample_ns: float
    per_sample_cycles: int
    clock_ghz: float
    range_ns: Ends
    mesh: Annotated[MeshTimes | None, INLINED, NULLS]
    over_samples_ns: Quantiles
    worst_recording: SlowestTime
    by_class: tuple[ClassTime, ...] | None
    critical_core: int | None
    recording_ns: float | None
    after_last_row_ns: MeanAndMost | None
    real_time: RealTime | None


def latency_figures(
    program: ChipProgram, match: Match, steps: int, step_seconds: float | None
) -> LatencyFigures:
    """Return the latency by the default profile of the chip."""
    chip = program.chip
    target = target_of(chip)
    costs = np.array([recording.total_ns for recording in match.latencies])
    step_ns = None if step_seconds is None else step_seconds * 1e9
    real_time = None
    if step_ns is not None:
        real_time = _real_time(match, steps, step_ns, float(costs.max()))
    return LatencyFigures(
        profile=chip.default_profile,
        basis=target.basis_of_times,
        timed=target.timed,
        per_sample_ns=match.mean_ns,
        per_sample_cycles=round(match.mean_ns * chip.clock_ghz),
        clock_ghz=chip.clock_ghz,
        range_ns=match.latency_range_ns,
        mesh=_mesh_times(program, match) if target.times_cores else None,
        over_samples_ns=quantiles(costs),
        worst_recording=worst_recording(costs, match.labels, SlowestTime),
        by_class=by_class(costs, match.labels, ClassTime),
        critical_core=_critical_core(match) if target.times_cores else None,
        recording_ns=None if step_ns is None else steps * step_ns,
        after_last_row_ns=_after_last_row(match) if target.times_cores else None,
        real_time=real_time,
    )


def _mesh_times(program: ChipProgram, match: Match) -> MeshTimes:
    samples = match.samples
    by_part = {
        phase: {part: ns / samples for part, ns in used.parts_ns.items()}
        for phase, used in match.usage.items()
    }
    return MeshTimes(
        by_branch_ns={phase: _mean_ns(match, phase) for phase in match.counts_by_phase},
        by_part_ns={
            part: math.fsum(of_phase[part] for of_phase in by_part.values()) for part in PARTS
        },
        by_branch_part_ns=by_part,
        by_step_ns={phase: course(used.step_ns / samples) for phase, used in match.usage.items()},
        by_core=by_core(
            program,
            {phase: _cores_ns(used, samples) for phase, used in match.usage.items()},
            CoreTime,
        ),
        critical_paths=_critical_paths(program, match),
        links=_links(program, match),
    )


def _critical_core(match: Match) -> int:
    """Return the core that most recordings waited for; of several, the first."""
    last_cores = [recording.critical_core for recording in match.latencies]
    return max(sorted(set(last_cores)), key=last_cores.count)


def _after_last_row(match: Match) -> MeanAndMost:
    times = [recording.after_last_row_ns for recording in match.latencies]
    return MeanAndMost(float(np.mean(times)), max(times))


def _mean_ns(match: Match, phase: str) -> float:
    return float(np.mean([recording.by_phase_ns.get(phase, 0.0) for recording in match.latencies]))


def _cores_ns(used: PhaseUsage, samples: int) -> Iterator[tuple[dict[str, float], float]]:
    """Yield the work of each core by parts, and how long it was the last."""
    for i in range(len(next(iter(used.busy_ns.values())))):
        last = math.fsum(ns for (_, to), ns in used.paths_ns.items() if to == i)
        busy = {part: float(ns[i]) / samples for part, ns in used.busy_ns.items()}
        yield busy, last / samples


def _critical_paths(program: ChipProgram, match: Match) -> tuple[CriticalPath, ...]:
    paths = []
    for phase, used in match.usage.items():
        numbers = [core.number for core in program.cores_of(phase)]
        for (sender, last), ns in used.paths_ns.items():
            paths.append(CriticalPath(phase, numbers[sender], numbers[last], ns / match.samples))
    return tuple(sorted(paths, key=lambda path: path.ns, reverse=True)[:_PATHS])


def _links(program: ChipProgram, match: Match) -> tuple[LinkUse, ...]:
    """Return the packets on every link of the mesh that carried any."""
    uses = []
    for phase, used in match.usage.items():
        loads = zip(used.link_packets.tolist(), used.link_most.tolist(), strict=True)
        links = routes_of(program, phase).links
        for (start, end), (packets, most) in zip(links, loads, strict=True):
            if packets:
                uses.append(LinkUse(phase, start, end, packets / match.samples, most))
    return tuple(uses)


def _real_time(match: Match, steps: int, step_ns: float, most_ns: float) -> RealTime:
    slowest = max(recording.slowest_step_ns for recording in match.latencies)
    mean_ns = match.mean_ns
    return RealTime(
        step_ns=step_ns,
        factor=steps * step_ns / mean_ns if mean_ns else None,
        slowest_factor=steps * step_ns / most_ns if most_ns else None,
        slowest_step_ns=slowest or None,
        slowest_step_factor=step_ns / slowest if slowest else None,
    )
