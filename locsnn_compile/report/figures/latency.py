"""The entry ``latency`` of report.json: total, spread, breakdowns, critical paths, links, and the pace of a sensor.

On a mesh, all cores wait for each other at the end of a step. So a step takes as long as the core that
finishes last, which may itself have waited for a packet of another core: its sender. Times are counts of
operations times the times of the chip's default profile.
"""

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
"""Critical paths that are listed, those that took most time; the number is chosen by hand."""


class CoreTime(Entry):
    """How long a core works, by the kind of work, and the time of the steps in which it finished last.

    Not all of ``busy_ns`` adds to the latency: other cores may work longer in the same step.
    """

    place: Annotated[Place, INLINED]
    busy_ns: Mapping[str, float]
    last_ns: float


class CriticalPath(Entry):
    """Two cores that decide how long steps take, by their numbers, and the total time of these steps.

    ``last`` is the core that finished last, ``sender`` the core whose packet it waited for, or ``last`` itself
    if it did not wait.
    """

    phase: str
    sender: int
    last: int
    ns: float


class LinkUse(Entry):
    """The packets on a link between neighbouring tiles of the mesh: per recording, and the most in a step."""

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
    def least_mean_largest(self) -> tuple[float, float, float]:
        """The least, the mean and the longest time."""
        return self.min_ns, self.mean_ns, self.max_ns


class MeanAndMost(Entry):
    """A time, as the mean and the most over the recordings."""

    mean: float
    max: float


class RealTime(Entry):
    """How the chip keeps up with a sensor whose steps last ``step_ns``.

    A factor is the sensor's time over the chip's: the chip keeps up where it is at least 1. ``factor`` is
    for the mean recording, the others for the slowest recording and the slowest step. A figure is None
    where the chip takes no time, or where its steps have no times of their own.
    """

    step_ns: float
    factor: float | None
    slowest_factor: float | None
    slowest_step_ns: float | None
    slowest_step_factor: float | None


class MeshTimes(Entry):
    """What the time of a recording on a mesh consists of.

    A branch is a phase of the program, and a part a kind of work on the critical path, such as updates of
    compartments or the barrier at the end of a step.
    """

    by_branch_ns: Mapping[str, float]
    by_part_ns: Mapping[str, float]
    by_branch_part_ns: Mapping[str, Mapping[str, float]]
    by_step_ns: Mapping[str, Course]
    by_core: tuple[CoreTime, ...]
    critical_paths: tuple[CriticalPath, ...]
    links: tuple[LinkUse, ...]


