"""Put the report together: verdicts, notices and sections, in the order in which readers ask."""

from locsnn_compile.report.content import Document, Report
from locsnn_compile.report.format import plural, shortened
from locsnn_compile.report.sections import accuracy, behaviour, build, cost
from locsnn_compile.report.sections.cores import cores
from locsnn_compile.report.sections.over_time import over_time
from locsnn_compile.report.sections.recording import potential, spikes
from locsnn_compile.report.sections.verdict import costs, fits, matches, notices
from locsnn_compile.report.words import listed
from locsnn_compile.verification.excerpt import Excerpt

LONGEST_NAME = 60
"""Characters of a name in the title; provenance has the names in full."""


def compose(document: Document, excerpt: Excerpt | None = None) -> Report:
    """Return the whole report as content without form; ``excerpt`` is the part of a recording to show."""
    priced = document["energy"]["profile"]
    on_mesh = "activity" not in document
    sections = (
        cost.energy_section(document) if priced else None,
        *((cost.latency_section(document), cores(document)) if on_mesh else ()),
        *(() if on_mesh else (cost.activity_section(document), cost.cycles_section(document))),
        behaviour.agreement(document),
        spikes(document, excerpt),
        potential(document, excerpt),
        accuracy.error_budget(document),
        accuracy.margins(document),
        over_time(document),
        behaviour.operations(document),
        behaviour.comparison(document),
        build.resources(document),
        build.left_out(document),
        build.quantization(document),
        build.ranges(document),
        build.provenance(document),
    )
    match = document["match"]
    strategies = document["strategy"].split(", ")
    called = "strategy" if len(strategies) == 1 else "strategies"
    options = f"{document['weight_bits']}-bit weights, {called} {listed(strategies)}"
    names = (
        shortened(name, LONGEST_NAME) for name in (document["model"]["name"], document["target"])
    )
    return Report(
        kind="locsnn-compile report",
        title=" on ".join(names),
        subtitle=f"{options}, {plural(match['samples'], 'recording')} of {match['events_source']}",
        verdicts=(
            matches(document),
            costs(document) if priced else cost.cycles(document),
            fits(document),
        ),
        notices=notices(document),
        sections=tuple(section for section in sections if section),
        footer="Per recording means the mean over the recordings of the check, unless a range is given.",
        assumptions=tuple(document["assumptions"]),
    )
