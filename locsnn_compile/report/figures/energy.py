"""The entry ``energy`` of report.json: total, spread, breakdowns, and each constant with its source.

Energy is the sum of counts times costs: the simulator counts operations, and a profile of the chip has published costs
per operation. A chip can have several profiles. The first is its default, by which all breakdowns are made; of the
others, only totals are shown. Energy is broken down by operations, phases, populations, cores and steps (means per
recording), and over recordings and classes. Every breakdown adds up to the total; those by population, core and step do
with ``elsewhere_pj``, the energy of operations that are counted without a step and a core, such as input events.
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
"""Names of the counts that are known for every step, core and population. ``neuron_updates_inactive`` and ``hops`` are
not in ``BY_CORE`` because they are not kept: they are computed from counts that are."""


class PopulationEnergy(Entry):
    """The energy of a population, in all and by its groups of compartments, such as somata and dendrites."""

    pj: float
    compartments: Mapping[str, float]


class CoreEnergy(Entry):
    """The energy of a core. ``INLINED``: the keys of its place stand next to ``pj`` in report.json, without nesting."""

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
    def least_mean_largest(self) -> tuple[float, float, float]:
        """The least, the mean and the largest energy."""
        return self.min_pj, self.mean_pj, self.max_pj


class StaticEnergy(Entry):
    """The energy that whole chips take at rest, which is not part of the other figures.

    ``at_latency_pj`` is over the time that the chip takes for a recording, None if that is unknown;
    ``at_real_time_pj`` is over the time that the sensor takes, None if the length of a step is unknown.
    """

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
    """The energy and the time of an operation in a profile; an end of a range is None if unknown.

    ``count`` is the name of the operation: how often it happens is counted under this name.
    """

    count: str
    energy_pj: float | None
    energy_pj_range: Ends | None
    time_ns: float | None
    time_ns_range: Ends | None
    source: str


class ProfileFigures(Entry):
    """A profile (a set of published costs per operation), with the source and the range of each constant.

    ``basis`` says in words how the source has obtained its costs, such as by a simulation before silicon.
    ``barrier_ns`` is the time of the barrier at which all cores wait at the end of each step.
    """

    source: str
    basis: str
    voltage_v: float | None
    constants: tuple[ConstantFigures, ...]
    barrier_ns: Barrier


class EnergyFigures(Entry):
    """``energy`` by the default profile of the chip; means per recording, except in the fields on its spread.

    A branch is a phase of the program: its neurons step over time or over location. ``by_step_pj`` adds up
    the steps of a phase in bins. ``over_samples_pj`` is the spread over recordings. ``source``, ``basis`` and
    ``voltage_v`` are those of the default profile; ``profiles`` has all profiles of the chip, the default among them.
    """

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
    name = program.chip.default_profile
    if name is None:
        return None
    profile = program.chip.profile(name)
    counts = total(match.counts)
    samples = match.samples
    breakdown = _breakdown(counts, profile, samples)
    recordings_pj = np.array(
        [math.fsum(hw.energy_pj(recording, profile).values()) for recording in match.counts]
    )
    pieces_pj = _pieces_pj(program, match, profile)
    sensor_ns = None if step_seconds is None else network.steps * step_seconds * 1e9
    static = _static(program, match, sensor_ns, profile)
    by_branch = {
        phase: _breakdown(phase_counts, profile, samples)
        for phase, phase_counts in match.counts_by_phase.items()
    }
    other_profiles = {
        other_name: other
        for other_name, other in program.chip.profiles.items()
        if other_name != name
    }
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
        by_population_pj=_by_population(program, network, pieces_pj),
        by_core_pj=by_core(
            program,
            {phase: _cores_pj(program, phase, pj) for phase, pj in pieces_pj.items()},
            CoreEnergy,
        ),
        by_step_pj={phase: course(pj.sum(axis=1)) for phase, pj in pieces_pj.items()},
        elsewhere_pj=math.fsum(pj for count, pj in breakdown.items() if count not in _PLACED),
        over_samples_pj=quantiles(recordings_pj),
        worst_recording=worst_recording(recordings_pj, match.labels, CostliestEnergy),
        by_class=by_class(recordings_pj, match.labels, ClassEnergy),
        other_profiles_pj={
            other_name: _energy_pj(counts, other, samples)
            for other_name, other in other_profiles.items()
        },
        other_profiles_by_branch_pj={
            other_name: _by_branch_pj(match, other) for other_name, other in other_profiles.items()
        },
        static=static,
        not_included=tuple(item.what for item in left_out),
        not_included_bounds=left_out,
        profiles={
            any_name: _profile(any_profile)
            for any_name, any_profile in program.chip.profiles.items()
        },
    )


def _breakdown(counts: Counts, profile: hw.Profile, samples: int) -> dict[str, float]:
    """Return the mean energy per recording by operation, given the counts of all recordings together."""
    return {name: pj / samples for name, pj in hw.energy_pj(counts, profile).items()}


def _energy_pj(counts: Counts, profile: hw.Profile, samples: int) -> float:
    """Return the mean energy per recording, given the counts of all recordings together."""
    # fsum adds exactly, so the total does not depend on the order of the breakdown.
    return math.fsum(_breakdown(counts, profile, samples).values())


def _by_branch_pj(match: Match, profile: hw.Profile) -> dict[str, float]:
    return {
        phase: _energy_pj(counts, profile, match.samples)
        for phase, counts in match.counts_by_phase.items()
    }


def _range_pj(counts: Counts, profile: hw.Profile, samples: int) -> Ends:
    """Return the least and the most that the mean energy can be, given the ranges of the constants.

    An end is None if a constant that was used has a range without that end. A constant without a range
    is taken as exact.
    """
    least, most = 0, 1  # the two ends of a range, by their index
    return (
        _end_of_range_pj(counts, profile, samples, least),
        _end_of_range_pj(counts, profile, samples, most),
    )


def _end_of_range_pj(counts: Counts, profile: hw.Profile, samples: int, end: int) -> float | None:
    """Return the mean energy with every cost at one end of its range; None if the end of a cost is unknown."""
    parts_pj = []
    for name, exact_pj in profile.energy_pj.items():
        cost_pj = profile.energy_pj_range.get(name, (exact_pj, exact_pj))[end]
        if counts[name] == 0:
            # An operation that never happened costs nothing, whether or not its cost is known.
            continue
        if cost_pj is None:
            return None
        parts_pj.append(counts[name] * cost_pj)
    return math.fsum(parts_pj) / samples


def _pieces_pj(program: ChipProgram, match: Match, profile: hw.Profile) -> dict[str, FloatArray]:
    """Return the mean energy per recording by phase, arrays (steps, pieces).

    A piece is the part of a group of compartments that lies on one core. Nothing finer is counted.
    """
    by_phase = {}
    for phase, usage in match.usage.items():
        pj = np.zeros(usage.counts["spikes"].shape)
        for name, cost_pj in profile.energy_pj.items():
            if name in _PLACED:
                pj = pj + counted(usage.counts, name) * cost_pj
        by_phase[phase] = pj / match.samples
    return by_phase


def _by_population(
    program: ChipProgram, network: Network, pieces_pj: dict[str, FloatArray]
) -> dict[str, PopulationEnergy]:
    """Return the energy of each population by its groups of compartments."""
    names = [population.name for population in network.populations]
    sums_pj = dict.fromkeys(names, 0.0)
    groups_pj: dict[str, dict[str, float]] = {name: {} for name in names}
    for phase, pj in pieces_pj.items():
        groups = pieces_of(program, phase).group
        for group, piece_pj in zip(groups, pj.sum(axis=0).tolist(), strict=True):
            name = _population_of(group, names)
            sums_pj[name] += piece_pj
            groups_pj[name][group] = groups_pj[name].get(group, 0.0) + piece_pj
    return {name: PopulationEnergy(sums_pj[name], groups_pj[name]) for name in names}


def _population_of(group: str, names: Sequence[str]) -> str:
    """Return the population to which a group of compartments belongs.

    A group is named like its population, or begins with the population's name and a slash, such as
    ``hidden/dendrite``. Names of populations may hold slashes themselves, so the longest counts.
    """
    if group in names:
        return group
    return max((name for name in names if group.startswith(f"{name}/")), key=len)


def _cores_pj(program: ChipProgram, phase: str, pj: FloatArray) -> list[tuple[float]]:
    """Return the energy of each core of a phase, in tuples as :func:`by_core` takes them."""
    # ``of_core`` has the first piece of each core, and at its end the number of pieces.
    first_pieces = pieces_of(program, phase).of_core[:-1]
    cores_pj = np.add.reduceat(pj.sum(axis=0), first_pieces)
    return [(core_pj,) for core_pj in cores_pj.tolist()]


def _static(
    program: ChipProgram, match: Match, sensor_ns: float | None, profile: hw.Profile
) -> StaticEnergy | None:
    """Return the energy at rest; None if the profile has no static power.

    ``sensor_ns`` is the time that the sensor takes for a recording. A chip counts in full once any of
    its cores is in use.
    """
    power = profile.static_power
    if power is None:
        return None
    # Without times of operations, ``match.mean_ns`` is not the time that a recording takes.
    is_timed = target_of(program.chip).timed
    # The slot of a core counts through all cores of the board, chip by chip.
    chips = len({core.slot // program.chip.limits.cores_per_chip for core in program.cores})
    return StaticEnergy(
        chip_mw=power.chip_mw,
        source=power.source,
        chips=chips,
        at_latency_pj=power.pj(chips, match.mean_ns) if is_timed else None,
        at_real_time_pj=None if sensor_ns is None else power.pj(chips, sensor_ns),
    )


def rows_left_out(
    counts: Counts, profile: hw.Profile, samples: int, static: StaticEnergy | None
) -> tuple[NotIncluded, ...]:
    """Return what the energy leaves out: what the profile does not price, and the energy at rest, if known."""
    rows = []
    for item in profile.not_included:
        # A profile bounds what it leaves out by picojoules for each unit of some counts, plus some for each recording.
        bound_by_count = item.bound_pj
        counted_pj = math.fsum(counts[name] * pj for name, pj in bound_by_count.items()) / samples
        at_most_pj = item.bound_recording_pj + counted_pj
        # Without bounds in the profile, the sum is 0, which is not a bound.
        has_bound = bool(bound_by_count) or at_most_pj > 0
        rows.append(
            NotIncluded(
                what=item.what,
                at_most_pj=at_most_pj if has_bound else None,
                bound_source=item.bound_source or None,
            )
        )
    if static is not None:
        what = f"static power ({static.chip_mw:g} mW per chip, {static.source})"
        at_rest = static.at_real_time_pj
        source = None if at_rest is None else "for as long as the sensor records"
        rows.append(NotIncluded(what, at_rest, source))
    return tuple(rows)


def _profile(profile: hw.Profile) -> ProfileFigures:
    # Each operation once, in order (dict.fromkeys drops repeats): an operation may have an energy, a time or both.
    names = dict.fromkeys((*profile.energy_pj, *profile.time_ns))
    return ProfileFigures(
        source=profile.source,
        basis=profile.basis,
        voltage_v=profile.voltage_v,
        constants=tuple(_constant(profile, name) for name in names),
        barrier_ns=profile.barrier_ns,
    )


def _constant(profile: hw.Profile, name: str) -> ConstantFigures:
    """Return what one operation costs in energy and time, with the ranges that its source gives."""
    return ConstantFigures(
        count=name,
        energy_pj=profile.energy_pj.get(name),
        energy_pj_range=profile.energy_pj_range.get(name),
        time_ns=profile.time_ns.get(name),
        time_ns_range=profile.time_ns_range.get(name),
        source=profile.source_of(name),
    )
