"""Sections on what a recording costs in the model: energy and latency.

For the open core cycles are exact, and activity stands in for energy that is not known.
"""

from typing import Any

from locsnn_compile.report.content import Document, Facts, Section, Table, Verdict
from locsnn_compile.report.format import energy, time
from locsnn_compile.report.sections.cost_tables import (
    ENERGY,
    TIME,
    by_branch,
    constants,
    shares,
    stack,
)
from locsnn_compile.report.sections.verdict import against_anns, pace, timed
from locsnn_compile.report.words import (
    core_words,
    facts,
    section,
    sentence,
    share_of,
    table,
    verdict,
    words,
)


def energy_section(document: Document) -> Section:
    """Energy per recording: spread, breakdowns, profiles, static energy, constants, and what is not included."""
    found = document["energy"]
    profile, breakdown = found["profile"], found["breakdown_pj"]
    mean = f"mean per recording, profile {profile}"
    columns = {profile: found["by_branch_pj"], **found["other_profiles_by_branch_pj"]}
    elsewhere = [("outside the cores", found["elsewhere_pj"])] if found["elsewhere_pj"] else []
    populations = [(name, one["pj"]) for name, one in found["by_population_pj"].items()]
    cores = [(core_words(row), row["pj"]) for row in found["by_core_pj"]]
    operations = [(words(name), pj) for name, pj in breakdown.items()]
    return section(
        "energy",
        ENERGY.span(document),
        facts("spread of a cost", **ENERGY.facts(document)),
        stack(breakdown, f"Where the energy goes, profile {profile}"),
        shares("operation", f"Energy by operation, {mean}", operations, patterned=True),
        by_branch(columns, "Energy by branch and profile, mean per recording", energy),
        shares(
            "population",
            f"Energy by population, including its dendrites, {mean}",
            populations + elsewhere,
        ),
        shares("core", f"Energy by core, {mean}", cores + elsewhere),
        ENERGY.by_class(document),
        *(_static(found["static"]) if found["static"] else ()),
        table("not included", found["not_included_bounds"])
        if found["not_included_bounds"]
        else None,
        *(constants(name, one) for name, one in found["profiles"].items()),
    )


def latency_section(document: Document) -> Section:
    """Time per recording: spread, breakdown, which core waits for which, and comparison with real time."""
    found = document["latency"]
    if not timed(document):
        return section(
            "latency", _links(found["links"]), called="latency not known", profile=found["profile"]
        )
    mean, real = found["per_sample_ns"], found["real_time"]
    slowest = sentence("slowest step", **real) if real and real["slowest_step_factor"] else None
    return section(
        "latency",
        TIME.span(document),
        real_time(found),
        facts("latency", **found, **TIME.facts(document), slowest=slowest),
        by_branch(
            _parts(found),
            f"Time by branch and part, mean per recording, profile {found['profile']}",
            time,
        ),
        table("critical paths", (_path(mean=mean, **row) for row in found["critical_paths"])),
        _cores(found["by_core"], mean) if found["by_core"] else None,
        _links(found["links"]),
        TIME.by_class(document),
    )


def _static(static: Document) -> tuple[str, Table]:
    lasting = {
        "while the chip works": "at_latency_pj",
        "while the sensor records": "at_real_time_pj",
    }
    return (
        sentence("static energy", **static),
        table("static energy", {name: static[key] for name, key in lasting.items()}),
    )


def real_time(found: Document) -> str:
    """Compare with the duration of the recordings."""
    duration = found["recording_ns"]
    if duration is None:
        return sentence("no pace")
    mean, slowest = (
        pace(ns, duration) for ns in (found["per_sample_ns"], found["over_samples_ns"]["max"])
    )
    return sentence("pace", mean=mean, slowest=slowest)


def _path(*, mean: float, **row: Any) -> Document:
    awaited = "nothing" if row["sender"] == row["last"] else f"packets of core {row['sender']}"
    return row | {"awaited": awaited, "share": share_of(row["ns"], mean)}


def _parts(found: Document) -> dict[str, dict[str, float]]:
    """Return the time of each branch by the parts that take any, and in all."""
    by_branch = found["by_branch_part_ns"]
    parts = [part for part, ns in found["by_part_ns"].items() if ns]
    columns = {
        words(part): {branch: its[part] for branch, its in by_branch.items()} for part in parts
    }
    return columns | {"all": found["by_branch_ns"]}


def _cores(cores: list[Document], total: float) -> Table:
    rows = (row | {"drawn": share_of(row["last_ns"], total)} for row in cores)
    busy = {words(name): f"{{busy_ns[{name}]:time}}" for name in cores[0]["busy_ns"]}
    return table("work of cores", rows, columns=busy)


def _links(links: list[Document]) -> Table | None:
    most = max((row["packets"] for row in links), default=0)
    return (
        table("links", (row | {"drawn": row["packets"] / most} for row in links)) if links else None
    )


def cycles(document: Document) -> Verdict:
    """How many cycles does a recording take?"""
    found = document["latency"]
    duration = found["recording_ns"]
    real = "" if duration is None else f", {pace(found['per_sample_ns'], duration)}"
    its = Facts((*facts("verdict on cycles", real=real, **found).facts, *against_anns(document)))
    given = found | {"target": document["target"], "mhz": 1000 * found["clock_ghz"]}
    return verdict("cycles", "modelled", "Cycles exact, energy not known", its, **given)


def activity_section(document: Document) -> Section:
    """Memory accesses and multiplications, in place of energy."""
    found = document["activity"].items()
    its = table(
        "activity",
        ({"what": key, "of": of, "number": n} for key, its in found for of, n in its.items()),
    )
    if document["energy"]["profile"]:
        return section("activity", its)
    return section("energy", its, called="activity without energy")


def cycles_section(document: Document) -> Section:
    """Cycles per recording: their spread, and comparison with real time."""
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
