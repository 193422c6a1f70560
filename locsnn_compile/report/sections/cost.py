"""Sections on what a recording costs in the model: energy and latency."""

from __future__ import annotations

from locsnn_compile.report.content import Bar, Block, Document, Fact, Facts, Paragraph, Section, Span, Stack, Table
from locsnn_compile.report.format import count, energy, ratio, share, time
from locsnn_compile.report.sections.cost_tables import Shown, by_branch, by_class, constants, left_out, shares
from locsnn_compile.report.sections.verdict import pace
from locsnn_compile.report.words import words


def energy_section(document: Document) -> Section:
    """Energy per recording: spread, breakdowns, profiles, static energy, constants, and what is not in it."""
    found = document["energy"]
    profile, total = found["profile"], found["per_sample_pj"]
    mean = f"mean per recording, profile {profile}"
    columns = {profile: found["by_branch_pj"], **found["other_profiles_by_branch_pj"]}
    blocks: list[Block] = [
        _span(found["over_samples_pj"], total, f"Energy per recording, profile {profile}", energy),
        Facts(
            (
                Fact("range of the mean", _range(found["range_pj"], energy)),
                Fact("99 % of recordings", f"at most {energy(found['over_samples_pj']['p99'])}"),
                Fact("worst recording", _worst(found["worst_recording"], "pj", energy)),
            )
        ),
        _stack(found["breakdown_pj"], f"Where the energy goes, profile {profile}"),
        shares(
            [(words(name), pj) for name, pj in found["breakdown_pj"].items()],
            f"Energy by operation, {mean}",
            "operation",
            energy,
            of="energy",
            patterned=True,
        ),
        by_branch(columns, "Energy by branch and profile, mean per recording", energy),
        shares(
            [*((name, one["pj"]) for name, one in found["by_population_pj"].items()), *_elsewhere(found)],
            f"Energy by population, its dendrites included, {mean}",
            "population",
            energy,
            of="energy",
        ),
        shares(
            [
                *((f"core {row['core']}, {words(row['phase'])}", row["pj"]) for row in found["by_core_pj"]),
                *_elsewhere(found),
            ],
            f"Energy by core, {mean}",
            "core",
            energy,
            of="energy",
        ),
    ]
    if found["by_class"]:
        blocks.append(by_class(found["by_class"], "pj", f"Energy by class, profile {profile}", energy))
    if found["static"]:
        blocks += _static(found["static"])
    if found["not_included_bounds"]:
        blocks.append(left_out(found["not_included_bounds"]))
    blocks += [constants(name, one) for name, one in found["profiles"].items()]
    lead = (
        "Counts of the chip times the cost that a published profile gives each operation. A model; no board was used."
    )
    return Section("energy", "Energy", lead, tuple(blocks))


def latency_section(document: Document) -> Section:
    """Time per recording: spread, where it goes, who waits for whom, and against the time that the recording took."""
    found = document["latency"]
    profile, mean, duration = found["profile"], found["per_sample_ns"], found["recording_ns"]
    if duration is None:
        text = "How long a step lasts is not known, so there is no comparison with real time."
    else:
        slowest = found["over_samples_ns"]["max"]
        text = (
            f"On average {pace(mean, duration)}; in the slowest recording {pace(slowest, duration)}. "
            "The chip runs its steps as fast as it can, without waiting for the next touch."
        )
    blocks: list[Block] = [
        _span(found["over_samples_ns"], mean, f"Time per recording, profile {profile}", time),
        Paragraph(text),
        Facts(_latency_facts(found)),
        by_branch(_parts(found), f"Time by branch and part, mean per recording, profile {profile}", time),
        Table(
            "What steps waited for, by the time of these steps",
            ("branch", "done last", "waited for", "time", "share"),
            tuple(
                (
                    words(row["phase"]),
                    f"core {row['last']}",
                    "nothing" if row["sender"] == row["last"] else f"packets of core {row['sender']}",
                    time(row["ns"]),
                    share(row["ns"] / mean if mean else 0.0),
                )
                for row in found["critical_paths"]
            ),
        ),
    ]
    if found["by_core"]:
        blocks.append(_cores(found["by_core"], mean))
    if found["links"]:
        blocks.append(_links(found["links"]))
    if found["by_class"]:
        blocks.append(by_class(found["by_class"], "ns", f"Time by class, profile {profile}", time))
    return Section(
        "latency",
        "Latency",
        "A step lasts until the last core is done, and the barrier. A core updates its compartments and sends; when "
        "its last packet has arrived, over links of the mesh that pass one at a time, it takes all in and adds up "
        "their synapses. The branches follow each other. Host input is not in it. A model; no board was used.",
        tuple(blocks),
    )


