"""Put the report together: the verdicts, the notices and the sections in the order in which people ask."""

from __future__ import annotations

from collections.abc import Callable

from locsnn_compile.report import accuracy, behaviour, build, cost
from locsnn_compile.report.content import Document, Report, Section
from locsnn_compile.report.format import plural
from locsnn_compile.report.over_time import over_time
from locsnn_compile.report.verdict import costs, fits, matches, notices

SECTIONS: tuple[Callable[[Document], Section | None], ...] = (
    behaviour.agreement,
    accuracy.error_budget,
    accuracy.margins,
    over_time,
    behaviour.operations,
    cost.energy_section,
    cost.latency_section,
    build.resources,
    behaviour.comparison,
    build.left_out,
    build.quantization,
    build.ranges,
    build.provenance,
)


def compose(document: Document) -> Report:
    """Return the whole report as content without form."""
    return Report(
        title=f"{document['model']['name']} on {document['target']}",
        subtitle=subtitle(document),
        verdicts=(matches(document), costs(document), fits(document)),
        notices=notices(document),
        sections=tuple(made for section in SECTIONS if (made := section(document))),
    )


def subtitle(document: Document) -> str:
    """Return the options of the build and the recordings of its check in a line."""
    match = document["match"]
    return (
        f"{document['weight_bits']}-bit weights, strategy {document['strategy']}, "
        f"{plural(match['samples'], 'recording')} of {match['events_source']}"
    )
