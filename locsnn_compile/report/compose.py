"""Put the report together: verdicts, notices and sections, in the order in which readers ask."""

from collections.abc import Iterator
from dataclasses import replace

from locsnn_compile.report.content import Report, Section
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.format import plural, shortened
from locsnn_compile.report.sections import accuracy, behaviour, build, cost
from locsnn_compile.report.sections.cores import cores
from locsnn_compile.report.sections.over_time import over_time
from locsnn_compile.report.sections.placed import placed_section, with_board
from locsnn_compile.report.sections.recording import potential, spikes
from locsnn_compile.report.sections.registers import overflows, registers
from locsnn_compile.report.sections.unknowns import unknowns_of
from locsnn_compile.report.sections.verdict import costs, fits, matches, notices
from locsnn_compile.report.sections.worst_time import worst_time
from locsnn_compile.report.words import listed
from locsnn_compile.verification.excerpt import Excerpt

_LOOKED_UP = frozenset(
    {
        "activity",
        "comparison",
        "cores",
        "left-out",
        "margins",
        "operations",
        "overflows",
        "potential",
        "provenance",
        "quantization",
        "range",
    }
)
"""Sections of details, which are folded: what a reader decides by stands before them."""
LONGEST_NAME = 60
"""Characters of a name in the title; provenance has the names in full."""


def compose(report: ReportFigures, excerpt: Excerpt | None = None) -> Report:
    """Return the whole report as content without form; ``excerpt`` is the part of a recording to show."""
    energy = report.energy
    sections = (
        behaviour.agreement(report.match),
        build.resources(report),
        placed_section(report.placed),
        *_costs(report),
        build.settings_chosen_from(report.strategy_choice),
        spikes(report.match, excerpt),
        accuracy.error_budget(report),
        over_time(report),
        potential(report.match, excerpt),
        accuracy.margins(report),
        _cores(report),
        behaviour.operations(report.operations),
        behaviour.host_layers(report.host),
        behaviour.comparison(report),
        build.left_out(report),
        build.quantization(report),
        overflows(report.overflows),
        build.ranges(report),
        build.provenance(report),
    )
    names = (shortened(name, LONGEST_NAME) for name in (report.model.name, report.target))
    return Report(
        kind="locsnn-compile report",
        title=" on ".join(names),
        subtitle=_subtitle(report),
        verdicts=(
            matches(report),
            registers(report, report.overflows, report.range),
            with_board(fits(report), report),
            worst_time(report),
            cost.cycles(report) if energy is None else costs(report, energy),
            unknowns_of(report),
        ),
        notices=notices(report),
        sections=tuple(_as_read(section) for section in sections if section),
        footer="Per recording means the mean over the recordings of the check, unless a range is given.",
        assumptions=report.assumptions,
    )


def _as_read(section: Section) -> Section:
    """Fold what is looked up rather than read."""
    return replace(section, folded=section.key in _LOOKED_UP)


def _cores(report: ReportFigures) -> Section | None:
    if report.energy is None or report.latency.mesh is None:
        return None
    return cores(report, report.energy)


def _costs(report: ReportFigures) -> Iterator[Section]:
    """Yield the sections on energy and time: those of cores on a mesh, or those of the open core."""
    energy, mesh, activity = report.energy, report.latency.mesh, report.activity
    if mesh is not None:
        yield cost.latency_section(report, mesh)
    if activity is not None:
        yield cost.cycles_section(report)
    if energy is not None:
        yield cost.energy_section(report, energy)
    if activity is not None:
        yield cost.activity_section(report, activity)


def _subtitle(report: ReportFigures) -> str:
    strategies = report.strategy.split(", ")
    called = "strategy" if len(strategies) == 1 else "strategies"
    recordings = f"{plural(report.match.samples, 'recording')} of {report.match.events_source}"
    return f"{report.weight_bits}-bit weights, {called} {listed(strategies)}, {recordings}"
