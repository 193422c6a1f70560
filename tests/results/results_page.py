"""The results page, from the figures that are there: published tables beside ours, and what has not been run."""

from __future__ import annotations

import csv
import json
import re
import statistics
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from result_rows import DATASETS, ROWS, SEEDS, Dataset, Row, command

from locsnn_compile.baselines.operations import ann_operations

Found = Mapping[tuple[str, str], Mapping[int, Mapping[str, Any]]]
"""(data set, row) -> seed -> figures."""

NOT_RUN = "not run"
BRANCH_NAMES = {"time": "SNN_TSRM", "location": "SNN_LSRM"}
PUBLISHED_OPERATIONS = {
    "gru-mlp": ("11.87", "11.87", "5.48"),
    "cnn-3d": ("8.34", "8.14", "3.5"),
    "hybrid": ("0.60", "0.83", "0.045"),
}
PUBLISHED_CASES = {"objects": (325, 36), "containers": (325, 20), "slip": (150, 2)}
PRINTED_RATIOS = ("9.80-14.30", "13.90-19.78", "77.78-121.78")


def read(work: Path) -> Found:
    """Return the figures under a folder."""
    found: dict[tuple[str, str], dict[int, Mapping[str, Any]]] = {}
    for dataset in DATASETS:
        for row in ROWS:
            for seed in SEEDS:
                path = work / f"{dataset}-{row.name}-{seed}.json"
                if path.exists():
                    found.setdefault((dataset, row.name), {})[seed] = json.loads(path.read_text(encoding="utf-8"))
    return found


def spread(values: Sequence[float], digits: int = 3) -> str:
    """Return mean and sample standard deviation; how many where they are not five."""
    if not values:
        return NOT_RUN
    deviation = f" ± {statistics.stdev(values):.{digits}f}" if len(values) > 1 else ""
    count = "" if len(values) == len(SEEDS) else f" ({len(values)} of {len(SEEDS)} seeds)"
    return f"{statistics.mean(values):.{digits}f}{deviation}{count}"


Table = tuple[Sequence[str], Sequence[Sequence[str]]]
"""Head and rows."""


def markdown(made: Table) -> str:
    """Return a table as Markdown, its first column to the left."""
    head, rows = made
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " ---: |" * (len(head) - 1)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def write_tables(found: Found, folder: Path) -> dict[str, Table]:
    """Write the tables that are too long for the page, a CSV file each, and return them; rows without figures stay.

    Files of other tables are not touched.
    """
    folder.mkdir(exist_ok=True)
    found, tables = _fuller(found, kept(folder / "accuracy.csv")), {}
    for name, make in TABLES.items():
        path = folder / f"{name}.csv"
        tables[name] = merged(make(found), kept(path))
        write_table(path, tables[name])
    return tables


def _fuller(found: Found, before: Table | None) -> Found:
    """Leave out rows that have fewer seeds than those of a table of accuracies."""
    stand = {row[0]: row[2::3] for row in before[1]} if before else {}
    names = list(DATASETS)

    def had(dataset: str, label: str) -> int:
        cell = stand.get(label, [NOT_RUN] * len(names))[names.index(dataset)]
        return _seeds_of(cell) if cell else 0

    labels = {row.name: row.label for row in ROWS}
    return {key: seeds for key, seeds in found.items() if len(seeds) >= had(key[0], labels[key[1]])}


def write_table(path: Path, made: Table) -> None:
    head, rows = made
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([head, *rows])


def kept(path: Path) -> Table | None:
    """Return the table of a file, None where there is none."""
    if not path.exists():
        return None
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    return head, rows


def merged(made: Table, before: Table | None) -> Table:
    """Lay a table over one with the same head: rows are known by their first cell, and what was not run stays."""
    head, rows = made
    if before is None or list(before[0]) != list(head):
        return made
    old = {row[0]: list(row) for row in before[1]}
    new = {row[0]: [_laid(mine, was) for mine, was in zip(row, old.get(row[0], row), strict=True)] for row in rows}
    order = new if old.keys() <= new.keys() else old | new
    return head, [new.get(name, old.get(name, [])) for name in order]


def _laid(mine: str, was: str) -> str:
    """Return the cell that comes from more seeds."""
    return was if _seeds_of(mine) < _seeds_of(was) else mine


def _seeds_of(cell: str) -> int:
    if cell == NOT_RUN:
        return 0
    found = re.search(rf"\((\d) of {len(SEEDS)} seeds\)", cell)
    return int(found[1]) if found else len(SEEDS)


def column(found: Found, dataset: str, row: str, key: str) -> list[float]:
    """Return a figure of every seed that has it."""
    return [float(f[key]) for f in found.get((dataset, row), {}).values() if f.get(key) is not None]


