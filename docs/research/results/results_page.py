"""The results page, from the figures that are there: published figures next to ours, and what has not been run.

``results_page.txt`` and ``operations_page.txt`` are the pages with ``{{NAME}}`` in the place of tables and figures.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from operation_tables import (
    ann_table,
    chip_counts,
    chip_ratios,
    costs,
    named,
    operations,
    ratios,
)
from result_rows import DATASETS, ROWS, SEEDS, command
from tables import (
    NOT_RUN,
    RunFigures,
    Table,
    column,
    markdown,
    merged,
    read_table,
    seeds_of,
    spread,
    write_table,
)


def read(work: Path) -> RunFigures:
    """Return the figures of all runs under a folder."""
    runs: dict[tuple[str, str], dict[int, Mapping[str, Any]]] = {}
    for dataset in DATASETS:
        for row in ROWS:
            for seed in SEEDS:
                path = work / f"{dataset}-{row.name}-{seed}.json"
                if path.exists():
                    runs.setdefault((dataset, row.name), {})[seed] = json.loads(
                        path.read_text(encoding="utf-8")
                    )
    return runs


def write_tables(runs: RunFigures, folder: Path) -> dict[str, Table]:
    """Write all tables, a CSV file each, and return them; rows of earlier files without figures now stay.

    Rows are left out of a table if fewer seeds are here than the file of accuracies had. Cells of operations on the chip say from
    how many seeds they are, so this table also takes networks with a few seeds.
    """
    folder.mkdir(exist_ok=True)
    full_runs, tables = _fuller(runs, read_table(folder / "accuracy.csv")), {}
    for name, make in TABLES.items():
        path = folder / f"{name}.csv"
        tables[name] = merged(make(runs if make is chip_ratios else full_runs), read_table(path))
        write_table(path, tables[name])
    return tables


def _fuller(runs: RunFigures, accuracies_before: Table | None) -> RunFigures:
    """Leave out runs of rows that have fewer seeds here than in a table of accuracies.

    Its third cell of each data set, the accuracy on the chip or on the test part, says how many seeds that were.
    """
    cells_of_label = (
        {row[0]: row[2::3] for row in accuracies_before[1]} if accuracies_before else {}
    )
    names = list(DATASETS)

    def had(dataset: str, label: str) -> int:
        cell = cells_of_label.get(label, [NOT_RUN] * len(names))[names.index(dataset)]
        return seeds_of(cell) if cell else 0

    labels = {row.name: row.label for row in ROWS}
    return {key: seeds for key, seeds in runs.items() if len(seeds) >= had(key[0], labels[key[1]])}


def accuracy(runs: RunFigures) -> Table:
    """Return published accuracies, and ours in training's arithmetic and on the chip, by data set."""
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
            measured = spread(column(runs, name, row.name, "test_accuracy"))
            chip = spread(column(runs, name, row.name, "chip_accuracy"))
            if measured != NOT_RUN and chip == NOT_RUN:
                chip = "no spikes"
            cells += [row.published.get(name, ""), measured, chip]
        rows.append(cells)
    return head, rows


def settings(runs: RunFigures) -> Table:
    """Return the epochs of every network, and its accuracy on the validation part."""
    rows = []
    for (name, row_name), seeds in runs.items():
        label = next(row.label for row in ROWS if row.name == row_name)
        epochs = [figures["chosen_epoch"] for figures in seeds.values()]
        validation_accuracies = [
            figures["validation_accuracy"]
            for figures in seeds.values()
            if figures["validation_accuracy"] is not None
        ]
        rows.append(
            [
                f"{label}, {DATASETS[name].title}",
                str(next(iter(seeds.values()))["epochs"]),
                ", ".join(map(str, epochs)),
                spread(validation_accuracies) if validation_accuracies else "none held out",
            ]
        )
    return [
        "network",
        "epochs at most",
        "chosen, seed by seed",
        "accuracy on the validation part",
    ], rows


def chip(runs: RunFigures) -> Table:
    """Return accuracy in float and on the chip, the agreement of predictions and spikes, and energy."""
    rows = []
    for (name, row_name), seeds in runs.items():
        if column(runs, name, row_name, "chip_accuracy"):
            label = next(row.label for row in ROWS if row.name == row_name)
            keys = (
                "reference_accuracy",
                "chip_accuracy",
                "prediction_agreement",
                "spike_agreement",
            )
            cells = [spread(column(runs, name, row_name, key)) for key in keys]
            energy = (
                statistics.mean(float(figures["energy_pj"]) for figures in seeds.values()) / 1e6
            )
            rows.append([f"{label}, {DATASETS[name].title}", *cells, f"{energy:.2f}"])
    head = [
        "network",
        "float accuracy",
        "chip accuracy",
        "predictions that agree",
        "spikes that agree",
        "energy, µJ",
    ]
    return head, rows


