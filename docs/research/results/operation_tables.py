"""Tables of operations: published ones next to ours, by the published method and by the chip, and ratios to artificial networks.

The published method counts multiplications and additions of artificial networks, and additions of spiking ones: spikes times
fan-out. ``operations.md`` is made of these tables.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from result_rows import DATASETS, ROWS, Dataset, Row
from tables import RunFigures, Table, of_seeds, spread

from locsnn_compile.baselines.operations import ann_counts, ann_operations
from locsnn_compile.data.sensor import neutouch

BRANCH_NAMES = {"time": "SNN_TSRM", "location": "SNN_LSRM"}
PUBLISHED_OPERATIONS = {
    "gru-mlp": ("11.87", "11.87", "5.48"),
    "cnn-3d": ("8.34", "8.14", "3.5"),
    "hybrid": ("0.60", "0.83", "0.045"),
}
"""Operations of Kang et al. (2022), in millions, for Objects, Containers and Slip."""
PUBLISHED_CASES = {"objects": (325, 36), "containers": (325, 20), "slip": (150, 2)}
"""Steps and classes of the recordings of two fingertips that they are for."""
PRINTED_RATIOS = ("9.80-14.30", "13.90-19.78", "77.78-121.78")

STEPS = {"objects": 250, "containers": 325, "slip": 150}
"""Time steps of one fingertip's recordings."""
HYBRID = "Hybrid, lambda 1, loop"
HYBRID_PARTS = ("SNN_TSRM", "SNN_LSRM", "events transposed")
"""The parts of a hybrid's operations, all of them additions, as ``operations.csv`` names them."""


def ann_table() -> Table:
    """Return the published operations next to ours, to the last digit, and the ratios as printed and corrected."""
    rows = []
    for name, label in (("gru-mlp", "GRU-MLP"), ("cnn-3d", "CNN-3D")):
        cells = [label]
        for printed, (steps, classes) in zip(
            PUBLISHED_OPERATIONS[name], PUBLISHED_CASES.values(), strict=True
        ):
            ours = ann_operations(name, fingertips=2, steps=steps, classes=classes)
            cells += [printed, f"{ours:,}"]
        rows.append(cells)
    rows.append(
        ["Hybrid", *(cell for printed in PUBLISHED_OPERATIONS["hybrid"] for cell in (printed, ""))]
    )
    rows.append(
        ["ratio as printed", *(cell for printed in PRINTED_RATIOS for cell in (printed, ""))]
    )
    rows.append(["ratio, corrected", *(cell for text in corrected_ratios() for cell in (text, ""))])
    head = ["network, two fingertips"]
    for name in PUBLISHED_CASES:
        head += [f"{name.title()}, 10^6, published", "ours, exactly"]
    return head, rows


def costs(operations: Table) -> Table:
    """Return multiplications and additions, and the shares of the hybrid's parts, for the input of one fingertip.

    ``operations``: the table with the additions of the hybrid, part by part. A data set that it lacks is left out.
    """
    means = {row[0]: row[1] for row in operations[1]}
    rows = []
    for dataset in DATASETS.values():
        title = f"{HYBRID}, {dataset.title}"
        together = means.get(f"{title}: together")
        if together is None:
            continue
        for name, label in (("gru-mlp", "GRU-MLP"), ("cnn-3d", "CNN-3D")):
            counts = ann_counts(
                name,
                sensor=neutouch(1),
                steps=STEPS[dataset.name],
                classes=dataset.published_classes,
            )
            numbers = [f"{counts.multiplications:,}", f"{counts.additions:,}"]
            rows.append([f"{label}, {dataset.title}", *numbers, "", "", ""])
        shares = [_number(means[f"{title}: {part}"]) / _number(together) for part in HYBRID_PARTS]
        rows.append([title, "0", together, *(f"{100 * share:.0f} %" for share in shares)])
    return ["network, one fingertip", "multiplications", "additions", *HYBRID_PARTS], rows


def _number(cell: str) -> float:
    return float(cell.replace(",", ""))


def corrected_ratios() -> list[str]:
    """Return the row of ratios that follows from the published operations: of the smaller and the larger network."""
    columns = zip(
        *(map(float, PUBLISHED_OPERATIONS[name]) for name in ("gru-mlp", "cnn-3d", "hybrid")),
        strict=True,
    )
    return [
        f"{min(gru, cnn) / hybrid:.2f}-{max(gru, cnn) / hybrid:.2f}" for gru, cnn, hybrid in columns
    ]


def quantiles(values: Sequence[float]) -> list[str]:
    """Return mean, median, 99th percentile and maximum."""
    array = np.asarray(values, dtype=float)
    return [
        f"{figure:,.0f}"
        for figure in (array.mean(), np.median(array), np.percentile(array, 99), array.max())
    ]


def operations(runs: RunFigures) -> Table:
    """Return the additions per recording of spiking networks, branch by branch, over test recordings and seeds."""
    rows = []
    for name, dataset in DATASETS.items():
        for row in ROWS:
            rows += _operation_rows(runs.get((name, row.name), {}), row, dataset)
    return ["network, test recordings of all seeds", "mean", "median", "99 %", "most"], rows


