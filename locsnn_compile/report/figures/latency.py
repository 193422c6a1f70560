"""Entry of report.json on latency: total, spread, breakdowns, critical paths, links, and the pace of a sensor."""

import math
from collections.abc import Iterator

import numpy as np

from hw_model.accounting.cost import PARTS
from hw_model.accounting.mesh_routes import routes_of
from hw_model.accounting.usage import PhaseUsage
from hw_model.program.chip_program import ChipProgram
from hw_model.targets import target_of
from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.spread import by_core, course, spread
from locsnn_compile.verification.matching import Match

_PATHS = 8
"""Critical paths that are listed: those that took most time."""
_OF_CORES = (
    "by_branch_ns", "by_part_ns", "by_branch_part_ns", "by_step_ns", "by_core", "critical_paths", "links",
    "critical_core", "after_last_row_ns",
)  # fmt: skip
"""Figures of the latency that need times of single cores and steps."""


def latency_entry(
    program: ChipProgram, match: Match, steps: int, step_seconds: float | None
) -> Document:
    """Return ``latency`` by the default profile of the chip; figures are means per recording, except for the spread.

    Where a target times whole recordings alone, it is not known what their times consist of.
    """
    chip, samples = program.chip, match.samples
    target = target_of(chip)
    each = np.array([one.total_ns for one in match.latencies])
    last = [one.critical_core for one in match.latencies]
    mean_ns = match.mean_ns
    step_ns = None if step_seconds is None else step_seconds * 1e9
    by_part = {
        phase: {part: ns / samples for part, ns in used.parts_ns.items()}
        for phase, used in match.usage.items()
    }
    after = [one.after_last_row_ns for one in match.latencies]
    entry = {
        "profile": chip.default_profile,
        "basis": target.basis_of_times,
        "timed": target.timed,
        "per_sample_ns": mean_ns,
        "per_sample_cycles": round(mean_ns * chip.clock_ghz),
        "clock_ghz": chip.clock_ghz,
        "range_ns": list(match.latency_range_ns),
        "by_branch_ns": {
            phase: float(np.mean([one.by_phase_ns.get(phase, 0.0) for one in match.latencies]))
            for phase in match.counts_by_phase
        },
        "by_part_ns": {
            part: math.fsum(found[part] for found in by_part.values()) for part in PARTS
        },
        "by_branch_part_ns": by_part,
        "by_step_ns": {
            phase: course(used.step_ns / samples) for phase, used in match.usage.items()
        },
        "by_core": by_core(
            program, {phase: _cores_ns(used, samples) for phase, used in match.usage.items()}
        ),
        "critical_paths": _critical_paths(program, match),
        "links": _links(program, match),
        **spread(each, match, "ns"),
        "critical_core": max(sorted(set(last)), key=last.count),
        "recording_ns": None if step_ns is None else steps * step_ns,
        "after_last_row_ns": {"mean": float(np.mean(after)), "max": max(after)},
        "real_time": None
        if step_ns is None
        else _real_time(match, steps, step_ns, mean_ns, float(each.max())),
    }
    return entry if target.times_cores else entry | dict.fromkeys(_OF_CORES)


def _cores_ns(used: PhaseUsage, samples: int) -> Iterator[Document]:
    """Yield how long each core works, whether or not anything waits for it, and how long it was the last."""
    for i in range(len(next(iter(used.busy_ns.values())))):
        last = math.fsum(ns for (_, to), ns in used.paths_ns.items() if to == i)
        busy = {part: float(ns[i]) / samples for part, ns in used.busy_ns.items()}
        yield {"busy_ns": busy, "last_ns": last / samples}


def _critical_paths(program: ChipProgram, match: Match) -> list[Document]:
    """Return which core was last and whose packet it waited for, with the time of the steps that this decided."""
    rows: list[Document] = []
    for phase, used in match.usage.items():
        numbers = [core.number for core in program.cores_of(phase)]
        for (sender, last), ns in used.paths_ns.items():
            rows.append(
                {
                    "phase": phase,
                    "sender": numbers[sender],
                    "last": numbers[last],
                    "ns": ns / match.samples,
                }
            )
    return sorted(rows, key=lambda row: row["ns"], reverse=True)[:_PATHS]


def _links(program: ChipProgram, match: Match) -> list[Document]:
    """Return the packets on every link of the mesh that carried any."""
    rows = []
    for phase, used in match.usage.items():
        links = routes_of(program, phase).links
        for (start, end), packets, most in zip(
            links, used.link_packets.tolist(), used.link_most.tolist(), strict=True
        ):
            if packets:
                load = {"packets": packets / match.samples, "most_in_a_step": most}
                rows.append({"phase": phase, "from": list(start), "to": list(end), **load})
    return rows


def _real_time(
    match: Match, steps: int, step_ns: float, mean_ns: float, most_ns: float
) -> Document:
    """Return how the chip keeps up with a sensor whose steps last ``step_ns``."""
    slowest = max(one.slowest_step_ns for one in match.latencies)
    return {
        "step_ns": step_ns,
        "factor": steps * step_ns / mean_ns if mean_ns else None,
        "slowest_factor": steps * step_ns / most_ns if most_ns else None,
        "slowest_step_ns": slowest or None,
        "slowest_step_factor": step_ns / slowest if slowest else None,
    }