def _span(spread: Document, mean: float, title: str, shown: Shown) -> Span:
    return Span(
        title=title,
        least=Fact("least", shown(spread["min"])),
        median=Fact("median", shown(spread["p50"])),
        mean=Fact("mean", shown(mean)),
        most=Fact("most", shown(spread["max"])),
        values=(spread["min"], spread["p50"], mean, spread["max"]),
    )


def _range(ends: list[float | None], shown: Shown) -> str:
    low, high = ends
    if low == high and low is not None:
        return "none: no constant is given as a range"
    if low is None and high is None:
        return "not known"
    if high is None:
        assert low is not None
        return f"{shown(low)} or more: a constant is given as a least"
    if low is None:
        return f"{shown(high)} or less: a constant is given as a most"
    return f"{shown(low)} to {shown(high)}"


def _worst(worst: Document, unit: str, shown: Shown) -> str:
    label = "" if worst["class"] is None else f" of class {worst['class']}"
    return f"recording {worst['recording']}{label}, {shown(worst[unit])}"


def _elsewhere(found: Document) -> list[tuple[str, float]]:
    return [("outside the cores", found["elsewhere_pj"])] if found["elsewhere_pj"] else []


def _static(static: Document) -> list[Block]:
    chips = "1 chip" if static["chips"] == 1 else f"{static['chips']} chips"
    rows = [
        ("at the chip's latency", static["at_latency_pj"]),
        ("at the sensor's real time", static["at_real_time_pj"]),
    ]
    return [
        Paragraph(
            f"Static energy is in none of the figures above: {chips}, {static['chip_mw']:g} mW each "
            f"({static['source']}), while the chip works, or for as long as the sensor records."
        ),
        Table(
            "Static energy per recording",
            ("how long", "energy"),
            tuple((name, "not known" if pj is None else energy(pj)) for name, pj in rows),
        ),
    ]


def _latency_facts(found: Document) -> tuple[Fact, ...]:
    facts = [
        Fact("cycles", f"{count(found['per_sample_cycles'])} per recording, at {found['clock_ghz']:g} GHz"),
        Fact("range of the mean", _range(found["range_ns"], time)),
        Fact("99 % of recordings", f"at most {time(found['over_samples_ns']['p99'])}"),
        Fact("worst recording", _worst(found["worst_recording"], "ns", time)),
        Fact("critical core", f"core {count(found['critical_core'])} was last in most of the time"),
        Fact(
            "after the last row",
            f"{time(found['after_last_row_ns']['mean'])}, at most {time(found['after_last_row_ns']['max'])}",
        ),
    ]
    real = found["real_time"]
    if real and real["slowest_step_factor"]:
        slowest = f"{time(real['slowest_step_ns'])} of the {time(real['step_ns'])} between two rows"
        facts.append(Fact("slowest step of a row", f"{slowest}, {ratio(real['slowest_step_factor'])} times faster"))
    return tuple(facts)


def _parts(found: Document) -> dict[str, dict[str, float]]:
    """Return the parts that take any time by branch, and all of them."""
    by_branch = found["by_branch_part_ns"]
    parts = [part for part, ns in found["by_part_ns"].items() if ns]
    columns = {words(part): {branch: its[part] for branch, its in by_branch.items()} for part in parts}
    return columns | {"all": found["by_branch_ns"]}


def _cores(cores: list[Document], total: float) -> Table:
    parts = list(cores[0]["busy_ns"])
    return Table(
        "What each core works on, mean per recording",
        ("core", "", *(words(part) for part in parts), "done last in"),
        tuple(
            (
                f"core {row['core']}, {words(row['phase'])}",
                Bar(row["last_ns"] / total if total else 0.0, f"done last in {time(row['last_ns'])}"),
                *(time(row["busy_ns"][part]) for part in parts),
                time(row["last_ns"]),
            )
            for row in cores
        ),
    )


def _links(links: list[Document]) -> Table:
    most = max(row["packets"] for row in links)
    return Table(
        "Packets on the links of the mesh, mean per recording",
        ("link, from tile to tile", "", "branch", "packets", "most in a step"),
        tuple(
            (
                f"{row['from'][0]},{row['from'][1]} to {row['to'][0]},{row['to'][1]}",
                Bar(row["packets"] / most, f"{count(row['packets'])} packets"),
                words(row["phase"]),
                count(row["packets"]),
                count(row["most_in_a_step"]),
            )
            for row in links
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
