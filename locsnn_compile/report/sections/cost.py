"""Sections on what a recording costs in the model: energy and latency."""

from locsnn_compile.report.content import Bar, Document, Section, Table, facts, of, section, share_of, table
from locsnn_compile.report.format import NONE, count, energy, known, ratio, share, time
from locsnn_compile.report.sections.cost_tables import ENERGY, TIME, by_branch, constants, shares, stack
from locsnn_compile.report.sections.verdict import pace
from locsnn_compile.report.words import core_words, sentence, words


def energy_section(document: Document) -> Section:
    """Energy per recording: spread, breakdowns, profiles, static energy, constants, and what is not in it."""
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
        facts(*ENERGY.facts(document)),
        stack(breakdown, f"Where the energy goes, profile {profile}"),
        shares("operation", f"Energy by operation, {mean}", operations, patterned=True),
        by_branch(columns, "Energy by branch and profile, mean per recording", energy),
        shares("population", f"Energy by population, its dendrites included, {mean}", populations + elsewhere),
        shares("core", f"Energy by core, {mean}", cores + elsewhere),
        ENERGY.by_class(document),
        *(_static(found["static"]) if found["static"] else ()),
        _left_out(found["not_included_bounds"]) if found["not_included_bounds"] else None,
        *(constants(name, one) for name, one in found["profiles"].items()),
    )


def latency_section(document: Document) -> Section:
    """Time per recording: spread, where it goes, who waits for whom, and against the time that the recording took."""
    found = document["latency"]
    mean = found["per_sample_ns"]
    return section(
        "latency",
        TIME.span(document),
        real_time(found),
        facts(*_latency_facts(document)),
        by_branch(_parts(found), f"Time by branch and part, mean per recording, profile {found['profile']}", time),
        table(
            "What steps waited for, by the time that they took",
            found["critical_paths"],
            ("branch", of("phase", words)),
            ("done last", lambda row: f"core {row['last']}"),
            (
                "waited for",
                lambda row: f"packets of core {row['sender']}" if row["sender"] != row["last"] else "nothing",
            ),
            ("time", of("ns", time)),
            ("share", of("ns", lambda ns: share(share_of(ns, mean)))),
        ),
        _cores(found["by_core"], mean) if found["by_core"] else None,
        _links(found["links"]) if found["links"] else None,
        TIME.by_class(document),
    )


def _static(static: Document) -> tuple[str, Table]:
    chips = "1 chip" if static["chips"] == 1 else f"{static['chips']} chips"
    rows = (("at the chip's latency", "at_latency_pj"), ("at the sensor's real time", "at_real_time_pj"))
    return (
        sentence("static energy", chips=chips, milliwatts=static["chip_mw"], source=static["source"]),
        Table(
            "Static energy per recording",
            ("how long", "energy"),
            tuple((name, known(static[key], energy, "not known")) for name, key in rows),
        ),
    )


def _left_out(rows: list[Document]) -> Table:
    """Return what the energy does not include, and the most that it can be where that is known."""
    return table(
        "Not included in the energy",
        rows,
        ("what", of("what", str)),
        ("at most", of("at_most_pj", lambda pj: known(pj, energy, "not known"))),
        ("by", of("bound_source", lambda source: source or NONE)),
    )


def real_time(found: Document) -> str:
    """Compare with the time that the recordings took."""
    duration = found["recording_ns"]
    if duration is None:
        return sentence("no pace")
    mean, slowest = (pace(ns, duration) for ns in (found["per_sample_ns"], found["over_samples_ns"]["max"]))
    return sentence("pace", mean=mean, slowest=slowest)


def _latency_facts(document: Document) -> tuple[tuple[str, str | None], ...]:
    found = document["latency"]
    last_row, real, slowest = found["after_last_row_ns"], found["real_time"], None
    if real and real["slowest_step_factor"]:
        slowest = f"{time(real['slowest_step_ns'])} of the {time(real['step_ns'])} between two rows"
        slowest += f", {ratio(real['slowest_step_factor'])} times faster"
    return (
        ("cycles", f"{count(found['per_sample_cycles'])} per recording, at {found['clock_ghz']:g} GHz"),
        *TIME.facts(document),
        ("critical core", f"core {count(found['critical_core'])} finished last for most of the time"),
        ("after the last row", f"{time(last_row['mean'])}, at most {time(last_row['max'])}"),
        ("slowest step of a row", slowest),
    )


def _parts(found: Document) -> dict[str, dict[str, float]]:
    """Return the parts that take any time by branch, and all of them."""
    by_branch = found["by_branch_part_ns"]
    parts = [part for part, ns in found["by_part_ns"].items() if ns]
    columns = {words(part): {branch: its[part] for branch, its in by_branch.items()} for part in parts}
    return columns | {"all": found["by_branch_ns"]}


def _cores(cores: list[Document], total: float) -> Table:
    busy = [(words(name), lambda row, name=name: time(row["busy_ns"][name])) for name in cores[0]["busy_ns"]]
    return table(
        "What each core works on, mean per recording",
        cores,
        ("core", core_words),
        ("", of("last_ns", lambda ns: Bar(share_of(ns, total), f"done last in {time(ns)}"))),
        *busy,
        ("done last in", of("last_ns", time)),
    )


def _links(links: list[Document]) -> Table:
    most = max(row["packets"] for row in links)
    return table(
        "Packets on the links of the mesh, mean per recording",
        links,
        ("link, from tile to tile", lambda row: " to ".join(f"{x},{y}" for x, y in (row["from"], row["to"]))),
        ("", of("packets", lambda packets: Bar(packets / most, f"{count(packets)} packets"))),
        ("branch", of("phase", words)),
        ("packets", of("packets", count)),
        ("most in a step", of("most_in_a_step", count)),
    )
