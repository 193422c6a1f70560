"""Sections on what a recording costs in the model: energy and latency."""

from __future__ import annotations

from collections.abc import Callable

from locsnn_compile.report.content import (
    Bar,
    Block,
    Bullets,
    Document,
    Fact,
    Facts,
    Paragraph,
    Section,
    Span,
    Stack,
    Table,
)
from locsnn_compile.report.format import count, energy, share, time
from locsnn_compile.report.verdict import pace
from locsnn_compile.report.words import words


def energy_section(document: Document) -> Section:
    """Energy per recording: spread, breakdown, branches, profiles, source, and what is not in it."""
    found = document["energy"]
    profile, total = found["profile"], found["per_sample_pj"]
    spread = found["over_samples_pj"]
    blocks: list[Block] = [
        Span(
            title=f"Energy per recording, profile {profile}",
            least=Fact("least", energy(spread["min"])),
            median=Fact("median", energy(spread["p50"])),
            mean=Fact("mean", energy(total)),
            most=Fact("most", energy(spread["max"])),
            values=(spread["min"], spread["p50"], total, spread["max"]),
        ),
        _stack(found["breakdown_pj"], f"Where the energy goes, profile {profile}"),
        _breakdown(found["breakdown_pj"], total, f"Energy by operation, mean per recording, profile {profile}"),
        _by_branch(found["by_branch_pj"], total, f"Energy by branch, mean per recording, profile {profile}", energy),
    ]
    others = found["other_profiles_pj"]
    if others:
        rows = [(f"{profile} (this report)", total), *others.items()]
        most = max(pj for _, pj in rows)
        blocks.append(
            Table(
                "Energy by profile, mean per recording",
                ("profile", "", "energy"),
                tuple((name, Bar(pj / most if most else 0.0, energy(pj)), energy(pj)) for name, pj in rows),
            )
        )
    blocks.append(Facts((Fact("source", found["source"]), Fact("basis", found["basis"]))))
    if found["not_included"]:
        blocks.append(Bullets("Not included in the energy", tuple(found["not_included"])))
    lead = (
        "Counts of the chip times the cost that a published profile gives each operation. A model; no board was used."
    )
    return Section("energy", "Energy", lead, tuple(blocks))


def latency_section(document: Document) -> Section:
    """Time per recording: spread, branches, and against the time that the recording took."""
    found = document["latency"]
    profile, mean, duration = found["profile"], found["per_sample_ns"], found["recording_ns"]
    spread = found["over_samples_ns"]
    if duration is None:
        text = "The model does not say how long a step lasts, so there is no comparison with real time."
    else:
        text = (
            f"On average {pace(mean, duration)}; in the slowest recording {pace(spread['max'], duration)}. "
            "The chip runs its steps as fast as it can, without waiting for the next touch."
        )
    return Section(
        "latency",
        "Latency",
        "A step lasts as long as its slowest core, its longest way through the mesh, and the barrier; the branches "
        "follow each other. Host input and the transpose buffer are not in it. A model; no board was used.",
        (
            Span(
                title=f"Time per recording, profile {profile}",
                least=Fact("least", time(spread["min"])),
                median=Fact("median", time(spread["p50"])),
                mean=Fact("mean", time(mean)),
                most=Fact("most", time(spread["max"])),
                values=(spread["min"], spread["p50"], mean, spread["max"]),
            ),
            Paragraph(text),
            _by_branch(found["by_branch_ns"], mean, f"Time by branch, mean per recording, profile {profile}", time),
            Facts(
                (
                    Fact(
                        "cycles",
                        f"{count(found['per_sample_cycles'])} per recording, each as long as the target says",
                    ),
                    Fact("critical core", f"core {count(found['critical_core'])} decided most of the time"),
                )
            ),
        ),
    )


def _stack(breakdown: dict[str, float], label: str) -> Stack:
    total = sum(breakdown.values())
    return Stack(
        label,
        tuple(
            Bar(pj / total, f"{words(name)} {share(pj / total)}", i)
            for i, (name, pj) in enumerate(breakdown.items())
            if total and pj
        ),
    )


def _breakdown(breakdown: dict[str, float], total: float, caption: str) -> Table:
    rows: list[tuple[str | Bar, ...]] = []
    for i, (name, pj) in enumerate(breakdown.items()):
        part = pj / total if total else 0.0
        rows.append((words(name), Bar(part, f"{share(part)} of the energy", i), energy(pj), share(part)))
    rows.append(("sum", "", energy(total), share(float(total > 0))))
    return Table(caption, ("operation", "", "energy", "share"), tuple(rows), total=True)


def _by_branch(branches: dict[str, float], total: float, caption: str, shown: Callable[[float], str]) -> Table:
    rows = []
    for name, value in branches.items():
        part = value / total if total else 0.0
        rows.append((words(name), Bar(part, f"{share(part)} of the whole"), shown(value), share(part)))
    return Table(caption, ("branch", "", "mean", "share"), tuple(rows))
