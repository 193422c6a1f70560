"""Entry of report.json on energy: total, spread, breakdowns, and each constant with its source.

Energy is broken down by recordings, classes, steps, cores and populations. Every breakdown adds up to the total; what
is counted without a step and a core is only in ``elsewhere_pj``.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np

import hw_model as hw
from hw_model.accounting.activity import counted
from hw_model.description.counts import BY_CORE, Counts, total
from hw_model.description.profile import Barrier
from hw_model.program.chip_program import ChipProgram
from hw_model.program.pieces import pieces_of
from hw_model.targets import target_of
from hw_model.values import FloatArray
from locsnn_compile.network.network import Network
from locsnn_compile.report.figures.entries import INLINED, Entry
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

_PLACED = frozenset((*BY_CORE, "neuron_updates_inactive", "hops"))
"""Counts that are known for every step, core and population."""


class PopulationEnergy(Entry):
    """The energy of a population, and of its own and its joined groups of compartments."""

    pj: float
    compartments: Mapping[str, float]


class CoreEnergy(Entry):
    """The energy of a core."""

    place: Annotated[Place, INLINED]
    pj: float


class CostliestEnergy(RecordingCost):
    """The recording that takes most energy."""

    pj: float

    @property
    def cost(self) -> float:
        """The energy in picojoules."""
        return self.pj


class ClassEnergy(ClassCost):
    """The energy of the recordings of a class."""

    min_pj: float
    mean_pj: float
    max_pj: float

    @property
    def ends(self) -> tuple[float, float, float]:
        """The least, the mean and the largest energy."""
        return self.min_pj, self.mean_pj, self.max_pj


class StaticEnergy(Entry):
    """The energy of whole chips at rest, over the time of the chip and over that of the sensor."""

    chip_mw: float
    source: str
    chips: int
    at_latency_pj: float | None
    at_real_time_pj: float | None


class NotIncluded(Entry):
    """Something that the energy leaves out, with an upper bound where one is known."""

    what: str
    at_most_pj: float | None
    bound_source: str | None


class ConstantFigures(Entry):
    """The energy and the time of an operation in a profile; an end of a range is None if it is not known."""

    count: str
    energy_pj: float | None
    energy_pj_range: Ends | None
    time_ns: float | None
    time_ns_range: Ends | None
    source: str


class ProfileFigures(Entry):
    """A profile with the source and the range of each constant."""

    source: str
    basis: str
    voltage_v: float | None
    constants: tuple[ConstantFigures, ...]
    barrier_ns: Barrier


class EnergyFigures(Entry):
    """``energy`` by the default profile of the chip; means per recording, except for the spread."""

    profile: str
    source: str
    basis: str
    voltage_v: float | None
    per_sample_pj: float
    range_pj: Ends
    breakdown_pj: Mapping[str, float]
    by_branch_pj: Mapping[str, float]
    by_branch_breakdown_pj: Mapping[str, Mapping[str, float]]
    by_population_pj: Mapping[str, PopulationEnergy]
    by_core_pj: tuple[CoreEnergy, ...]
    by_step_pj: Mapping[str, Course]
    elsewhere_pj: float
    over_samples_pj: Quantiles
    worst_recording: CostliestEnergy
    by_class: tuple[ClassEnergy, ...] | None
    other_profiles_pj: Mapping[str, float]
    other_profiles_by_branch_pj: Mapping[str, Mapping[str, float]]
    static: StaticEnergy | None
    not_included: tuple[str, ...]
    not_included_bounds: tuple[NotIncluded, ...]
    profiles: Mapping[str, ProfileFigures]


def energy_figures(
    program: ChipProgram, match: Match, network: Network, step_seconds: float | None
) -> EnergyFigures | None:
    """Return the energy by the default profile of the chip; None for a chip without a profile."""
    name, profile = program.chip.default_profile, program.chip.costs
    if name is None:
        return None
    counts, samples = total(match.counts), match.samples
    breakdown = _breakdown(counts, profile, samples)
    costs = np.array([math.fsum(hw.energy_pj(one, profile).values()) for one in match.counts])
    pieces = _pieces_pj(program, match, profile)
    recording_ns = None if step_seconds is None else network.steps * step_seconds * 1e9
    static = _static(program, match, recording_ns, profile)
    by_branch = {
        phase: _breakdown(of_phase, profile, samples)
        for phase, of_phase in match.counts_by_phase.items()
    }
    others = {other: costs for other, costs in program.chip.profiles.items() if other != name}
    left_out = rows_left_out(counts, profile, samples, static)
    return EnergyFigures(
        profile=name,
        source=profile.source,
        basis=profile.basis,
        voltage_v=profile.voltage_v,
        per_sample_pj=math.fsum(breakdown.values()),
        range_pj=_range_pj(counts, profile, samples),
        breakdown_pj=breakdown,
        by_branch_pj={phase: math.fsum(parts.values()) for phase, parts in by_branch.items()},
        by_branch_breakdown_pj=by_branch,
        by_population_pj=_by_population(program, network, pieces),
        by_core_pj=by_core(
            program,
            {phase: _cores_pj(program, phase, pj) for phase, pj in pieces.items()},
            CoreEnergy,
        ),
        by_step_pj={phase: course(pj.sum(axis=1)) for phase, pj in pieces.items()},
        elsewhere_pj=math.fsum(pj for count, pj in breakdown.items() if count not in _PLACED),
        over_samples_pj=quantiles(costs),
        worst_recording=worst_recording(costs, match.labels, CostliestEnergy),
        by_class=by_class(costs, match.labels, ClassEnergy),
        other_profiles_pj={
            other: _energy_pj(counts, priced, samples) for other, priced in others.items()
        },
        other_profiles_by_branch_pj={
            other: _by_branch_pj(match, priced) for other, priced in others.items()
        },
        static=static,
        not_included=tuple(item.what for item in left_out),
        not_included_bounds=left_out,
        profiles={other: _profile(priced) for other, priced in program.chip.profiles.items()},
    )


def _breakdown(counts: Counts, profile: hw.Profile, samples: int) -> dict[str, float]:
    return {name: pj / samples for name, pj in hw.energy_pj(counts, profile).items()}


def _energy_pj(counts: Counts, profile: hw.Profile, samples: int) -> float:
    return math.fsum(_breakdown(counts, profile, samples).values())


def _by_branch_pj(match: Match, profile: hw.Profile) -> dict[str, float]:
    return {
        phase: _energy_pj(counts, profile, match.samples)
        for phase, counts in match.counts_by_phase.items()
    }


def _range_pj(counts: Counts, profile: hw.Profile, samples: int) -> Ends:
    """Return the least and the most of the mean energy; None if a constant that was used has no such bound."""

    def end(index: int) -> float | None:
        costs = {
            name: profile.energy_pj_range.get(name, (pj, pj))[index]
            for name, pj in profile.energy_pj.items()
        }
        if any(cost is None and counts[name] for name, cost in costs.items()):
            return None
        return math.fsum(counts[name] * (cost or 0.0) for name, cost in costs.items()) / samples

    return end(0), end(1)


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
) -> dict[str, PopulationEnergy]:
    """Return the energy of each population by its groups of compartments."""
    names = [population.name for population in network.populations]
    sums = dict.fromkeys(names, 0.0)
    groups: dict[str, dict[str, float]] = {name: {} for name in names}
    for phase, pj in pieces.items():
        of_pieces = zip(pieces_of(program, phase).group, pj.sum(axis=0).tolist(), strict=True)
        for group, piece_pj in of_pieces:
            name = _population_of(group, names)
            sums[name] += piece_pj
            groups[name][group] = groups[name].get(group, 0.0) + piece_pj
    return {name: PopulationEnergy(sums[name], groups[name]) for name in names}


def _population_of(group: str, names: Sequence[str]) -> str:
    """Return the population of a group of compartments: the same name, or the longest that it extends."""
    return (
        group
        if group in names
        else max((name for name in names if group.startswith(f"{name}/")), key=len)
    )


def _cores_pj(program: ChipProgram, phase: str, pj: FloatArray) -> list[tuple[float]]:
    by_core = np.add.reduceat(pj.sum(axis=0), pieces_of(program, phase).of_core[:-1])
    return [(value,) for value in by_core.tolist()]


def _static(
    program: ChipProgram, match: Match, recording_ns: float | None, profile: hw.Profile
) -> StaticEnergy | None:
    power = profile.static_power
    if power is None:
        return None
    is_timed = target_of(program.chip).timed
    chips = len({core.slot // program.chip.limits.cores_per_chip for core in program.cores})
    return StaticEnergy(
        chip_mw=power.chip_mw,
        source=power.source,
        chips=chips,
        at_latency_pj=power.pj(chips, match.mean_ns) if is_timed else None,
        at_real_time_pj=None if recording_ns is None else power.pj(chips, recording_ns),
    )


def rows_left_out(
    counts: Counts, profile: hw.Profile, samples: int, static: StaticEnergy | None
) -> tuple[NotIncluded, ...]:
    """Return what the energy leaves out; static energy is left out of the dynamic one."""
    rows = []
    for item in profile.not_included:
        bound = (
            item.bound_recording_pj
            + math.fsum(counts[name] * pj for name, pj in item.bound_pj.items()) / samples
        )
        known = bool(item.bound_pj) or bound > 0
        rows.append(NotIncluded(item.what, bound if known else None, item.bound_source or None))
    if static is not None:
        what = f"static power ({static.chip_mw:g} mW per chip, {static.source})"
        at_rest = static.at_real_time_pj
        source = None if at_rest is None else "for as long as the sensor records"
        rows.append(NotIncluded(what, at_rest, source))
    return tuple(rows)


def _profile(profile: hw.Profile) -> ProfileFigures:
    names = dict.fromkeys((*profile.energy_pj, *profile.time_ns))
    return ProfileFigures(
        source=profile.source,
        basis=profile.basis,
        voltage_v=profile.voltage_v,
        constants=tuple(_constant(profile, name) for name in names),
        barrier_ns=profile.barrier_ns,
    )


def _constant(profile: hw.Profile, name: str) -> ConstantFigures:
    return ConstantFigures(
        count=name,
        energy_pj=profile.energy_pj.get(name),
        energy_pj_range=profile.energy_pj_range.get(name),
        time_ns=profile.time_ns.get(name),
        time_ns_range=profile.time_ns_range.get(name),
        source=profile.source_of(name),
    )