def confusions(runs: RunFigures) -> Table:
    """Return the four pairs of classes that each network confuses most often on the chip."""
    rows = []
    for (name, row_name), seeds in runs.items():
        count_of_pair: dict[tuple[int, int], int] = {}
        for figures in seeds.values():
            for label_number, predicted in zip(
                figures.get("labels", []), figures.get("predictions", []), strict=True
            ):
                if label_number != predicted:
                    count_of_pair[label_number, predicted] = (
                        count_of_pair.get((label_number, predicted), 0) + 1
                    )
        if count_of_pair:
            worst = sorted(count_of_pair.items(), key=lambda item: (-item[1], item[0]))[:4]
            label = next(row.label for row in ROWS if row.name == row_name)
            pairs = ", ".join(
                f"{label_number} for {predicted}: {count}"
                for (label_number, predicted), count in worst
            )
            rows.append(
                [
                    f"{label}, {DATASETS[name].title}",
                    str(sum(count_of_pair.values())),
                    pairs.replace(" for ", " taken for "),
                ]
            )
    return ["network, on the chip, all seeds", "wrong", "most often"], rows


def commands(runs: RunFigures) -> Table:
    """Return the command that trains seed 0, for every row that has figures."""
    rows = [
        [command(row, DATASETS[name], 0)]
        for row in ROWS
        for name in DATASETS
        if (name, row.name) in runs
    ]
    return ["command"], rows


SOME_MISSING = """\
These networks have no figures, or figures of fewer than five seeds. The times are for one seed on one core:
"""
NO_SPLITS = "No network has been trained on all five splits. One split takes two to four minutes on one core."
NONE_MISSING = "Every row has all five seeds."


def missing(accuracy: Table) -> str:
    """Return a list of the rows without all seeds, by data set, with the minutes that a seed takes if they are known."""
    lines, row_of_label = [], {row.label: row for row in ROWS}
    for place, dataset in enumerate(DATASETS.values()):
        words = []
        for row in accuracy[1]:
            if (seeds_here := seeds_of(row[3 * place + 2])) < len(SEEDS):
                minutes = row_of_label[row[0]].minutes.get(dataset.name)
                notes = [f"{seeds_here} of {len(SEEDS)} seeds"] if seeds_here else []
                notes += [f"{minutes} min per seed"] if minutes else []
                words.append(f"{row[0]} ({', '.join(notes)})" if notes else row[0])
        lines += [f"- {dataset.title}: {'; '.join(words)}."] if words else []
    return "\n".join(lines)


TABLES: dict[str, Callable[[RunFigures], Table]] = {
    "accuracy": accuracy,
    "settings": settings,
    "chip": chip,
    "confusions": confusions,
    "operations": operations,
    "ratios": ratios,
    "chip-counts": chip_counts,
    "chip-ratios": chip_ratios,
    "commands": commands,
}
"""What makes the table in ``docs/research/results/NAME.csv``."""


def splits_beside_seeds(splits: Table | None, accuracy: Table) -> Table:
    """Return the accuracy on five splits of all recordings next to that of five seeds on the published split.

    Networks that were not trained on all five splits are left out.
    """
    head = [
        "network, data set",
        "published, two fingertips",
        "five splits",
        "five seeds, one split",
    ]
    on_splits = {name: cells for name, *cells in splits[1]} if splits else {}
    on_one_split = {row[0]: row for row in accuracy[1]}
    rows = []
    for row in ROWS:
        for place, dataset in enumerate(DATASETS.values()):
            name = f"{row.label}, {dataset.title}"
            cells = on_splits.get(name, [NOT_RUN])
            if NOT_RUN in cells:
                continue
            published = PAPERS_HYBRID.published[dataset.name]
            of_seeds = on_one_split[row.label][3 * place + 2]
            rows.append([name, published, spread([float(cell) for cell in cells]), of_seeds])
    return head, rows


PAPERS_HYBRID = next(row for row in ROWS if row.name == "hybrid")


def pages(tables: Mapping[str, Table], splits: Table | None) -> dict[str, str]:
    """Return the results page and the page of operations, by the file of their template."""
    ratio = {row[0]: row[2] for row in tables["ratios"][1]}
    short = {"hybrid": "Hybrid, lambda 1, loop", "window": "Window-SNN"}
    on_splits = splits_beside_seeds(splits, tables["accuracy"])
    values = {
        "accuracy": markdown(_on_page(tables["accuracy"])),
        "splits": markdown(on_splits) if on_splits[1] else NO_SPLITS,
        "costs": markdown(costs(tables["operations"])),
        "ratios": markdown(named(tables["ratios"])),
        "chip_ratios": markdown(named(tables["chip-ratios"])),
        "ann_table": markdown(ann_table()),
        "missing": f"{SOME_MISSING}\n{gaps}"
        if (gaps := missing(tables["accuracy"]))
        else NONE_MISSING,
    } | {
        f"{key}_{name}": ratio.get(f"{label}, {name.title()}, against CNN-3D", NOT_RUN)
        for key, label in short.items()
        for name in ("objects", "containers")
    }
    return {name: _filled(f"{name}_page.txt", values) for name in ("results", "operations")}


def _on_page(table: Table) -> Table:
    """Leave out rows that only the table's file holds."""
    left_out = {row.label for row in ROWS if not row.on_page}
    return table[0], [row for row in table[1] if row[0] not in left_out]


def _filled(template: str, values: Mapping[str, str]) -> str:
    text = Path(__file__).with_name(template).read_text(encoding="utf-8")
    for name, value in values.items():
        text = text.replace(f"{{{{{name}}}}}", value)
    return text
