"""Tables and plots that the sections on energy and on time share.

They show the spread over recordings and classes, breakdowns, the course over the steps, and the constants of
profiles (published costs per operation) with their sources.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

from hw_model.values import Frozen
from locsnn_compile.report.content import Bar, Cell, Curve, Fact, Plot, Span, Stack, Table
from locsnn_compile.report.figures.energy import ConstantFigures, EnergyFigures, ProfileFigures
from locsnn_compile.report.figures.latency import LatencyFigures
from locsnn_compile.report.figures.spread import (
    ClassCost,
    Course,
    Ends,
    Place,
    Quantiles,
    RecordingCost,
)
from locsnn_compile.report.format import NONE, count, energy, share, time
from locsnn_compile.report.pictures.axis import Axis, linear_axis, round_numbers
from locsnn_compile.report.words import share_of, words

Shown = Callable[[float], str]
"""A function that writes a number with its unit, such as :func:`energy` or :func:`time`."""
PARTS = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Shares of all steps after which a table gives a figure."""


def core_words(place: Place) -> str:
    """Return the name of a core: its number and its branch."""
    return f"core {place.core}, {words(place.phase)}"


class Cost(Frozen):
    """The energy or the time of a recording: its name, the function that writes it, and how it spreads.

    ``range_of_mean`` is how uncertain the mean is, given the ranges of the constants of the profile.
    """

    name: str
    shown: Shown
    profile: str | None
    mean: float
    range_of_mean: Ends
    over_recordings: Quantiles
    worst: RecordingCost
    classes: Sequence[ClassCost]
    class_names: tuple[str, ...] | None

    def span(self) -> Span:
        """Return the least, median, mean and largest cost, as words and as marks on an axis."""
        spread = self.over_recordings
        marks = {
            "least": spread.min,
            "median": spread.p50,
            "mean": self.mean,
            "most": spread.max,
        }
        facts = tuple(Fact(label, self.shown(value)) for label, value in marks.items())
        values = tuple(marks.values())
        axis = linear_axis(values, self.shown)
        return Span(f"{self.name} per recording{self._by_profile}", facts, values, axis)

    def facts(self) -> dict[str, str]:
        """Return the range of the mean and the costliest recordings in words."""
        worst = self.worst
        of_class = "" if worst.class_ is None else f" of class {self._class_name(worst.class_)}"
        return {
            "range of the mean": _range(self.range_of_mean, self.shown),
            "99 % of recordings": f"at most {self.shown(self.over_recordings.p99)}",
            "worst recording": f"recording {worst.recording}{of_class}, {self.shown(worst.cost)}",
        }

    def by_class(self) -> Table | None:
        """Return a table by class; None if the recordings have no labels."""
        if not self.classes:
            return None
        largest = max(max(class_cost.least_mean_largest) for class_cost in self.classes)
        return Table(
            f"{self.name} by class{self._by_profile}",
            ("class", "", "recordings", "mean", "least", "most"),
            tuple(self._class_row(class_cost, largest) for class_cost in self.classes),
        )

    def _class_row(self, class_cost: ClassCost, largest: float) -> tuple[Cell, ...]:
        least, mean, most = class_cost.least_mean_largest
        return (
            self._class_name(class_cost.class_),
            Bar(share_of(mean, largest), f"mean {self.shown(mean)}"),
            count(class_cost.recordings),
            self.shown(mean),
            self.shown(least),
            self.shown(most),
        )

    @property
    def _by_profile(self) -> str:
        return f", profile {self.profile}" if self.profile else ""

    def _class_name(self, number: int) -> str:
        """Return the name of a class, or else its number."""
        return self.class_names[number] if self.class_names else count(number)


def energy_cost(figures: EnergyFigures, class_names: tuple[str, ...] | None) -> Cost:
    """Return the energy of a recording, as the tables of this module take it."""
    return Cost(
        name="Energy",
        shown=energy,
        profile=figures.profile,
        mean=figures.per_sample_pj,
        range_of_mean=figures.range_pj,
        over_recordings=figures.over_samples_pj,
        worst=figures.worst_recording,
        classes=figures.by_class or (),
        class_names=class_names,
    )


def time_cost(figures: LatencyFigures, class_names: tuple[str, ...] | None) -> Cost:
    """Return the time of a recording, as the tables of this module take it."""
    return Cost(
        name="Time",
        shown=time,
        profile=figures.profile,
        mean=figures.per_sample_ns,
        range_of_mean=figures.range_ns,
        over_recordings=figures.over_samples_ns,
        worst=figures.worst_recording,
        classes=figures.by_class or (),
        class_names=class_names,
    )


def energy_course(figures: EnergyFigures) -> tuple[Plot, Table]:
    """Return a plot of the energy over the steps of each branch, and a table of the same."""
    return _course("Energy", figures.by_step_pj, energy, figures.profile)


def time_course(by_step_ns: Mapping[str, Course], profile: str | None) -> tuple[Plot, Table]:
    """Return a plot of the time over the steps of each branch, and a table of the same."""
    return _course("Time", by_step_ns, time, profile)