class LatencyFigures(Entry):
    """``latency`` by the default profile of the chip; means per recording, except in the fields on its spread.

    Some targets, such as the open core, have times of whole recordings only. What these consist of is
    unknown, so ``mesh``, ``critical_core`` and ``after_last_row_ns`` are None. ``timed`` is false, and all
    times 0, for a chip without any times. ``after_last_row_ns`` is the time from the last row of a
    recording to the answer.
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
    """Return the latency of recordings of ``steps`` steps, by the default profile of the chip."""
    chip = program.chip
    target = target_of(chip)
    recordings_ns = np.array([recording.total_ns for recording in match.latencies])
    step_ns = None if step_seconds is None else step_seconds * 1e9
    real_time = None
    if step_ns is not None:
        real_time = _real_time(match, steps, step_ns, float(recordings_ns.max()))
    return LatencyFigures(
        profile=chip.default_profile,
        basis=target.basis_of_times,
        timed=target.timed,
        per_sample_ns=match.mean_ns,
        per_sample_cycles=round(match.mean_ns * chip.clock_ghz),
        clock_ghz=chip.clock_ghz,
        range_ns=match.latency_range_ns,
        mesh=_mesh_times(program, match) if target.times_cores else None,
        over_samples_ns=quantiles(recordings_ns),
        worst_recording=worst_recording(recordings_ns, match.labels, SlowestTime),
        by_class=by_class(recordings_ns, match.labels, ClassTime),
        critical_core=_critical_core(match) if target.times_cores else None,
        recording_ns=None if step_ns is None else steps * step_ns,
        after_last_row_ns=_after_last_row(match) if target.times_cores else None,
        real_time=real_time,
    )


def _mesh_times(program: ChipProgram, match: Match) -> MeshTimes:
    """Return what the mean time of a recording consists of; ``match.usage`` has sums over all recordings."""
    samples = match.samples
    parts_by_branch = {
        phase: {part: ns / samples for part, ns in usage.parts_ns.items()}
        for phase, usage in match.usage.items()
    }
    return MeshTimes(
        by_branch_ns={phase: _mean_ns(match, phase) for phase in match.counts_by_phase},
        by_part_ns={
            part: math.fsum(parts_ns[part] for parts_ns in parts_by_branch.values())
            for part in PARTS
        },
        by_branch_part_ns=parts_by_branch,
        by_step_ns={phase: course(usage.step_ns / samples) for phase, usage in match.usage.items()},
        by_core=by_core(
            program,
            {phase: _cores_ns(usage, samples) for phase, usage in match.usage.items()},
            CoreTime,
        ),
        critical_paths=_critical_paths(program, match),
        links=_links(program, match),
    )


def _critical_core(match: Match) -> int:
    """Return the core that is critical in most recordings; of several, the one with the lowest number."""
    critical_cores = [recording.critical_core for recording in match.latencies]
    # ``max`` takes the first of equals, so sorting decides a tie by the number.
    return max(sorted(set(critical_cores)), key=critical_cores.count)


def _after_last_row(match: Match) -> MeanAndMost:
    times_ns = [recording.after_last_row_ns for recording in match.latencies]
    return MeanAndMost(float(np.mean(times_ns)), max(times_ns))


def _mean_ns(match: Match, phase: str) -> float:
    return float(np.mean([recording.by_phase_ns.get(phase, 0.0) for recording in match.latencies]))


def _cores_ns(usage: PhaseUsage, samples: int) -> Iterator[tuple[dict[str, float], float]]:
    """Yield for each core of a phase its work by parts, and the time of the steps in which it finished last."""
    cores = len(next(iter(usage.busy_ns.values())))
    for core in range(cores):
        last_ns = math.fsum(ns for (_, last), ns in usage.paths_ns.items() if last == core)
        busy_ns = {part: float(ns[core]) / samples for part, ns in usage.busy_ns.items()}
        yield busy_ns, last_ns / samples


def _critical_paths(program: ChipProgram, match: Match) -> tuple[CriticalPath, ...]:
    """Return the critical paths that took most time, those of all phases together."""
    paths = []
    for phase, usage in match.usage.items():
        # Usage counts the cores of its phase from 0; a report shows the numbers of the program.
        numbers = [core.number for core in program.cores_of(phase)]
        for (sender, last), ns in usage.paths_ns.items():
            paths.append(CriticalPath(phase, numbers[sender], numbers[last], ns / match.samples))
    slowest_first = sorted(paths, key=lambda path: path.ns, reverse=True)
    return tuple(slowest_first[:_PATHS])


def _links(program: ChipProgram, match: Match) -> tuple[LinkUse, ...]:
    """Return the packets on every link of the mesh that carried any."""
    uses = []
    for phase, usage in match.usage.items():
        links = routes_of(program, phase).links
        loads = zip(usage.link_packets.tolist(), usage.link_most.tolist(), strict=True)
        for (start, end), (packets, most_in_a_step) in zip(links, loads, strict=True):
            if packets:
                uses.append(LinkUse(phase, start, end, packets / match.samples, most_in_a_step))
    return tuple(uses)


def _real_time(match: Match, steps: int, step_ns: float, slowest_ns: float) -> RealTime:
    """Compare the pace of a sensor with the times of the chip; ``slowest_ns`` is that of the slowest recording."""
    slowest_step_ns = max(recording.slowest_step_ns for recording in match.latencies)
    mean_ns = match.mean_ns
    sensor_ns = steps * step_ns
    return RealTime(
        step_ns=step_ns,
        factor=sensor_ns / mean_ns if mean_ns else None,
        slowest_factor=sensor_ns / slowest_ns if slowest_ns else None,
        slowest_step_ns=slowest_step_ns or None,
        slowest_step_factor=step_ns / slowest_step_ns if slowest_step_ns else None,
    )