def accuracy(found: Found) -> Table:
    head = ["network"]
    for dataset in DATASETS.values():
        ours = "ours" if dataset.archive else "ours, synthetic"
        head += [f"{dataset.name.title()}, published", f"{ours}, test", f"{ours}, on the chip"]
    rows = []
    for row in ROWS:
        cells = [row.label]
        for name in DATASETS:
            if row.only not in (None, name):
                cells += ["", "", ""]
                continue
            measured = spread(column(found, name, row.name, "test_accuracy"))
            chip = spread(column(found, name, row.name, "chip_accuracy"))
            if measured != NOT_RUN and chip == NOT_RUN:
                chip = "no spikes"
            cells += [row.published.get(name, ""), measured, chip]
        rows.append(cells)
    return head, rows


def settings(found: Found) -> Table:
    rows = []
    for (name, row_name), seeds in found.items():
        label = next(row.label for row in ROWS if row.name == row_name)
        epochs = [f["chosen_epoch"] for f in seeds.values()]
        held = [f["validation_accuracy"] for f in seeds.values() if f["validation_accuracy"] is not None]
        rows.append(
            [
                f"{label}, {DATASETS[name].title}",
                str(next(iter(seeds.values()))["epochs"]),
                ", ".join(map(str, epochs)),
                spread(held) if held else "none held out",
            ]
        )
    return ["network", "epochs at most", "chosen, seed by seed", "accuracy on the validation part"], rows


def chip(found: Found) -> Table:
    rows = []
    for (name, row_name), seeds in found.items():
        if column(found, name, row_name, "chip_accuracy"):
            label = next(row.label for row in ROWS if row.name == row_name)
            keys = ("reference_accuracy", "chip_accuracy", "prediction_agreement", "spike_agreement")
            cells = [spread(column(found, name, row_name, key)) for key in keys]
            energy = statistics.mean(float(f["energy_pj"]) for f in seeds.values()) / 1e6
            rows.append([f"{label}, {DATASETS[name].title}", *cells, f"{energy:.2f}"])
    head = ["network", "float accuracy", "chip accuracy", "predictions that agree", "spikes that agree", "energy, µJ"]
    return head, rows


def ann_table() -> Table:
    """The published operations beside ours, to the last digit."""
    rows = []
    for name, label in (("gru-mlp", "GRU-MLP"), ("cnn-3d", "CNN-3D")):
        cells = [label]
        for printed, (steps, classes) in zip(PUBLISHED_OPERATIONS[name], PUBLISHED_CASES.values(), strict=True):
            ours = ann_operations(name, fingertips=2, steps=steps, classes=classes)
            cells += [printed, f"{ours:,}"]
        rows.append(cells)
    rows.append(["Hybrid", *(cell for printed in PUBLISHED_OPERATIONS["hybrid"] for cell in (printed, ""))])
    rows.append(["ratio as printed", *(cell for printed in PRINTED_RATIOS for cell in (printed, ""))])
    rows.append(["ratio, corrected", *(cell for text in corrected_ratios() for cell in (text, ""))])
    head = ["network, two fingertips"]
    for name in PUBLISHED_CASES:
        head += [f"{name.title()}, 10^6, published", "ours, exactly"]
    return head, rows


def corrected_ratios() -> list[str]:
    """Return the ratio row that the printed operations give."""
    columns = zip(*(map(float, PUBLISHED_OPERATIONS[name]) for name in ("gru-mlp", "cnn-3d", "hybrid")), strict=True)
    return [f"{min(gru, cnn) / hybrid:.2f}-{max(gru, cnn) / hybrid:.2f}" for gru, cnn, hybrid in columns]


def quantiles(values: Sequence[float]) -> list[str]:
    """Return mean, median, 99th percentile and maximum."""
    array = np.asarray(values, dtype=float)
    return [f"{figure:,.0f}" for figure in (array.mean(), np.median(array), np.percentile(array, 99), array.max())]


def operations(found: Found) -> Table:
    rows = []
    for name, dataset in DATASETS.items():
        for row in ROWS:
            rows += _operation_rows(found.get((name, row.name), {}), row, dataset)
    return ["network, test recordings of all seeds", "mean", "median", "99 %", "most"], rows


def _operation_rows(seeds: Mapping[int, Mapping[str, Any]], row: Row, dataset: Dataset) -> list[list[str]]:
    measured = [f for f in seeds.values() if "additions" in f]
    if not measured:
        return []
    title = f"{row.label}, {dataset.title}"
    by_part = {axis: np.concatenate([f["additions"][axis] for f in measured]) for axis in measured[0]["additions"]}
    rows = [[f"{title}: {_branch(row, axis)}", *quantiles(each)] for axis, each in by_part.items()]
    if measured[0]["transposed"]:
        by_part["transposed"] = np.concatenate([f["transposed"] for f in measured])
        rows.append([f"{title}: events transposed", *quantiles(by_part["transposed"])])
    if len(by_part) > 1:
        rows.append([f"{title}: together", *quantiles(sum(by_part.values(), start=np.zeros(1)))])
    return rows


