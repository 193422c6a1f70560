"""Sections on what a recording costs: energy and latency.

For a mesh of cores both are models, counts times published costs. For the open core the cycles are exact,
and where no energy is known, its activity (memory accesses and multiplications) is shown instead.
"""

from collections.abc import Iterator, Mapping, Sequence

from locsnn_compile.report.content import (
    Bar,
    Block,
    Cell,
    Fact,
    Facts,
    Folded,
    Section,
    Table,
    Verdict,
)
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.energy import EnergyFigures, NotIncluded, StaticEnergy
from locsnn_compile.report.figures.latency import (
    CoreTime,
    CriticalPath,
    LatencyFigures,
    LinkUse,
    MeshTimes,
)
from locsnn_compile.report.format import (
    any_value,
    count,
    energy,
    known,
    plural,
    ratio,
    share,
    time,
)
from locsnn_compile.report.sections.bounds import bounds_table
from locsnn_compile.report.sections.cost_tables import (
    by_branch,
    constants,
    core_words,
    energy_cost,
    shares,
    stack,
    time_cost,
)
from locsnn_compile.report.sections.verdict import (
    against_anns,
    against_real_time,
    counts_cores,
    pace,
)
from locsnn_compile.report.sections.worst_time import slowest_step
from locsnn_compile.report.words import share_of, words

_ENERGY = (
    "The chip's counts times the cost of each operation in a profile. "
    "This is a model; no board was used."
)
_LATENCY = (
    "A step ends with a barrier, once the last core is done. A core updates its compartments and "
    "sends packets; when its last packet has arrived, over links of the mesh that pass one at a time, "
    "it receives them all and adds up their synapses. The branches run one after the other. Host "
    "input is not included. This is a model; no board was used."
)
_ACTIVITY = (
    "What the open core does per recording, on average: the simulator's counts, and the memory "
    "accesses that follow from them."
)
_NO_JOULES = "There are no joules, because no power model of such devices is public."
_CYCLES = (
    "Cycles of the open core from the first word that it accepts to the class, with a host that is "
    "always ready. They are predicted exactly: the command locsnn rtl sim compares them with the core "
    "itself. Nothing ran on a board."
)


def energy_section(report: ReportFigures, figures: EnergyFigures) -> Section:
    """Return the section on energy per recording: spread, breakdowns, static energy, constants, what is left out."""
    cost = energy_cost(figures, report.classes)
    return Section.of(
        "energy",
        "Energy",
        _ENERGY,
        cost.span(),
        Facts.of(cost.facts()),
        stack(figures.breakdown_pj, f"Where the energy goes, profile {figures.profile}"),
        _by_operation(figures),
        Folded.of(
            "Energy by branch, population, core and class",
            *_by_place(figures, of_cores=counts_cores(report)),
            cost.by_class(),
        ),
        Folded.of(
            "Static energy, and what is not included",
            *_static(figures.static),
            _not_included(figures.not_included_bounds),
        ),
        Folded.of(
            "Constants of the profiles, with their sources",
            *(constants(name, profile) for name, profile in figures.profiles.items()),
        ),
    )


def _by_operation(figures: EnergyFigures) -> Table:
    caption = f"Energy by operation, mean per recording, profile {figures.profile}"
    operations = [(words(name), pj) for name, pj in figures.breakdown_pj.items()]
    return shares("operation", caption, operations, patterned=True)


def _by_place(figures: EnergyFigures, *, of_cores: bool) -> Iterator[Table]:
    """Yield the energy by branch and population and, where there are several, by core."""
    profile = figures.profile
    mean = f"mean per recording, profile {profile}"
    branches_by_profile = {profile: figures.by_branch_pj, **figures.other_profiles_by_branch_pj}
    # A row of its own, so that every table adds up to the whole energy.
    elsewhere = []
    if figures.elsewhere_pj:
        elsewhere.append(("outside the cores", figures.elsewhere_pj))
    populations = [(name, population.pj) for name, population in figures.by_population_pj.items()]
    cores = [(core_words(core.place), core.pj) for core in figures.by_core_pj]
    yield by_branch(branches_by_profile, "Energy by branch and profile, mean per recording", energy)
    yield shares(
        "population",
        f"Energy by population, including its dendrites, {mean}",
        populations + elsewhere,
    )
    if of_cores:
        yield shares("core", f"Energy by core, {mean}", cores + elsewhere)


