"""The report of a program for a Xylo as content without form, in the order of all reports."""

from locsnn_compile.report.compose import LONGEST_NAME
from locsnn_compile.report.content import (
    Bullets,
    Document,
    Fact,
    Notice,
    Report,
    Section,
    Table,
    Verdict,
)
from locsnn_compile.report.format import count, plural, share, shortened
from locsnn_compile.report.sections import behaviour, build
from locsnn_compile.report.sections.verdict import fullness, matches, notices
from locsnn_compile.report.words import facts, section, table, words
from locsnn_compile.settings import LAYOUTS, NATIVE
from locsnn_compile.xylo.document import NO_TABLE

KEEP_IN_MIND = (
    "The arithmetic was compared with xylosim, the vendor's simulator, value by value. That the chip "
    "computes as xylosim does is the vendor's word: no chip was used.",
    "A spike subtracts the threshold, and a hidden neuron may send up to 31 spikes in a step. The "
    "float network sends one at most.",
)


def compose_xylo(document: Document) -> Report:
    """Return the whole report."""
    match = document["match"]
    names = (document["model"]["name"], document["target"])
    return Report(
        kind="locsnn-compile report",
        title=" on ".join(shortened(name, LONGEST_NAME) for name in names),
        subtitle=(
            f"{document['weight_bits']}-bit weights, decays by shifts, "
            f"{plural(match['samples'], 'recording')} of {match['events_source']}"
        ),
        verdicts=(matches(document), _costs(document), _fits(document)),
        notices=(*notices(document), *_notices(document)),
        sections=(
            behaviour.agreement(document),
            _operations(document),
            _resources(document),
            build.left_out(document),
            _quantization(document),
            _provenance(document),
        ),
        footer="Per recording means the mean over the recordings of the check.",
        assumptions=tuple(document["assumptions"]),
    )


def _costs(document: Document) -> Verdict:
    """How much does a recording take: counted operations, as energy and time are not known."""
    per_sample = document["operations"]["per_sample"]
    updates = per_sample["neuron_updates"]
    return Verdict(
        question="What does it cost?",
        status="unknown",
        answer="Energy and time not known",
        figure=plural(per_sample["synaptic_ops"], "synaptic operation"),
        figure_label="per recording",
        sentence=f"Energy and time are not known, because {NO_TABLE}.",
        facts=(
            Fact("neuron updates", count(updates)),
            Fact("spikes", count(per_sample["spikes"])),
        ),
    )


def _fits(document: Document) -> Verdict:
    resources = document["resources"]
    limits = resources["limits"]
    fullest = max(limits, key=lambda name: fullness(limits[name]))
    hidden = limits["hidden_neurons"]
    neurons = f"{count(hidden['used'])} of {plural(hidden['limit'], 'hidden neuron')}"
    entry = limits[fullest]
    full = f"{count(entry['used'])} of {count(entry['limit'])} ({share(fullness(entry))})"
    return Verdict(
        question="Does it fit?",
        status="yes",
        answer="Yes",
        figure=neurons,
        figure_label=f"of {document['target']}",
        sentence=f"The program takes {neurons} of {document['target']}.",
        facts=(
            Fact("fullest limit", f"{words(fullest)}, {full}"),
            Fact("synapses", count(resources["synapses"])),
        ),
    )


def _notices(document: Document) -> tuple[Notice, ...]:
    """Return what limits the figures and only a Xylo does."""
    saturations = document["match"]["clips"]
    if not saturations:
        return ()
    text = (
        f"A current or a potential reached the end of its 16 bits {plural(saturations, 'time')} and "
        "stayed there. What the neuron does after that says little about the float network."
    )
    return (Notice("Registers saturated.", text),)


def _resources(document: Document) -> Section:
    limits = document["resources"]["limits"].items()
    rows = tuple(
        (words(name), count(entry["used"]), count(entry["limit"]), share(fullness(entry)))
        for name, entry in limits
    )
    columns = ("limit", "used", "of", "share")
    lead = f"How much of {document['target']} the program uses."
    return Section("resources", "Resources", lead, (Table("Limits", columns, rows),))


def _quantization(document: Document) -> Section:
    lead = (
        "A potential of 1 in the float network is the scale in the chip's registers. A decay takes away "
        "a share of 2^-dash; the errors of decays are shares of the float decay. Where two numbers are "
        "given, they are the smallest and the largest of the population."
    )
    numbers = build.quantization(document)
    return Section(numbers.key, numbers.title, lead, numbers.blocks)


def _operations(document: Document) -> Section:
    lead = (
        "A synaptic operation is one addition to a current; a neuron is updated in every step. The "
        "published method counts on paper: spikes of the trained network times their fan-out."
    )
    extra = document["operations"]["extra_spikes"]
    several = f"Spikes of hidden neurons beyond the first in a step: {count(extra)} per recording."
    tables = behaviour.operations(document)
    return Section(tables.key, tables.title, lead, (*tables.blocks, several))


def _provenance(document: Document) -> Section:
    gates = document["gates"]
    return section(
        "provenance",
        facts("provenance", meaning=f"{NATIVE}: {LAYOUTS[NATIVE]}", **document),
        table("gates", gates) if gates else None,
        Bullets("Keep in mind", KEEP_IN_MIND),
    )
