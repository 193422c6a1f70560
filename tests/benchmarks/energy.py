"""Energy and latency of the example networks on all test recordings, and write the tables.

    python tests/benchmarks/energy.py --data FOLDER --page docs/research/results/energy.md

``FOLDER`` holds Ev-Objects.zip and Ev-Containers.zip. All networks have the same strategy; nothing is chosen here.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from page_section import put_section

import locsnn_compile as lc
from locsnn_compile.report.format import count, energy, ratio, share, time
from locsnn_compile.report.words import words

ROOT = Path(__file__).parents[2]
NETWORKS = (
    "objects-hybrid",
    "containers-hybrid",
    "objects-hybrid-loihi",
    "containers-hybrid-loihi",
)
STRATEGY = "dendrite"

Report = dict[str, Any]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--page", type=Path, required=True)
    args = parser.parse_args()
    reports = {name: report_of(name, args.data) for name in NETWORKS}
    put_section(args.page, "energy", tables(reports))


def report_of(name: str, data: Path) -> Report:
    """Return the report of an example network on the test recordings of its data set."""
    network = lc.load(ROOT / f"examples/models/{name}.pt")
    archive = data / f"Ev-{name.split('-')[0].title()}.zip"
    return lc.compile(network, strategy=STRATEGY, events=archive, diagnosis=False).report


def tables(reports: dict[str, Report]) -> str:
    """Return everything between the marks."""
    parts = [
        "## By branch and profile",
        "Means per recording. The published claim is about the ratio location / time. Figures by `davies2018` are lower bounds.",
        by_branch(reports),
        "## Over the recordings",
        over_recordings(reports),
        "## By operation",
        "Profile `davies2018`, mean per recording.",
        by_operation(reports),
        "## On paper",
        "The published method counts additions only: spikes of the float network times their fan-out.",
        on_paper(reports),
        "## Time",
        "Profile `davies2018`, mean per recording; *after the last row* is the delay of the answer.",
        times(reports),
        "## Static energy",
        "One chip's static energy while it works, and for as long as the sensor records. The figures above do not include it.",
        static(reports),
        "## Next to conventional networks",
        "Arithmetic only, at 45 nm; in brackets, as a multiple of the network's whole energy, profile `davies2018`.",
        conventional(reports),
    ]
    return "\n\n".join(parts)


def by_branch(reports: dict[str, Report]) -> str:
    rows = []
    for name, report in reports.items():
        found = report["energy"]
        profiles = {found["profile"]: found["by_branch_pj"], **found["other_profiles_by_branch_pj"]}
        for profile, branches in profiles.items():
            a, b = branches["time"], branches["location"]
            rows.append([name, profile, energy(a), energy(b), ratio(b / a), energy(a + b)])
    return table(
        ["network", "profile", "time branch", "location branch", "location / time", "whole"], rows
    )


def over_recordings(reports: dict[str, Report]) -> str:
    rows = []
    for name, report in reports.items():
        found, worst = report["energy"], report["energy"]["worst_recording"]
        spread = [energy(found["over_samples_pj"][key]) for key in ("min", "p50", "p99", "max")]
        classes = sorted(found["by_class"], key=lambda row: row["mean_pj"])
        ends = [f"{row['class']}: {energy(row['mean_pj'])}" for row in (classes[0], classes[-1])]
        rows.append([name, *spread, f"{worst['recording']}, class {worst['class']}", *ends])
    head = [
        "network",
        "least",
        "median",
        "99 % below",
        "most",
        "worst recording",
        "cheapest class",
        "most expensive class",
    ]
    return table(head, rows)


def by_operation(reports: dict[str, Report]) -> str:
    operations = list(next(iter(reports.values()))["energy"]["breakdown_pj"])
    rows = []
    for name, report in reports.items():
        for branch, parts in report["energy"]["by_branch_breakdown_pj"].items():
            rows.append([name, branch, *(energy(parts[operation]) for operation in operations)])
    return table(["network", "branch", *(words(operation) for operation in operations)], rows)


def on_paper(reports: dict[str, Report]) -> str:
    rows = []
    for name, report in reports.items():
        found = report["operations"]["published_method"]
        a, b = (found["additions_by_branch"][branch] for branch in ("time", "location"))
        rows.append([name, count(a), count(b), count(found["transpose_events"]), ratio(b / a)])
    return table(
        ["network", "time branch", "location branch", "events transposed", "location / time"], rows
    )


def times(reports: dict[str, Report]) -> str:
    rows = []
    for name, report in reports.items():
        found, real = report["latency"], report["latency"]["real_time"]
        parts = found["by_part_ns"]
        work = [
            share(parts[part] / found["per_sample_ns"])
            for part in ("updates", "synapses", "barrier")
        ]
        rows.append(
            [
                name,
                time(found["per_sample_ns"]),
                *(time(found["by_branch_ns"][branch]) for branch in ("time", "location")),
                time(parts["buffer"]),
                *work,
                time(found["after_last_row_ns"]["mean"]),
                f"{count(real['factor'])} times faster",
            ]
        )
    head = [
        "network",
        "recording",
        "time",
        "location",
        "of which buffer",
        "updates",
        "synapses",
        "barriers",
    ]
    return table([*head, "after the last row", "against the sensor"], rows)


def static(reports: dict[str, Report]) -> str:
    rows = []
    for name, report in reports.items():
        found = report["energy"]["static"]
        own = report["energy"]["per_sample_pj"]
        rows.append(
            [name, energy(own), energy(found["at_latency_pj"]), energy(found["at_real_time_pj"])]
        )
    return table(
        [
            "network",
            "dynamic energy",
            "static, while the chip works",
            "static, while the sensor records",
        ],
        rows,
    )


def conventional(reports: dict[str, Report]) -> str:
    rows = []
    for name, report in reports.items():
        for other, found in report["ann_comparison"].items():
            cells = [
                f"{energy(found['energy_pj'][key])} ({ratio(found['energy_ratio'][key])})"
                for key in found["energy_pj"]
            ]
            operations = [count(found[key]) for key in ("multiplications", "additions")]
            rows.append([name, words(other), *operations, f"{ratio(found['ratio'])} times", *cells])
    arithmetics = next(iter(next(iter(reports.values()))["ann_comparison"].values()))["energy_pj"]
    head = [
        "network",
        "next to",
        "multiplications",
        "additions",
        "operations",
        *(words(key) for key in arithmetics),
    ]
    return table(head, rows)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


if __name__ == "__main__":
    main()