def _course(
    name: str, by_step: Mapping[str, Course], shown: Shown, profile: str | None
) -> tuple[Plot, Table]:
    """Return a plot of the mean cost per step in each bin, and a table of the cost so far.

    Branches have different numbers of steps, so their common axis is the share of a branch's steps.
    """
    costs_by_branch = {branch: _per_step(course) for branch, course in by_step.items()}
    all_costs = [cost for costs in costs_by_branch.values() for cost in costs]
    # An axis needs an end above 0 even if nothing costs anything.
    largest = max(all_costs, default=0.0) or 1.0
    # The horizontal axis already marks 0.
    ticks = tuple(tick for tick in round_numbers(low=0.0, high=largest, about=4) if tick)
    plot = Plot(
        title=f"{name} of a step, mean over the recordings, profile {profile}",
        x_label="part of the branch's steps",
        x=Axis(low=0.0, high=1.0, ticks=(0.0, *PARTS), text=lambda part: f"{100 * part:.0f} %"),
        y=Axis(0.0, largest, ticks, shown),
        curves=tuple(
            _curve(branch, costs, len(by_step[branch].bins))
            for branch, costs in costs_by_branch.items()
        ),
    )
    table = Table(
        f"{name} after a part of the steps, mean per recording, profile {profile}",
        ("branch", *(f"{100 * part:.0f} % of its steps" for part in PARTS)),
        tuple((words(branch), *_so_far(course.bins, shown)) for branch, course in by_step.items()),
    )
    return plot, table


def _curve(branch: str, costs: Sequence[float], bins: int) -> Curve:
    """Return the curve through the costs of bins, each drawn at the middle of its bin."""
    points = (((i + 0.5) / bins, cost) for i, cost in enumerate(costs))
    return Curve(words(branch), tuple(points))


def _so_far(bins: Sequence[float], shown: Shown) -> list[str]:
    """Return the cost after each of ``PARTS`` of the bins."""
    return [shown(math.fsum(bins[: round(part * len(bins))])) for part in PARTS]


def _per_step(course: Course) -> list[float]:
    """Return the mean cost per step in each bin.

    The last bin is left out where bins have several steps, because it may have fewer than the others; a
    course of a single bin is kept.
    """
    full_bins = course.bins[:-1] if course.bin_steps > 1 else course.bins
    return [value / course.bin_steps for value in full_bins or course.bins]


def stack(breakdown: Mapping[str, float], label: str) -> Stack:
    """Return the parts of an energy as one bar, cut into shares."""
    total = math.fsum(breakdown.values())
    bars = []
    # Parts without energy are left out of the bar, but keep their number, so that a part has the same
    # pattern here and in the table of :func:`shares`.
    for pattern, (name, pj) in enumerate(breakdown.items()):
        if pj:
            part = share_of(pj, total)
            bars.append(Bar(part, f"{words(name)} {share(part)}", pattern))
    return Stack(label, tuple(bars))


def shares(
    heading: str, caption: str, parts: Iterable[tuple[str, float]], *, patterned: bool = False
) -> Table:
    """Return a table of parts of an energy with their sum.

    ``heading`` is that of the column of names. ``patterned``: bars are hatched like those of :func:`stack`.
    """
    energies = list(parts)
    total_pj = math.fsum(pj for _, pj in energies)
    rows: list[tuple[Cell, ...]] = []
    for i, (name, pj) in enumerate(energies):
        part = share_of(pj, total_pj)
        bar = Bar(part, f"{share(part)} of energy", i if patterned else 0)
        rows.append((name, bar, energy(pj), share(part)))
    # All parts are 100 % of the sum, unless nothing takes any energy.
    share_of_all = float(total_pj > 0)
    rows.append(("sum", "", energy(total_pj), share(share_of_all)))
    return Table(caption, (heading, "", "energy", "share"), tuple(rows), total=True)


def by_branch(columns: Mapping[str, Mapping[str, float]], caption: str, shown: Shown) -> Table:
    """Return ``columns[heading][branch]`` as a table: a row per branch, and the sum as the last row."""
    branches = next(iter(columns.values()))
    rows = [
        (words(branch), *(shown(column[branch]) for column in columns.values()))
        for branch in branches
    ]
    rows.append(("sum", *(shown(math.fsum(column.values())) for column in columns.values())))
    return Table(caption, ("branch", *columns), tuple(rows), total=True)


def constants(name: str, profile: ProfileFigures) -> Table:
    """Return a table of the constants of a profile with their ranges and sources."""
    voltage = "voltage not stated" if profile.voltage_v is None else f"{profile.voltage_v:g} V"
    barrier = profile.barrier_ns
    ends = f"{barrier.one_tile:g} ns in one tile to {barrier.all_tiles:g} ns in all"
    rows = [_constant_row(constant) for constant in profile.constants]
    rows.append(("barrier, per step", NONE, ends, profile.source))
    return Table(
        f"Constants of profile {name}: {profile.basis}; {voltage}",
        ("operation", "energy", "time", "source"),
        tuple(rows),
        folded=True,
    )


def _constant_row(constant: ConstantFigures) -> tuple[str, str, str, str]:
    return (
        words(constant.count),
        _constant(constant.energy_pj, constant.energy_pj_range, "pJ"),
        _constant(constant.time_ns, constant.time_ns_range, "ns"),
        constant.source,
    )


def _range(ends: Ends, shown: Shown) -> str:
    """Return the range of a mean in words; None is an unknown end."""
    low, high = ends
    if low is None:
        if high is None:
            return "not known"
        return f"{shown(high)} or less: a constant is given as an upper bound"
    if high is None:
        return f"{shown(low)} or more: a constant is given as a lower bound"
    if low == high:
        return "none: no constant is given as a range"
    return f"{shown(low)} to {shown(high)}"


def _constant(value: float | None, ends: Ends | None, unit: str) -> str:
    """Return a constant with its range in words; a source may give only an upper or a lower bound."""
    if value is None:
        return NONE
    if ends is None:
        return f"{value:g} {unit}"
    low, high = ends
    if low is None:
        return f"at most {value:g} {unit}"
    if high is None:
        return f"at least {value:g} {unit}"
    return f"{value:g} {unit} ({low:g} to {high:g})"
