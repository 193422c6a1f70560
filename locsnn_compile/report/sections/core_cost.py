"""Sections on what a recording costs on the open core: cycles, which are exact, and activity instead of energy."""

from locsnn_compile.report.content import Document, Section, Verdict, facts, section, table, verdict
from locsnn_compile.report.sections.cost import real_time
from locsnn_compile.report.sections.cost_tables import TIME
from locsnn_compile.report.sections.verdict import pace


def cycles(document: Document) -> Verdict:
    """What does a recording take?"""
    found = document["latency"]
    duration = found["recording_ns"]
    real = "" if duration is None else f", {pace(found['per_sample_ns'], duration)}"
    its = facts("verdict on cycles", real=real, **found)
    return verdict("cycles", "modelled", "Cycles exact, energy not known", its, target=document["target"], **found)


def activity_section(document: Document) -> Section:
    """Accesses to memories and multiplications, in place of energy."""
    found = document["activity"].items()
    its = table("activity", ({"what": key, "of": of, "number": n} for key, its in found for of, n in its.items()))
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
        facts("cycles", **found, **TIME.facts(document), mhz=1000 * found["clock_ghz"], used=used),
        TIME.by_class(document),
        called="cycles",
    )
