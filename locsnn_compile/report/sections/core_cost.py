"""Sections on what a recording costs on the open core: cycles, which are exact, and activity instead of energy."""

from locsnn_compile.report.content import Document, Fact, Section, Verdict, facts, section, table
from locsnn_compile.report.format import count, share, time
from locsnn_compile.report.sections.cost import real_time
from locsnn_compile.report.sections.cost_tables import TIME
from locsnn_compile.report.sections.verdict import pace
from locsnn_compile.report.words import sentence, words


def cycles(document: Document) -> Verdict:
    """What does a recording take?"""
    found, many = document["latency"], count(document["latency"]["per_sample_cycles"])
    mean, duration, ends = found["per_sample_ns"], found["recording_ns"], found["over_samples_ns"]
    real = "" if duration is None else f", {pace(mean, duration)}"
    return Verdict(
        question="What does it cost?",
        status="modelled",
        answer="Cycles exact, energy not known",
        figure=f"{many} cycles",
        figure_label=f"per recording on the open core of {document['target']}",
        sentence=sentence("cycles", cycles=many, time=time(mean)),
        facts=(
            Fact("range", f"{time(ends['min'])} to {time(ends['max'])}, median {time(ends['p50'])}"),
            Fact("latency", f"{time(mean)}{real}"),
            Fact("energy", "not known: no power model of such devices is public"),
        ),
    )


def activity_section(document: Document) -> Section:
    """Accesses to memories and multiplications, in place of energy."""
    rows = [(key, name, many) for key, found in document["activity"].items() for name, many in found.items()]
    its = table(
        "Activity, mean per recording",
        rows,
        ("what", lambda row: words(row[0])),
        ("of", lambda row: words(row[1])),
        ("number", lambda row: count(row[2])),
    )
    if document["energy"]["profile"]:
        return section("activity", its)
    return section("energy", its, called="activity without energy")


def cycles_section(document: Document) -> Section:
    """Cycles per recording: their spread, and against the time that the recording took."""
    found, done = document["latency"], document["operations"]["per_sample"]
    used = (done["synaptic_ops"] + done["neuron_updates"]) / found["per_sample_cycles"]
    return section(
        "latency",
        TIME.span(document),
        real_time(found),
        facts(
            ("cycles", f"{count(found['per_sample_cycles'])} per recording, at {1000 * found['clock_ghz']:g} MHz"),
            ("synapses and updates per cycle", share(used)),
            *TIME.facts(document)[1:],
        ),
        TIME.by_class(document),
        called="cycles",
    )
