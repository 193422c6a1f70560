"""The parts of a report's page that all chips with an arithmetic of their own share.

A page has a *verdict* per question at the top (does it match, does it fit, what does it cost, ...), then *notices* that
limit the figures, then sections. Each family fills a :class:`FamilyPage`; :func:`compose_page` adds what is common.
"""

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
    """The family's own content of a page.

    - ``lowering``: how networks are brought to the chip, for the line below the title
    - ``costs``, ``fits``, ``worst``: the verdicts on cost, on room and on the worst time
    - ``not_known``: figures of such a chip that are unknown, each with the reason
    - ``notices``: limits of the figures that only chips of this family have
    - ``sections``: all sections after the agreement by population
    """

    lowering: str
    costs: Verdict
    fits: Verdict
    worst: Verdict
    not_known: Mapping[str, str]
    notices: tuple[Notice, ...]
    sections: tuple[Section, ...]


def compose_page(report: SharedFigures, page: FamilyPage, host: HostFigures | None) -> Report:
    """Return the whole page; ``host`` is the layers of the network that run on the host computer, if any."""
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
        # A section without content, such as one on host layers that the network does not have, is None.
        sections=tuple(section for section in sections if section),
        footer="Per recording means the mean over the recordings of the check.",
        assumptions=report.assumptions,
    )


def costs_verdict(
    report: SharedFigures, answer: str, sentence: str, first_facts: tuple[Fact, ...] = ()
) -> Verdict:
    """Return the verdict on the cost of a recording, in counted operations, since energy is unknown."""
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
    """Return the verdict that the worst time is unknown, with a figure that is known instead."""
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
    """Return the verdict that the program fits the chip, with the limit that is used most.

    In the texts, the ``taker``, such as the program, takes ``taken``, such as "3 of 856 cores", of the chip;
    ``besides`` names what else is on the chip.
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
    """Return the section of operations: the chip's counts by phase, next to the published method's.

    ``lead`` explains what is counted.
    """
    tables = behaviour.operations(figures)
    return Section(tables.key, tables.title, lead, (*tables.blocks, *notes))


def limits_section(report: SharedFigures, of_a_core: str = "") -> Section:
    """Return the section on the use of every limit; ``of_a_core`` adds which core is meant by limits of a core."""
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
    """Return the section of the chip's numbers by population.

    Each population has an entry of type ``kind``, whose fields become columns; ``number(key, value)`` writes a value.
    """
    keys = keys_of(kind)
    rows = []
    for name, numbers in quantization.items():
        rows.append((name, *(number(key, getattr(numbers, key)) for key in keys)))
    columns = ("population", *(words(key) for key in keys))
    table = Table(build.NUMBERS, columns, tuple(rows))
    return Section("quantization", build.QUANTISATION, lead, (table,))


def provenance_section(report: SharedFigures, keep_in_mind: tuple[str, ...]) -> Section:
    """Return the section on what was compiled, for which chip, and checked on what, with what to keep in mind."""
    return Section.of(
        "provenance",
        "Provenance",
        build.PROVENANCE,
        build.origin(report),
        build.gates(report.gates),
        Bullets("Keep in mind", keep_in_mind),
    )
