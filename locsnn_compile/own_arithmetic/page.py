"""The parts of a report's page that all chips with an arithmetic of their own share."""

from collections.abc import Callable, Mapping

from hw_model.values import Frozen
from locsnn_compile.report.compose import LONGEST_NAME
from locsnn_compile.report.content import (
    Block,
    Bullets,
    Fact,
    Notice,
    Report,
    Section,
    Table,
    Verdict,
)
from locsnn_compile.report.figures.document import SharedFigures
from locsnn_compile.report.figures.entries import Entry, keys_of
from locsnn_compile.report.figures.host import HostFigures
from locsnn_compile.report.figures.operations import OperationFigures
from locsnn_compile.report.format import count, plural, share, shortened
from locsnn_compile.report.sections import behaviour, build
from locsnn_compile.report.sections.registers import registers
from locsnn_compile.report.sections.unknowns import unknowns
from locsnn_compile.report.sections.verdict import fullness, matches, notices
from locsnn_compile.report.sections.worst_time import QUESTION
from locsnn_compile.report.words import words


class FamilyPage(Frozen):
    """What the page of a family says of its own.

    - ``lowering``: how networks are brought to the chip, for the line below the title
    - ``costs``, ``fits``, ``worst``: the verdicts on cost, on room and on the worst time
    - ``not_known``: what nobody knows of such a chip, by what it is of
    - ``notices``: what limits the figures, and only such a chip does
    - ``sections``: all that follow the agreement by population
    """

    lowering: str
    costs: Verdict
    fits: Verdict
    worst: Verdict
    not_known: Mapping[str, str]
    notices: tuple[Notice, ...]
    sections: tuple[Section, ...]


def compose_page(report: SharedFigures, page: FamilyPage, host: HostFigures | None) -> Report:
    """Return the whole report, of a network with these layers on the host."""
    match = report.match
    names = (report.model.name, report.target)
    recordings = f"{plural(match.samples, 'recording')} of {match.events_source}"
    sections = (behaviour.agreement(match), behaviour.host_layers(host), *page.sections)
    return Report(
        kind="locsnn-compile report",
        title=" on ".join(shortened(name, LONGEST_NAME) for name in names),
        subtitle=f"{report.weight_bits}-bit weights, {page.lowering}, {recordings}",
        verdicts=(
            matches(report),
            registers(report),
            page.fits,
            page.worst,
            page.costs,
            unknowns(report, page.not_known),
        ),
        notices=(*notices(report), *page.notices),
        sections=tuple(section for section in sections if section),
        footer="Per recording means the mean over the recordings of the check.",
        assumptions=report.assumptions,
    )


def costs_verdict(
    report: SharedFigures, answer: str, sentence: str, first_facts: tuple[Fact, ...] = ()
) -> Verdict:
    """Say how much a recording takes: counted operations, as energy is not known."""
    per_sample = report.operations.per_sample
    return Verdict(
        question="What does it cost?",
        status="unknown",
        answer=answer,
        figure=plural(per_sample.synaptic_ops, "synaptic operation"),
        figure_label="per recording",
        sentence=sentence,
        facts=(
            *first_facts,
            Fact("neuron updates", count(per_sample.neuron_updates)),
            Fact("spikes", count(per_sample.spikes)),
        ),
    )


def worst_verdict(figure: str, figure_label: str, sentence: str) -> Verdict:
    """Say that the worst time is not known, and what is known in its place."""
    return Verdict(
        question=QUESTION,
        status="unknown",
        answer="Not known",
        figure=figure,
        figure_label=figure_label,
        sentence=sentence,
        facts=(),
    )


def fits_verdict(report: SharedFigures, taken: str, taker: str, besides: str = "") -> Verdict:
    """Say that the chip holds the program, and how full the fullest limit is.

    ``taken`` is what the ``taker``, such as the program, takes of the chip, ``besides`` what stands
    next to it there.
    """
    limits = report.resources.limits
    fullest = max(limits, key=lambda name: fullness(limits[name]))
    use = limits[fullest]
    full = f"{count(use.used)} of {count(use.limit)} ({share(fullness(use))})"
    return Verdict(
        question="Does it fit?",
        status="yes",
        answer="Yes",
        figure=taken,
        figure_label=f"of {report.target}{besides}",
        sentence=f"{taker} takes {taken} of {report.target}.",
        facts=(
            Fact("fullest limit", f"{words(fullest)}, {full}"),
            Fact("synapses", count(report.resources.synapses)),
        ),
    )


def operations_section(figures: OperationFigures, lead: str, *notes: Block) -> Section:
    """Counts of the chip by phase, next to those on paper; ``lead`` says what is counted."""
    tables = behaviour.operations(figures)
    return Section(tables.key, tables.title, lead, (*tables.blocks, *notes))


def limits_section(report: SharedFigures, of_a_core: str = "") -> Section:
    """Use of every limit; ``of_a_core`` says whose limits those of a core are."""
    rows = tuple(
        (words(name), count(use.used), count(use.limit), share(fullness(use)))
        for name, use in report.resources.limits.items()
    )
    columns = ("limit", "used", "of", "share")
    lead = f"How much of {report.target} the program uses{of_a_core}."
    return Section("resources", "Resources", lead, (Table("Limits", columns, rows),))


def numbers_section(
    quantization: Mapping[str, Entry],
    kind: type[Entry],
    lead: str,
    number: Callable[[str, object], str],
) -> Section:
    """Numbers of the chip by population, entries of one ``kind``.

    ``number`` writes a number, given its key.
    """
    keys = keys_of(kind)
    rows = []
    for name, numbers in quantization.items():
        rows.append((name, *(number(key, getattr(numbers, key)) for key in keys)))
    columns = ("population", *(words(key) for key in keys))
    table = Table(build.NUMBERS, columns, tuple(rows))
    return Section("quantization", build.QUANTISATION, lead, (table,))


def provenance_section(report: SharedFigures, keep_in_mind: tuple[str, ...]) -> Section:
    """What was compiled, for which chip, checked on what; and what to keep in mind."""
    return Section.of(
        "provenance",
        "Provenance",
        build.PROVENANCE,
        build.origin(report),
        build.gates(report.gates),
        Bullets("Keep in mind", keep_in_mind),
    )