def _operation_rows(
    seeds: Mapping[int, Mapping[str, Any]], row: Row, dataset: Dataset
) -> list[list[str]]:
    """Return the rows of one network: its branches, transposed events, and their sum. None for networks without spikes."""
    measured = [f for f in seeds.values() if "additions" in f]
    if not measured:
        return []
    title = f"{row.label}, {dataset.title}"
    by_part = {
        axis: np.concatenate([f["additions"][axis] for f in measured])
        for axis in measured[0]["additions"]
    }
    rows = [
        [f"{title}: {_branch(row, axis)}", *quantiles(additions)]
        for axis, additions in by_part.items()
    ]
    if measured[0]["transposed"]:
        by_part["transposed"] = np.concatenate([f["transposed"] for f in measured])
        rows.append([f"{title}: events transposed", *quantiles(by_part["transposed"])])
    if len(by_part) > 1:
        rows.append([f"{title}: together", *quantiles(sum(by_part.values(), start=np.zeros(1)))])
    return rows


def _branch(row: Row, axis: str) -> str:
    """Return the name of a branch, the paper's if it is one of the paper's networks."""
    named = row.model in ("hybrid", "tactile-snn", "location-tactile-snn") and axis in BRANCH_NAMES
    return BRANCH_NAMES[axis] if named else f"{axis} branch"


def ratios(runs: RunFigures) -> Table:
    """Return operations of the artificial networks over ours, for the same input: on average, and for costly recordings."""
    rows = []
    for name, dataset in DATASETS.items():
        for row in (row for row in ROWS if row.model in ("hybrid", "window-snn")):
            for ann, label in (("gru-mlp", "GRU-MLP"), ("cnn-3d", "CNN-3D")):
                measured = [f for f in runs.get((name, row.name), {}).values() if "additions" in f]
                if measured:
                    rows.append(
                        [f"{row.label}, {dataset.title}, against {label}", *_ratios(measured, ann)]
                    )
    return ["networks", "operations of the ANN", "ratio, mean", "ratio, 99 %", "ratio, least"], rows


def _ratios(measured: Sequence[Mapping[str, Any]], ann: str) -> list[str]:
    first = measured[0]
    ann_ops = ann_operations(
        ann, fingertips=first["fingertips"], steps=first["steps"], classes=first["classes"]
    )
    our_ops = np.concatenate(
        [np.sum([*f["additions"].values(), f["transposed"]], axis=0) for f in measured]
    )
    return [
        f"{ann_ops:,}",
        *(
            f"{ann_ops / cost:.1f}"
            for cost in (our_ops.mean(), np.percentile(our_ops, 99), our_ops.max())
        ),
    ]


def chip_ratios(runs: RunFigures) -> Table:
    """Return operations of CNN-3D over the synaptic operations of the chip, for the same input, over recordings and seeds."""
    rows = []
    for (name, row_name), seeds in runs.items():
        measured = [f for f in seeds.values() if "synaptic_ops" in f]
        if measured:
            row = next(row for row in ROWS if row.name == row_name)
            kind = "networks joined" if row.parts else "one network"
            accuracy = spread([f["chip_accuracy"] for f in measured])
            rows.append(
                [f"{row.label}, {DATASETS[name].title}", kind, accuracy, *_chip_ratios(measured)]
            )
    counts = ["synaptic operations, mean", "synaptic operations, most"]
    return ["network", "kind", "accuracy on the chip", *counts, "ratio, mean", "ratio, least"], rows


def _chip_ratios(measured: Sequence[Mapping[str, Any]]) -> list[str]:
    first, our_ops = measured[0], np.concatenate([f["synaptic_ops"] for f in measured])
    ann_ops = ann_operations(
        "cnn-3d", fingertips=first["fingertips"], steps=first["steps"], classes=first["classes"]
    )
    counts, seeds_note = (our_ops.mean(), our_ops.max()), of_seeds(len(measured))
    return [
        *(f"{count:,.0f}{seeds_note}" for count in counts),
        *(f"{ann_ops / count:.1f}{seeds_note}" for count in counts),
    ]


def chip_counts(runs: RunFigures) -> Table:
    """Return the counts of the chip per recording, means over seeds."""
    rows = []
    for (name, row_name), seeds in runs.items():
        measured = [f["chip"] for f in seeds.values() if "chip" in f]
        if measured:
            label = next(row.label for row in ROWS if row.name == row_name)
            keys = ("synaptic_ops", "neuron_updates", "spikes", "input_events", "transpose_events")
            cells = [f"{statistics.mean(float(f[key]) for f in measured):,.0f}" for key in keys]
            rows.append([f"{label}, {DATASETS[name].title}", *cells])
    head = [
        "network",
        "synaptic operations",
        "compartment updates",
        "spikes",
        "input events",
        "transposed events",
    ]
    return head, rows


NAMED = (
    "Hybrid, lambda 1, loop",
    "Window-SNN, Objects",
    "Window-SNN, Containers",
    "Window-SNN, three quarters cut",
    "Window-SNN, trained with 2 bits",
    "Window-SNN, neighbouring levels",
    "Window-SNN and hybrid",
    "Three Window-SNNs and hybrid",
)
"""Networks whose ratios the page shows."""


def named(table: Table) -> Table:
    """Return the rows of the networks that are named on the page."""
    head, rows = table
    return head, [row for row in rows if row[0].startswith(NAMED) and "synthetic" not in row[0]]
