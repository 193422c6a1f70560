"""Entry of report.json on energy: total, spread, breakdowns, and each constant with its source.

Energy is broken down by recordings, classes, steps, cores and populations. Every breakdown adds up to the total; what
is counted without a step and a core is only in ``elsewhere_pj``.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

import hw_model as hw
from hw_model.accounting.activity import counted
from hw_model.description.counts import BY_CORE, Counts, total
from hw_model.program.chip_program import ChipProgram
from hw_model.program.pieces import pieces_of
from hw_model.targets import target_of
from hw_model.values import FloatArray, picked
from locsnn_compile.network.network import Network
from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.spread import by_core, course, spread
from locsnn_compile.verification.matching import Match

_PLACED = frozenset((*BY_CORE, "neuron_updates_inactive", "hops"))
"""Counts that are known for every step, core and population."""


def energy_entry(
    program: ChipProgram, match: Match, network: Network, step_seconds: float | None
) -> Document:
    """Return ``energy`` by the default profile of the chip; figures are means per recording, except for the spread.

    All of them are None for a chip without a profile.
    """
    name, profile = program.chip.default_profile, program.chip.costs
    counts, samples = total(match.counts), match.samples
    breakdown = _breakdown(counts, profile, samples)
    each = np.array([math.fsum(hw.energy_pj(one, profile).values()) for one in match.counts])
    pieces = _pieces_pj(program, match, profile)
    recording_ns = None if step_seconds is None else network.steps * step_seconds * 1e9
    static = _static(program, match, recording_ns, profile)
    by_branch = {
        phase: _breakdown(c, profile, samples) for phase, c in match.counts_by_phase.items()
    }
    others = {other: found for other, found in program.chip.profiles.items() if other != name}
    left_out = _left_out(counts, profile, samples, static)
    entry = {
        "profile": name,
        **picked(profile, "source", "basis", "voltage_v"),
        "per_sample_pj": math.fsum(breakdown.values()),
        "range_pj": _range_pj(counts, profile, samples),
        "breakdown_pj": breakdown,
        "by_branch_pj": {phase: math.fsum(its.values()) for phase, its in by_branch.items()},
        "by_branch_breakdown_pj": by_branch,
        "by_population_pj": _by_population(program, network, pieces),
        "by_core_pj": by_core(
            program, {phase: _cores_pj(program, phase, pj) for phase, pj in pieces.items()}
        ),
        "by_step_pj": {phase: course(found.sum(axis=1)) for phase, found in pieces.items()},
        "elsewhere_pj": math.fsum(pj for count, pj in breakdown.items() if count not in _PLACED),
        **spread(each, match, "pj"),
        "other_profiles_pj": {
            other: _energy_pj(counts, found, samples) for other, found in others.items()
        },
        "other_profiles_by_branch_pj": {
            other: {
                phase: _energy_pj(c, found, samples) for phase, c in match.counts_by_phase.items()
            }
            for other, found in others.items()
        },
        "static": static,
        "not_included": [item["what"] for item in left_out],
        "not_included_bounds": left_out,
        "profiles": {other: _constants(found) for other, found in program.chip.profiles.items()},
    }
    return entry if name else dict.fromkeys(entry)


def _breakdown(counts: Counts, profile: hw.Profile, samples: int) -> dict[str, float]:
    return {name: pj / samples for name, pj in hw.energy_pj(counts, profile).items()}


def _energy_pj(counts: Counts, profile: hw.Profile, samples: int) -> float:
    return math.fsum(_breakdown(counts, profile, samples).values())


def _range_pj(counts: Counts, profile: hw.Profile, samples: int) -> list[float | None]:
    """Return the least and the most of the mean energy; None if a constant that was used has no such bound."""

    def end(index: int) -> float | None:
        costs = {
            name: profile.energy_pj_range.get(name, (pj, pj))[index]
            for name, pj in profile.energy_pj.items()
        }
        if any(cost is None and counts[name] for name, cost in costs.items()):
            return None
        return math.fsum(counts[name] * (cost or 0.0) for name, cost in costs.items()) / samples

    return [end(0), end(1)]


def _pieces_pj(program: ChipProgram, match: Match, profile: hw.Profile) -> dict[str, FloatArray]:
    """Return the mean energy by phase, (steps, pieces)."""
    return {
        phase: sum(
            (
                counted(used.counts, name) * pj
                for name, pj in profile.energy_pj.items()
                if name in _PLACED
            ),
            start=np.zeros(used.counts["spikes"].shape),
        )
        / match.samples
        for phase, used in match.usage.items()
    }


def _by_population(
    program: ChipProgram, network: Network, pieces: dict[str, FloatArray]
) -> Document:
    """Return the energy of each population, and of its own and its joined groups of compartments."""
    names = [population.name for population in network.populations]
    found: Document = {name: {"pj": 0.0, "compartments": {}} for name in names}
    for phase, pj in pieces.items():
        for group, its in zip(
            pieces_of(program, phase).group, pj.sum(axis=0).tolist(), strict=True
        ):
            entry = found[_population_of(group, names)]
            entry["pj"] += its
            entry["compartments"][group] = entry["compartments"].get(group, 0.0) + its
    return found


def _population_of(group: str, names: Sequence[str]) -> str:
    """Return the population of a group of compartments: the same name, or the longest that it extends."""
    return (
        group
        if group in names
        else max((name for name in names if group.startswith(f"{name}/")), key=len)
    )


def _cores_pj(program: ChipProgram, phase: str, pj: FloatArray) -> list[Document]:
    its = np.add.reduceat(pj.sum(axis=0), pieces_of(program, phase).of_core[:-1])
    return [{"pj": value} for value in its.tolist()]


def _static(
    program: ChipProgram, match: Match, recording_ns: float | None, profile: hw.Profile
) -> Document | None:
    """Return the energy of whole chips at rest, over the time of the chip and over that of the sensor."""
    power = profile.static_power
    if power is None:
        return None
    is_timed = target_of(program.chip).timed
    chips = len({core.slot // program.chip.limits.cores_per_chip for core in program.cores})
    return {
        "chip_mw": power.chip_mw,
        "source": power.source,
        "chips": chips,
        "at_latency_pj": power.pj(chips, match.mean_ns) if is_timed else None,
        "at_real_time_pj": None if recording_ns is None else power.pj(chips, recording_ns),
    }


def _left_out(
    counts: Counts, profile: hw.Profile, samples: int, static: Document | None
) -> list[Document]:
    """Return what the energy leaves out, with an upper bound where one is known."""
    rows = []
    for item in profile.not_included:
        bound = (
            item.bound_recording_pj
            + math.fsum(counts[name] * pj for name, pj in item.bound_pj.items()) / samples
        )
        known = bool(item.bound_pj) or bound > 0
        rows.append({
            "what": item.what, "at_most_pj": bound if known else None, "bound_source": item.bound_source or None,
        })  # fmt: skip
    if static:
        what = f"static power ({static['chip_mw']:g} mW per chip, {static['source']})"
        bound = static["at_real_time_pj"]
        source = None if bound is None else "for as long as the sensor records"
        rows.append({"what": what, "at_most_pj": bound, "bound_source": source})
    return rows


def _constants(profile: hw.Profile) -> Document:
    """Return a profile with the source and the range of each constant."""
    names = dict.fromkeys((*profile.energy_pj, *profile.time_ns))
    return {
        **picked(profile, "source", "basis", "voltage_v"),
        "constants": [_constant(profile, name) for name in names],
        "barrier_ns": asdict(profile.barrier_ns),
    }


def _constant(profile: hw.Profile, name: str) -> Document:
    row: Document = {"count": name}
    for key in ("energy_pj", "time_ns"):
        ends = getattr(profile, f"{key}_range").get(name)
        row |= {
            key: getattr(profile, key).get(name),
            f"{key}_range": None if ends is None else list(ends),
        }
    return row | {"source": profile.source_of(name)}
