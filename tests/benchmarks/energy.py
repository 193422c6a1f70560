"""Write the tables of energy and latency of the example networks on all test recordings.

    python tests/benchmarks/energy.py --data FOLDER --page docs/research/results/energy.md

``FOLDER`` holds Ev-Objects.zip and Ev-Containers.zip. All networks have the same strategy. Each function makes the table of
one section from the networks' reports (``report.json``).
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
    """Return everything between the markers of the page."""
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
    """Return the energy of each branch, by every profile of the chip."""
    rows = []
    for name, report in reports.items():
        energy_entry = report["energy"]
        profiles = {
            energy_entry["profile"]: energy_entry["by_branch_pj"],
            **energy_entry["other_profiles_by_branch_pj"],
        }
        for profile, branches in profiles.items():
            time_pj, location_pj = branches["time"], branches["location"]
            rows.append(
                [
                    name,
                    profile,
                    energy(time_pj),
                    energy(location_pj),
                    ratio(location_pj / time_pj),
                    energy(time_pj + location_pj),
                ]
            )
    return table(
        ["network", "profile", "time branch", "location branch", "location / time", "whole"], rows
    )


def over_recordings(reports: dict[str, Report]) -> str:
    """Return how the energy differs between recordings and between classes."""
    rows = []
    for name, report in reports.items():
        energy_entry, worst = report["energy"], report["energy"]["worst_recording"]
        quantiles = [
            energy(energy_entry["over_samples_pj"][key]) for key in ("min", "p50", "p99", "max")
        ]
        classes = sorted(energy_entry["by_class"], key=lambda row: row["mean_pj"])
        ends = [f"{row['class']}: {energy(row['mean_pj'])}" for row in (classes[0], classes[-1])]
        rows.append([name, *quantiles, f"{worst['recording']}, class {worst['class']}", *ends])
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
    """Return the energy of each kind of operation, by branch."""
    operations = list(next(iter(reports.values()))["energy"]["breakdown_pj"])
    rows = []
    for name, report in reports.items():
        for branch, parts in report["energy"]["by_branch_breakdown_pj"].items():
            rows.append([name, branch, *(energy(parts[operation]) for operation in operations)])
    return table(["network", "branch", *(words(operation) for operation in operations)], rows)


def on_paper(reports: dict[str, Report]) -> str:
    """Return additions by the published method."""
    rows = []
    for name, report in reports.items():
        published = report["operations"]["published_method"]
        time_additions, location_additions = (
            published["additions_by_branch"][branch] for branch in ("time", "location")
        )
        rows.append(
            [
                name,
                count(time_additions),
                count(location_additions),
                count(published["transpose_events"]),
                ratio(location_additions / time_additions),
            ]
        )
    return table(
        ["network", "time branch", "location branch", "events transposed", "location / time"], rows
    )


def times(reports: dict[str, Report]) -> str:
    """Return the modelled time of a recording and its parts."""
    rows = []
    for name, report in reports.items():
        latency, real_time = report["latency"], report["latency"]["real_time"]
        parts = latency["by_part_ns"]
        work = [
            share(parts[part] / latency["per_sample_ns"])
            for part in ("updates", "synapses", "barrier")
        ]
        rows.append(
            [
                name,
                time(latency["per_sample_ns"]),
                *(time(latency["by_branch_ns"][branch]) for branch in ("time", "location")),
                time(parts["buffer"]),
                *work,
                time(latency["after_last_row_ns"]["mean"]),
                f"{count(real_time['factor'])} times faster",
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
    """Return static energy next to dynamic energy."""
    rows = []
    for name, report in reports.items():
        static_energy = report["energy"]["static"]
        dynamic_pj = report["energy"]["per_sample_pj"]
        rows.append(
            [
                name,
                energy(dynamic_pj),
                energy(static_energy["at_latency_pj"]),
                energy(static_energy["at_real_time_pj"]),
            ]
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
    """Return operations and arithmetic energy of conventional networks with the same input."""
    rows = []
    for name, report in reports.items():
        for ann, comparison in report["ann_comparison"].items():
            cells = [
                f"{energy(comparison['energy_pj'][key])} ({ratio(comparison['energy_ratio'][key])})"
                for key in comparison["energy_pj"]
            ]
            operations = [count(comparison[key]) for key in ("multiplications", "additions")]
            rows.append(
                [name, words(ann), *operations, f"{ratio(comparison['ratio'])} times", *cells]
            )
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
