"""Put the report together: verdicts, notices and sections, in the order in which readers ask."""

from collections.abc import Iterator

from locsnn_compile.report.content import Report, Section
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.format import plural, shortened
from locsnn_compile.report.sections import accuracy, behaviour, build, cost
from locsnn_compile.report.sections.cores import cores
from locsnn_compile.report.sections.over_time import over_time
from locsnn_compile.report.sections.recording import potential, spikes
from locsnn_compile.report.sections.registers import overflows, registers
from locsnn_compile.report.sections.verdict import costs, fits, matches, notices
from locsnn_compile.report.words import listed
from locsnn_compile.verification.excerpt import Excerpt

LONGEST_NAME = 60
"""Characters of a name in the title; provenance has the names in full."""


def compose(report: ReportFigures, excerpt: Excerpt | None = None) -> Report:
    """Return the whole report as content without form; ``excerpt`` is the part of a recording to show."""
    energy = report.energy
    sections = (
        *_costs(report),
        behaviour.agreement(report.match),
        spikes(report.match, excerpt),
        potential(report.match, excerpt),
        accuracy.error_budget(report),
        accuracy.margins(report),
        over_time(report),
        behaviour.operations(report.operations),
        behaviour.comparison(report),
        build.resources(report),
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
            cost.cycles(report) if energy is None else costs(report, energy),
            fits(report),
            registers(report, report.overflows, report.range),
        ),
        notices=notices(report),
        sections=tuple(section for section in sections if section),
        footer="Per recording means the mean over the recordings of the check, unless a range is given.",
        assumptions=report.assumptions,
    )


def _costs(report: ReportFigures) -> Iterator[Section]:
    """Yield the sections on energy and time: those of cores on a mesh, or those of the open core."""
    energy, mesh, activity = report.energy, report.latency.mesh, report.activity
    if energy is not None:
        yield cost.energy_section(report, energy)
    if mesh is not None:
        yield cost.latency_section(report, mesh)
    if mesh is not None and energy is not None:
        yield cores(report, energy)
    if activity is not None:
        yield cost.activity_section(report, activity)
        yield cost.cycles_section(report)


def _subtitle(report: ReportFigures) -> str:
    strategies = report.strategy.split(", ")
    called = "strategy" if len(strategies) == 1 else "strategies"
    recordings = f"{plural(report.match.samples, 'recording')} of {report.match.events_source}"
    return f"{report.weight_bits}-bit weights, {called} {listed(strategies)}, {recordings}"
