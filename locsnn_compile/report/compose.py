"""Put the report of a build together from its figures: verdicts, notices and sections.

The order is that in which readers ask: what matches, what the program takes, what it costs, then the
details. ``compose`` gives content without form; ``report/renderers`` turns it into pages.
"""

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

_FOLDED_SECTIONS = frozenset(
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
"""Keys of the sections of details, which are folded until a reader opens them: readers look them up, and decide by the
sections above them."""
LONGEST_NAME = 60
"""Most characters of a name in the title, chosen by hand to fit a heading; provenance has the names in full."""


def compose(report: ReportFigures, excerpt: Excerpt | None = None) -> Report:
    """Return the whole report as content without form.

    ``excerpt`` is the part of one recording whose spikes and potentials are shown; None to show none.
    """
    energy = report.energy
    # A function returns None for a section that this report does not have.
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
        sections=tuple(_folded_if_details(section) for section in sections if section),
        footer="Per recording means the mean over the recordings of the check, unless a range is given.",
        assumptions=report.assumptions,
    )


def _folded_if_details(section: Section) -> Section:
    """Return a section, folded if it holds details that are looked up rather than read."""
    return replace(section, folded=section.key in _FOLDED_SECTIONS)


def _cores(report: ReportFigures) -> Section | None:
    """Return the section on the use of cores; None for targets without energy or times of single cores."""
    if report.energy is None or report.latency.mesh is None:
        return None
    return cores(report, report.energy)


def _costs(report: ReportFigures) -> Iterator[Section]:
    """Yield the sections on energy and time: those of cores on a mesh, or those of the open core.

    ``activity`` counts the memory accesses of the open core, which alone has them.
    """
    energy = report.energy
    mesh = report.latency.mesh
    activity = report.activity
    if mesh is not None:
        yield cost.latency_section(report, mesh)
    if activity is not None:
        yield cost.cycles_section(report)
    if energy is not None:
        yield cost.energy_section(report, energy)
    if activity is not None:
        yield cost.activity_section(report, activity)


def _subtitle(report: ReportFigures) -> str:
    """Return the line under the title: width of weights, strategies, and the recordings of the check."""
    strategies = report.strategy.split(", ")
    noun = "strategy" if len(strategies) == 1 else "strategies"
    recordings = f"{plural(report.match.samples, 'recording')} of {report.match.events_source}"
    return f"{report.weight_bits}-bit weights, {noun} {listed(strategies)}, {recordings}"
