"""Explore the example networks on real recordings, and write their Pareto fronts into the page.

    python tests/benchmarks/pareto.py --data FOLDER --page docs/research/accuracy/speed-error-energy.md

``FOLDER`` holds Ev-Objects.zip and Ev-Containers.zip. Settings are chosen on all train recordings; the settings on the front
are then measured on the test recordings, once. Points are kept under ``--work``, so the script goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import csv
import json
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from page_section import put_section

from locsnn_compile.cli.main import main as locsnn
from locsnn_compile.cli.shell import EXIT_GATE
from locsnn_compile.report.format import NONE, energy, share, time
from locsnn_compile.settings import DIALS

ROOT = Path(__file__).parents[2]
DATASETS = ("objects", "containers")
BUDGETS = (("--min-agreement", "0.99"), ("--max-spike-error", "0.1"), ("--max-spike-error", "0.02"))
GRID = ("--weight-bits", "4", "6", "8", "--split-weights", "0", "1")
"""Options of the grid; without ``--strategy``, every strategy is combined with them."""
Document = dict[str, Any]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--page", type=Path, required=True)
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "pareto")
    args = parser.parse_args()
    written = "\n\n".join(
        section(args.data, args.work / dataset, args.page, dataset) for dataset in DATASETS
    )
    put_section(args.page, "pareto", written)


def section(data: Path, work: Path, page: Path, dataset: str) -> str:
    """Return the section of one network, and put its picture next to the page.

    The grid is explored once for each bound of :data:`BUDGETS`, which only changes what is recommended, and once without.
    Points are computed the first time and read after that.
    """
    archive = f"Ev-{dataset.title()}.zip"
    recordings = [
        option
        for name in ("events", "calibration", "report-on")
        for option in (f"--{name}", str(data / archive))
    ]
    options = [*recordings, *GRID, "-o", str(work)]
    bounded = [(budget, explore(dataset, [*options, *budget])["recommended"]) for budget in BUDGETS]
    explored = explore(dataset, options)
    picture = page.parents[1] / "images" / f"pareto-{dataset}.svg"
    shutil.copyfile(work / "explore.svg", picture)
    chosen, reported = explored["chosen_on"], explored["reported_on"]
    lines = [
        f"## {dataset.title()}, chosen on {chosen['recordings']} training recordings, "
        f"reported on {reported['recordings']} test recordings",
        "",
        f"![Energy and chip time over spike error, {dataset}](../images/{picture.name})",
        "",
        *table(explored, timings(work)),
        "",
        "Every row again, on the test recordings, with the options of the row:",
        "",
        f"    locsnn-compile examples/models/{dataset}-hybrid.pt --events {archive} --calibration {archive} OPTIONS",
        "",
        f"- Recommended: `{options_of(explored['recommended']['setting'])}`, {explored['recommended']['why']}.",
        *(f"- With `{' '.join(budget)}`: {bound(recommended)}." for budget, recommended in bounded),
        f"- Off the front, {off_front(explored)}.",
    ]
    return "\n".join(lines)


def explore(dataset: str, options: Sequence[str]) -> Document:
    """Run ``locsnn explore``; return its explore.json. It ends with EXIT_GATE if no point keeps a bound, which is a result too."""
    code = locsnn(["explore", f"examples/models/{dataset}-hybrid.pt", *options, "--quiet"])
    if code not in (0, EXIT_GATE):
        sys.exit(code)
    document: Document = json.loads(
        (Path(options[options.index("-o") + 1]) / "explore.json").read_text("utf-8")
    )
    return document


def table(found: Document, seconds: dict[tuple[str, ...], dict[str, float]]) -> list[str]:
    """Return the front, the least energy first: figures on training recordings, and on test recordings."""
    head = "| | options | spike error | classes changed | test: spike error | classes changed | accuracy | energy | chip time | simulator, fast | reference |"
    lines = [head, "| --- | --- |" + " ---: |" * 9]
    front = [row for row in found["points"] if row["on_front"]]
    for row in sorted(front, key=lambda row: row["figures"]["energy_pj"]):
        test, timed = row["reported"], seconds[key(row["setting"])]
        cells = [
            "**recommended**" if row["recommended"] else "",
            f"`{options_of(row['setting'])}`",
            *(share(row["figures"][name]) for name in ("spike_error", "prediction_error")),
            *(share(test[name]) for name in ("spike_error", "prediction_error")),
            NONE if test["accuracy"] is None else share(test["accuracy"]),
            energy(test["energy_pj"]),
            time(test["chip_time_ns"]),
            *(time(1e9 * timed[engine]) for engine in ("fast", "reference")),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def timings(work: Path) -> dict[tuple[str, ...], dict[str, float]]:
    """Return seconds of a recording by setting and engine."""
    seconds_of_setting: dict[tuple[str, ...], dict[str, float]] = {}
    with (work / "timings.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            seconds_of_setting.setdefault(key(row), {})[row["engine"]] = float(
                row["seconds_per_recording"]
            )
    return seconds_of_setting


def key(setting: dict[str, Any]) -> tuple[str, ...]:
    """Return the values of all dials (options of the compiler that can be varied), which identify a setting."""
    return tuple(str(setting[dial.name]) for dial in DIALS)


def options_of(setting: dict[str, Any]) -> str:
    """Return the options of the command line for a setting."""
    return " ".join(f"{dial.option} {setting[dial.name]}" for dial in DIALS)


def bound(recommended: Document) -> str:
    """Return the setting that is recommended, and why; only the reason if there is none."""
    setting = recommended["setting"]
    return (
        recommended["why"] if setting is None else f"`{options_of(setting)}`, {recommended['why']}"
    )


def off_front(found: Document) -> str:
    """Return the list of settings that are not on the front."""
    names = [f"`{options_of(row['setting'])}`" for row in found["points"] if not row["on_front"]]
    return (
        f"each beaten by another in every figure: {', '.join(names)}"
        if names
        else "there is nothing"
    )


if __name__ == "__main__":
    main()