def _branch(row: Row, axis: str) -> str:
    named = row.model in ("hybrid", "tactile-snn", "location-tactile-snn") and axis in BRANCH_NAMES
    return BRANCH_NAMES[axis] if named else f"{axis} branch"


def ratios(found: Found) -> Table:
    """Operations of the ANNs at the same input over ours, on average and for the costliest recording."""
    rows = []
    for name, dataset in DATASETS.items():
        for row in (row for row in ROWS if row.model in ("hybrid", "window-snn")):
            for ann, label in (("gru-mlp", "GRU-MLP"), ("cnn-3d", "CNN-3D")):
                measured = [f for f in found.get((name, row.name), {}).values() if "additions" in f]
                if measured:
                    rows.append([f"{row.label}, {dataset.title}, against {label}", *_ratios(measured, ann)])
    return ["networks", "operations of the ANN", "ratio, mean", "ratio, 99 %", "ratio, least"], rows


def _ratios(measured: Sequence[Mapping[str, Any]], ann: str) -> list[str]:
    first = measured[0]
    theirs = ann_operations(ann, fingertips=first["fingertips"], steps=first["steps"], classes=first["classes"])
    ours = np.concatenate([np.sum([*f["additions"].values(), f["transposed"]], axis=0) for f in measured])
    return [f"{theirs:,}", *(f"{theirs / cost:.1f}" for cost in (ours.mean(), np.percentile(ours, 99), ours.max()))]


def chip_counts(found: Found) -> Table:
    rows = []
    for (name, row_name), seeds in found.items():
        measured = [f["chip"] for f in seeds.values() if "chip" in f]
        if measured:
            label = next(row.label for row in ROWS if row.name == row_name)
            keys = ("synaptic_ops", "neuron_updates", "spikes", "input_events", "transpose_events")
            cells = [f"{statistics.mean(float(f[key]) for f in measured):,.0f}" for key in keys]
            rows.append([f"{label}, {DATASETS[name].title}", *cells])
    head = ["network", "synaptic operations", "compartment updates", "spikes", "input events", "transposed events"]
    return head, rows


def confusions(found: Found) -> Table:
    rows = []
    for (name, row_name), seeds in found.items():
        wrong: dict[tuple[int, int], int] = {}
        for f in seeds.values():
            for wanted, got in zip(f.get("labels", []), f.get("predictions", []), strict=True):
                if wanted != got:
                    wrong[wanted, got] = wrong.get((wanted, got), 0) + 1
        if wrong:
            worst = sorted(wrong.items(), key=lambda item: (-item[1], item[0]))[:4]
            label = next(row.label for row in ROWS if row.name == row_name)
            pairs = ", ".join(f"{wanted} for {got}: {n}" for (wanted, got), n in worst)
            rows.append(
                [f"{label}, {DATASETS[name].title}", str(sum(wrong.values())), pairs.replace(" for ", " taken for ")]
            )
    return ["network, on the chip, all seeds", "wrong", "most often"], rows


def commands(found: Found) -> Table:
    """The command of seed 0 of every row that has figures."""
    rows = [[command(row, DATASETS[name], 0)] for row in ROWS for name in DATASETS if (name, row.name) in found]
    return ["command"], rows


def best_ratios(ratios: Table) -> Table:
    """The ratios of the networks that are named on the page."""
    head, rows = ratios
    named = ("Hybrid, lambda 1, loop", "Window-SNN, Objects", "Window-SNN, Containers", "Window-SNN and hybrid")
    return head, [row for row in rows if row[0].startswith(named) and "synthetic" not in row[0]]


def missing(accuracy: Table) -> str:
    """Return the rows without all seeds, a line for every data set."""
    lines = []
    for place, dataset in enumerate(DATASETS.values()):
        seeds = {row[0]: _seeds_of(row[3 * place + 2]) for row in accuracy[1]}
        words = [f"{label} ({n} of {len(SEEDS)} seeds)" if n else label for label, n in seeds.items() if n < len(SEEDS)]
        lines += [f"- {dataset.title}: {'; '.join(words)}."] if words else []
    return "\n".join(lines) if lines else "Nothing: every row was run with all seeds."


TABLES: dict[str, Callable[[Found], Table]] = {
    "accuracy": accuracy,
    "settings": settings,
    "chip": chip,
    "confusions": confusions,
    "operations": operations,
    "ratios": ratios,
    "chip-counts": chip_counts,
    "commands": commands,
}
"""What stands in ``docs/results/NAME.csv``."""


def page(tables: Mapping[str, Table]) -> str:
    """Return the whole page."""
    template = (Path(__file__).with_name("results_template.md")).read_text(encoding="utf-8")
    values = {
        "accuracy": markdown(tables["accuracy"]),
        "ratios": markdown(best_ratios(tables["ratios"])),
        "ann_table": markdown(ann_table()),
        "missing": missing(tables["accuracy"]),
    }
    for name, text in values.items():
        template = template.replace(f"{{{{{name}}}}}", text)
    return template
