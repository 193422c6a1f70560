"""The report of a program for a Xylo as content without form, in the order of all reports."""

from locsnn_compile.report.compose import LONGEST_NAME
from locsnn_compile.report.content import (
    Bullets,
    Cell,
    Fact,
    Notice,
    Report,
    Section,
    Table,
    Verdict,
)
from locsnn_compile.report.figures.entries import keys_of
from locsnn_compile.report.figures.operations import OperationFigures
from locsnn_compile.report.figures.resources import ProgramUse
from locsnn_compile.report.format import any_value, count, plural, share, shortened
from locsnn_compile.report.sections import behaviour, build
from locsnn_compile.report.sections.verdict import fullness, matches, notices
from locsnn_compile.report.words import words
from locsnn_compile.xylo.document import NO_TABLE, XyloFigures, XyloNumbers

KEEP_IN_MIND = (
    "The arithmetic was compared with xylosim, the vendor's simulator, value by value. That the chip "
    "computes as xylosim does is the vendor's word: no chip was used.",
)
OF_FLOAT_NETWORKS = (
    "A spike subtracts the threshold, and a hidden neuron may send up to 31 spikes in a step. The "
    "float network sends one at most.",
)


def compose_xylo(report: XyloFigures) -> Report:
    """Return the whole report."""
    match = report.match
    names = (report.model.name, report.target)
    return Report(
        kind="locsnn-compile report",
        title=" on ".join(shortened(name, LONGEST_NAME) for name in names),
        subtitle=(
            f"{report.weight_bits}-bit weights, decays by shifts, "
            f"{plural(match.samples, 'recording')} of {match.events_source}"
        ),
        verdicts=(matches(report), _costs(report), _fits(report)),
        notices=(*notices(report), *_notices(match.clips)),
        sections=(
            behaviour.agreement(match),
            _operations(report.operations),
            _resources(report.resources, report.target),
            build.left_out(report),
            _quantization(report),
            _provenance(report),
        ),
        footer="Per recording means the mean over the recordings of the check.",
        assumptions=report.assumptions,
    )


def _costs(report: XyloFigures) -> Verdict:
    """How much does a recording take: counted operations, as energy and time are not known."""
    per_sample = report.operations.per_sample
    return Verdict(
        question="What does it cost?",
        status="unknown",
        answer="Energy and time not known",
        figure=plural(per_sample.synaptic_ops, "synaptic operation"),
        figure_label="per recording",
        sentence=f"Energy and time are not known, because {NO_TABLE}.",
        facts=(
            Fact("neuron updates", count(per_sample.neuron_updates)),
            Fact("spikes", count(per_sample.spikes)),
        ),
    )


def _fits(report: XyloFigures) -> Verdict:
    limits = report.resources.limits
    fullest = max(limits, key=lambda name: fullness(limits[name]))
    use = limits[fullest]
    hidden = limits["hidden_neurons"]
    neurons = f"{count(hidden.used)} of {plural(hidden.limit, 'hidden neuron')}"
    full = f"{count(use.used)} of {count(use.limit)} ({share(fullness(use))})"
    return Verdict(
        question="Does it fit?",
        status="yes",
        answer="Yes",
        figure=neurons,
        figure_label=f"of {report.target}",
        sentence=f"The program takes {neurons} of {report.target}.",
        facts=(
            Fact("fullest limit", f"{words(fullest)}, {full}"),
            Fact("synapses", count(report.resources.synapses)),
        ),
    )


def _notices(saturations: int) -> tuple[Notice, ...]:
    """Return what limits the figures and only a Xylo does."""
    if not saturations:
        return ()
    text = (
        f"A current or a potential reached the end of its 16 bits {plural(saturations, 'time')} and "
        "stayed there. What the neuron does after that says little about the float network."
    )
    return (Notice("Registers saturated.", text),)


def _resources(resources: ProgramUse, target: str) -> Section:
    rows = tuple(
        (words(name), count(use.used), count(use.limit), share(fullness(use)))
        for name, use in resources.limits.items()
    )
    columns = ("limit", "used", "of", "share")
    lead = f"How much of {target} the program uses."
    return Section("resources", "Resources", lead, (Table("Limits", columns, rows),))


def _quantization(report: XyloFigures) -> Section:
    lead = (
        "A potential of 1 in the float network is the scale in the chip's registers. A decay takes away "
        "a share of 2^-dash; the errors of decays are shares of the float decay. Where two numbers are "
        "given, they are the smallest and the largest of the population."
    )
    table = Table(
        build.NUMBERS,
        ("population", *(words(key) for key in keys_of(XyloNumbers))),
        tuple(_numbers(name, numbers) for name, numbers in report.quantization.items()),
    )
    return Section("quantization", build.QUANTISATION, lead, (table,))


def _numbers(name: str, numbers: XyloNumbers) -> tuple[Cell, ...]:
    return (
        name,
        numbers.strategy,
        any_value(numbers.scale),
        any_value(numbers.threshold_mantissa),
        any_value(numbers.dash_syn),
        any_value(numbers.dash_mem),
        share(numbers.current_decay_error),
        share(numbers.potential_decay_error),
        any_value(numbers.weight_shifts),
    )


def _operations(figures: OperationFigures) -> Section:
    lead = (
        "A synaptic operation is one addition to a current; a neuron is updated in every step. The "
        "published method counts on paper: spikes of the trained network times their fan-out."
    )
    extra = count(figures.extra_spikes or 0.0)
    several = f"Spikes of hidden neurons beyond the first in a step: {extra} per recording."
    tables = behaviour.operations(figures)
    return Section(tables.key, tables.title, lead, (*tables.blocks, several))


def _provenance(report: XyloFigures) -> Section:
    keep_in_mind: tuple[str, ...] = KEEP_IN_MIND
    if report.match.reference == "float64":
        keep_in_mind += OF_FLOAT_NETWORKS
    return Section.of(
        "provenance",
        "Provenance",
        build.PROVENANCE,
        build.origin(report),
        build.gates(report.gates),
        Bullets("Keep in mind", keep_in_mind),
    )