def _about_static(static: StaticEnergy) -> str:
    return (
        "The figures above do not include static energy. Static power is "
        f"{static.chip_mw:g} mW per chip ({static.source}) on {plural(static.chips, 'chip')}; the "
        "table gives its energy while the chip works, and for as long as the sensor records."
    )


def _static(static: StaticEnergy | None) -> tuple[Block, ...]:
    """Return the static energy, as a sentence and a table; nothing where it is not known."""
    if static is None:
        return ()
    table = Table(
        "Static energy per recording",
        ("how long", "energy"),
        (
            ("while the chip works", known(static.at_latency_pj, energy, "not known")),
            ("while the sensor records", known(static.at_real_time_pj, energy, "not known")),
        ),
    )
    return _about_static(static), table


def _not_included(bounds: Sequence[NotIncluded]) -> Table | None:
    """Return what the energy leaves out, each with an upper bound if there is one."""
    if not bounds:
        return None
    return Table(
        "Not included in the energy",
        ("what", "upper bound", "basis"),
        tuple(
            (item.what, known(item.at_most_pj, energy, "not known"), any_value(item.bound_source))
            for item in bounds
        ),
    )


def latency_section(report: ReportFigures, mesh: MeshTimes) -> Section:
    """Return the section on time per recording: spread, breakdown, which core waits for which, pace of the sensor."""
    figures = report.latency
    profile = figures.profile
    if not figures.timed:
        # The packets on links are counted, not timed, so they are known all the same.
        lead = (
            f"Not known, as profile {profile} has no times of operations: "
            "only barriers and the buffer are timed."
        )
        return Section.of("latency", "Latency", lead, _links(mesh.links))
    cost = time_cost(figures, report.classes)
    mean_ns = figures.per_sample_ns
    return Section.of(
        "latency",
        "Latency",
        _LATENCY,
        cost.span(),
        real_time(figures),
        bounds_table(report.bounds),
        Facts.of(_facts_of_latency(figures, cost.facts())),
        Folded.of(
            "Time by branch, core, link and class",
            by_branch(
                _parts(mesh),
                f"Time by branch and part, mean per recording, profile {profile}",
                time,
            ),
            _critical_paths(mesh.critical_paths, mean_ns),
            _cores(mesh.by_core, mean_ns) if mesh.by_core else None,
            _links(mesh.links),
            cost.by_class(),
        ),
    )


def _facts_of_latency(figures: LatencyFigures, spread: Mapping[str, str]) -> dict[str, str | None]:
    """Return the time of a recording in short facts, in the order in which the report has them."""
    after_last_row = figures.after_last_row_ns
    facts: dict[str, str | None] = {
        "cycles": f"{count(figures.per_sample_cycles)} per recording, at {figures.clock_ghz:g} GHz",
        **spread,
    }
    if figures.critical_core is not None:
        core = f"core {count(figures.critical_core)}"
        facts["critical core"] = f"{core}, which finished last for the largest share of the time"
    if after_last_row is not None:
        facts["after the last row"] = (
            f"{time(after_last_row.mean)}, at most {time(after_last_row.max)}"
        )
    if figures.real_time is not None:
        facts["slowest step of a row"] = slowest_step(figures.real_time)
    return facts


def real_time(figures: LatencyFigures) -> str:
    """Compare the time that the chip takes with the duration of the recordings."""
    duration_ns = figures.recording_ns
    if duration_ns is None:
        return "How long a step lasts is not known, so there is no comparison with real time."
    mean = pace(figures.per_sample_ns, duration_ns)
    slowest = pace(figures.over_samples_ns.max, duration_ns)
    return (
        f"On average {mean}; in the slowest recording {slowest}. The chip runs its steps as fast as "
        "it can, without waiting for the next touch."
    )


def _critical_paths(paths: Sequence[CriticalPath], mean_ns: float) -> Table:
    """Return which core finished last and whose packets it waited for; ``mean_ns`` is the time of a recording."""
    rows = []
    for path in paths:
        # A core that waits for nobody is its own sender.
        awaited = "nothing" if path.sender == path.last else f"packets of core {path.sender}"
        share_of_time = share(share_of(path.ns, mean_ns))
        rows.append((words(path.phase), f"core {path.last}", awaited, time(path.ns), share_of_time))
    return Table(
        "What steps waited for, sorted by time",
        ("branch", "done last", "waited for", "time", "share"),
        tuple(rows),
    )


