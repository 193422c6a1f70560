"""Sums over recordings for the report: counts, packets and time by phase, step, piece, link and critical path.

A *piece* is the share of a group of compartments on one core, a *link* leads from a tile of the mesh
to its neighbour, and a *way* is the sequence of links from a piece to a core.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import Self

import numpy as np

from hw_model.accounting import cost
from hw_model.accounting.activity import StepActivity, stacked
from hw_model.description.profile import Profile
from hw_model.program.chip_program import ChipProgram
from hw_model.values import FloatArray, IntArray, Sums, added

MAX_TOGETHER = 1 << 21
"""Largest number of steps times ways that is held at a time, some 16 MiB per array; chosen by hand."""


class PhaseUsage(Sums, eq=False):
    """Sums over recordings in one phase.

    - ``counts[name]`` (steps, pieces), for each of :data:`hw_model.description.counts.BY_CORE`
    - ``link_packets`` (links,): packets on each link; ``link_most`` (links,): the most in one step of one recording
    - ``step_ns`` (steps,): the time of each step
    - ``parts_ns[part]``: time on critical paths, by :data:`hw_model.accounting.cost.PARTS`
    - ``busy_ns[part]`` (cores,): the work of each core, critical or not
    - ``paths_ns[sender, last]``: time of the steps in which core ``last`` finished last, after waiting for ``sender``
    """

    counts: Mapping[str, IntArray]
    link_packets: IntArray
    link_most: IntArray
    step_ns: FloatArray
    parts_ns: Mapping[str, float]
    busy_ns: Mapping[str, FloatArray]
    paths_ns: Mapping[tuple[int, int], float]

    def __add__(self, other: Self) -> Self:
        # All fields are sums except `link_most`, a maximum.
        return replace(
            super().__add__(other), link_most=np.maximum(self.link_most, other.link_most)
        )


def measure(
    program: ChipProgram, activity: Mapping[str, Sequence[StepActivity]], profile: Profile
) -> tuple[list[cost.Latency], dict[str, PhaseUsage]]:
    """Return the latency of each recording, and the sums over all recordings by phase.

    Recordings must be of equal length.
    """
    latencies: list[cost.Latency] = []
    usages = []
    for part in _parts(activity):
        steps = {phase: stacked(items) for phase, items in part.items()}
        times = {
            phase: cost.step_times(program, phase, of_phase, profile)
            for phase, of_phase in steps.items()
        }
        paths = {phase: cost.critical_path(of_phase) for phase, of_phase in times.items()}
        usages.append({phase: _usage(steps[phase], times[phase], paths[phase]) for phase in steps})
        recordings = len(next(iter(part.values())))
        for recording in range(recordings):
            path_by_phase = {phase: _path_of(path, recording) for phase, path in paths.items()}
            latencies.append(cost.recording_latency(program, path_by_phase))
    return latencies, reduce(added, usages)


def total_ns(
    program: ChipProgram,
    activity: Mapping[str, Sequence[StepActivity]],
    profile: Profile,
    part: str = "",
) -> float:
    """Return the total time of all recordings, in nanoseconds.

    With ``part``, only cores whose first group has a name that begins with it count, as if the others were not there.
    """
    total = 0.0
    for part_of_batch in _parts(activity):
        for phase, items in part_of_batch.items():
            in_part = [core.slices[0].group.startswith(part) for core in program.cores_of(phase)]
            if any(in_part):
                times = cost.step_times(program, phase, stacked(items), profile)
                total += float(
                    times.core_ns[..., in_part].max(axis=-1).sum()
                    + times.barrier_ns * times.runs.sum()
                )
    return total


def _parts(
    activity: Mapping[str, Sequence[StepActivity]],
) -> Iterator[dict[str, Sequence[StepActivity]]]:
    """Yield the recordings in parts that are small enough to hold step by step and way by way."""
    ways_of_recording = sum(
        items[0].packets.size + items[0].input_packets.size for items in activity.values()
    )
    recordings = len(next(iter(activity.values())))
    recordings_at_a_time = max(1, MAX_TOGETHER // ways_of_recording)
    for start in range(0, recordings, recordings_at_a_time):
        yield {
            phase: items[start : start + recordings_at_a_time] for phase, items in activity.items()
        }


def _usage(steps: StepActivity, times: cost.StepTimes, path: cost.CriticalPath) -> PhaseUsage:
    """Sum over :func:`stacked` recordings, (recordings, steps, ...)."""
    loads = steps.routes.loads(steps.packets)
    parts = {
        "updates": cost.UPDATES,
        "sending": cost.SENDING,
        "deliveries": cost.DELIVERIES,
        "synapses": cost.SYNAPSES,
    }
    return PhaseUsage(
        counts={name: counts.sum(axis=0) for name, counts in steps.by_piece.items()},
        link_packets=loads.sum(axis=(0, 1)),
        link_most=loads.max(axis=(0, 1), initial=0),
        step_ns=path.step_ns.sum(axis=0),
        parts_ns={part: float(ns.sum()) for part, ns in path.parts_ns.items()},
        busy_ns={part: times.of(counts).sum(axis=(0, 1)) for part, counts in parts.items()},
        paths_ns=_paths_ns(path),
    )


def _path_of(path: cost.CriticalPath, recording: int) -> cost.CriticalPath:
    """Return the critical path of one of the recordings."""
    parts_ns = {part: ns[recording] for part, ns in path.parts_ns.items()}
    return cost.CriticalPath(path.last[recording], path.sender[recording], parts_ns)


def _paths_ns(path: cost.CriticalPath) -> dict[tuple[int, int], float]:
    """Sum the time of steps by sender and last core."""
    cores = int(path.last.max()) + 1
    # A pair of cores as one number, so that numpy can group by it; `divmod` takes it apart again.
    pair_of_step = path.sender.ravel() * cores + path.last.ravel()
    pairs, index_of_pair = np.unique(pair_of_step, return_inverse=True)
    ns_of_pair = np.bincount(index_of_pair, weights=path.step_ns.ravel())
    paths_ns = {}
    for pair, ns in zip(pairs.tolist(), ns_of_pair.tolist(), strict=True):
        paths_ns[divmod(pair, cores)] = ns
    return paths_ns