def _parts(mesh: MeshTimes) -> dict[str, Mapping[str, float]]:
    """Return the time of each branch by the kinds of work that take any time, and in all; a column for each."""
    columns: dict[str, Mapping[str, float]] = {}
    for part, ns in mesh.by_part_ns.items():
        if ns:
            columns[words(part)] = {
                branch: parts_ns[part] for branch, parts_ns in mesh.by_branch_part_ns.items()
            }
    columns["all"] = mesh.by_branch_ns
    return columns


def _cores(cores: Sequence[CoreTime], mean_ns: float) -> Table:
    """Return what each core works on, and in how much of the mean time of a recording it finished last."""
    parts = list(cores[0].busy_ns)
    rows: list[tuple[Cell, ...]] = []
    for core in cores:
        last = time(core.last_ns)
        bar = Bar(share_of(core.last_ns, mean_ns), f"done last in {last}")
        busy = (time(core.busy_ns[part]) for part in parts)
        rows.append((core_words(core.place), bar, *busy, last))
    return Table(
        "What each core works on, mean per recording",
        ("core", "", *(words(part) for part in parts), "done last in"),
        tuple(rows),
    )


def _links(links: Sequence[LinkUse]) -> Table | None:
    """Return the links of the mesh, each with a bar of its share of the busiest one."""
    if not links:
        return None
    largest = max(link.packets for link in links)
    return Table(
        "Packets on the links of the mesh, mean per recording",
        ("link, from tile to tile", "", "branch", "packets", "most in a step"),
        tuple(
            (
                f"{link.from_[0]},{link.from_[1]} to {link.to[0]},{link.to[1]}",
                Bar(link.packets / largest, plural(link.packets, "packet")),
                words(link.phase),
                count(link.packets),
                count(link.most_in_a_step),
            )
            for link in links
        ),
    )


def cycles(report: ReportFigures) -> Verdict:
    """What does a recording cost on the open core, where cycles are known but energy is not?"""
    figures = report.latency
    spread = figures.over_samples_ns
    per_recording = f"{count(figures.per_sample_cycles)} cycles"
    duration = time(figures.per_sample_ns)
    facts = (
        Fact("range", f"{time(spread.min)} to {time(spread.max)}, median {time(spread.p50)}"),
        Fact("latency", f"{duration}{against_real_time(figures)}"),
        Fact("energy", "not known, because no power model of such devices is public"),
    )
    return Verdict(
        question="What does it cost?",
        status="modelled",
        answer="Cycles exact, energy not known",
        figure=per_recording,
        figure_label=f"per recording on the open core of {report.target}",
        sentence=f"A recording takes {per_recording} on the open core, {duration} at "
        f"{1000 * figures.clock_ghz:g} MHz.",
        facts=(*facts, *against_anns(report)),
    )


def activity_section(report: ReportFigures, activity: Mapping[str, Mapping[str, float]]) -> Section:
    """Return the section on memory accesses and multiplications of the open core, by kind and by memory."""
    rows = []
    for kind, numbers in activity.items():
        for memory, number in numbers.items():
            rows.append((words(kind), words(memory), count(number)))
    table = Table("Activity, mean per recording", ("what", "of", "number"), tuple(rows))
    if report.energy is not None:
        return Section.of("activity", "Activity", _ACTIVITY, table)
    # Without a section on energy, this one takes its place and its anchor, so that links lead here.
    return Section.of("energy", "Activity", f"{_ACTIVITY} {_NO_JOULES}", table)


def cycles_section(report: ReportFigures) -> Section:
    """Return the section on cycles of the open core per recording: their spread, and comparison with real time."""
    figures = report.latency
    counts = report.operations.per_sample
    cost = time_cost(figures, report.classes)
    operations_per_cycle = (counts.synaptic_ops + counts.neuron_updates) / figures.per_sample_cycles
    spread = cost.facts()
    # The range of the mean is left out: cycles are exact, and no constant has a range.
    facts = {
        "cycles": f"{count(figures.per_sample_cycles)} per recording, "
        f"at {1000 * figures.clock_ghz:g} MHz",
        "synapses and updates per cycle": ratio(operations_per_cycle),
        "99 % of recordings": spread["99 % of recordings"],
        "worst recording": spread["worst recording"],
    }
    return Section.of(
        "latency",
        "Latency",
        _CYCLES,
        cost.span(),
        real_time(figures),
        bounds_table(report.bounds),
        Facts.of(facts),
        Folded.of("Time by class", cost.by_class()),
    )
