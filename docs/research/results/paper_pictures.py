"""Pictures of the results pages, and the table of the data, from figures that are there; no network is trained or played.

    python docs/research/results/paper_pictures.py --data FOLDER

The orders drawn on the taxels, operations as bars, confusions with containers and fill levels apart, how training went, energy
against accuracy, learning curves, and a table of the data. A picture whose figures are missing is not drawn again.
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from operation_tables import HYBRID, HYBRID_PARTS, STEPS
from result_pictures import INK, STYLE, _save
from result_rows import DATASETS, Dataset
from tables import Table, read_table, write_table

from locsnn_compile.baselines.operations import ann_counts
from locsnn_compile.data.orders import location_order
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.sensor import TAXEL_COORDINATES_MM, neutouch

ROOT = Path(__file__).parents[3]
BLUE, ORANGE, GREEN, VIOLET = "#2f81c7", "#d98324", "#3f9c5a", "#8a4fbf"
ORDERS = ("loop", "arch", "whorl")
CONTAINERS, LEVELS = 4, 5
"""Classes of Containers are level + LEVELS * container."""


def orders() -> Figure:
    """Draw the orders of the paper over the taxels of a fingertip; a ring marks the first taxel and a dot the last."""
    figure, panels = plt.subplots(1, len(ORDERS), figsize=(7.6, 3.6), layout="constrained")
    place = np.array(TAXEL_COORDINATES_MM)
    for axes, order in zip(panels, ORDERS, strict=True):
        _, taxels = location_order(order, neutouch(1))
        walk = place[np.asarray(taxels) - 1]
        axes.plot(*walk.T, color=BLUE, linewidth=1.1, zorder=1)
        axes.scatter(*walk.T, s=9, color=INK, zorder=2)
        axes.scatter(*walk[0], s=55, facecolors="none", edgecolors=ORANGE, linewidths=1.6, zorder=3)
        axes.scatter(*walk[-1], s=40, color=ORANGE, zorder=3)
        axes.set(title=order, aspect="equal", xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
    return figure


PARTS = tuple(zip(HYBRID_PARTS, (ORANGE, GREEN, VIOLET), strict=True))


def operations(tables: Path) -> Figure | None:
    """Draw operations per recording of one fingertip, on linear axes.

    Above, multiplications and additions of the artificial networks next to the hybrid; below, what the hybrid's additions are for.
    """
    counted = read_table(tables / "operations.csv")
    if counted is None:
        return None
    means = {row[0]: _number(row[1]) for row in counted[1]}
    figure, panels = plt.subplots(
        2, len(DATASETS), figsize=(8.4, 3.9), layout="constrained", height_ratios=(3, 2)
    )
    for (above, below), dataset in zip(panels.T, DATASETS.values(), strict=True):
        parts = {part: means.get(f"{HYBRID}, {dataset.title}: {part}") for part, _ in PARTS}
        if None in parts.values():
            plt.close(figure)
            return None
        additions = {part: number for part, number in parts.items() if number is not None}
        _draw_networks(above, dataset, sum(additions.values()))
        _draw_shares(below, additions)
    figure.legend(
        *panels[0][0].get_legend_handles_labels(), loc="outside upper right", ncols=2, fontsize=8
    )
    figure.legend(
        *panels[1][0].get_legend_handles_labels(), loc="outside lower center", ncols=len(PARTS)
    )
    return figure


def _draw_networks(axes: Axes, dataset: Dataset, hybrid_additions: float) -> None:
    """Draw multiplications and additions of the artificial networks and of the hybrid, in millions."""
    networks = {
        label: ann_counts(
            name,
            sensor=neutouch(1),
            steps=STEPS[dataset.name],
            classes=dataset.published_classes,
        )
        for name, label in (("gru-mlp", "GRU-MLP"), ("cnn-3d", "CNN-3D"))
    }
    labels = [*networks, "Hybrid"]
    multiplications = np.array([counts.multiplications for counts in networks.values()] + [0]) / 1e6
    additions = np.array([c.additions for c in networks.values()] + [hybrid_additions]) / 1e6
    axes.barh(labels, multiplications, color=INK, label="multiplications")
    axes.barh(labels, additions, left=multiplications, color=BLUE, label="additions")
    together = multiplications + additions
    for place, million in enumerate(together):
        axes.text(million + 0.02 * together.max(), place, f"{million:.2f}", va="center")
    axes.set(title=dataset.title, xlabel="operations, 10^6", xlim=(0, 1.25 * together.max()))
    axes.invert_yaxis()


def _draw_shares(axes: Axes, additions: Mapping[str, float]) -> None:
    """Draw the share of each part of the hybrid in its additions."""
    together, left = sum(additions.values()), 0.0
    for part, colour in PARTS:
        share = 100 * additions[part] / together
        axes.barh(["Hybrid"], [share], left=left, color=colour, label=part)
        if share > 5:
            axes.text(left + share / 2, 0, f"{share:.0f} %", ha="center", va="center", color="w")
        left += share
    axes.set(xlabel="share of its additions, %", xlim=(0, 100))


def _number(text: str) -> float:
    return float(text.replace(",", ""))


def counts_of(files: Sequence[Path]) -> np.ndarray[Any, Any] | None:
    """Return how often each label (row) was predicted as each class (column), over files of figures; None without files."""
    runs = [json.loads(path.read_text(encoding="utf-8")) for path in files]
    if not runs:
        return None
    counts = np.zeros((runs[0]["classes"],) * 2)
    for run in runs:
        np.add.at(counts, (run["labels"], run["predictions"]), 1)
    return counts


def apart(counts: np.ndarray[Any, Any]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return the counts of 20 classes summed up to counts of containers, and to counts of fill levels."""
    four = counts.reshape(CONTAINERS, LEVELS, CONTAINERS, LEVELS)
    return four.sum(axis=(1, 3)), four.sum(axis=(0, 2))


def levels(work: Path) -> Figure | None:
    """Draw confusions on the chip with containers and fill levels apart: the paper's two networks, and the best."""
    named = {
        "Tactile-SNN": "tactile-snn",
        "Hybrid": "hybrid",
        "Window-SNN, levels": "window-snn-levels",
    }
    counts = {
        label: counts_of(sorted(work.glob(f"containers-{row}-[0-9].json")))
        for label, row in named.items()
    }
    if any(found is None for found in counts.values()):
        return None
    figure, panels = plt.subplots(2, len(counts), figsize=(7.6, 5.2), layout="constrained")
    for column, (label, found) in zip(panels.T, counts.items(), strict=True):
        assert found is not None
        for axes, part, what in zip(column, apart(found), ("container", "fill level"), strict=True):
            _matrix(axes, part, what)
        column[0].set_title(f"{label}\n{int(found.sum())} predictions")
    return figure


def containers(work: Path) -> Figure | None:
    """Draw all 20 classes of Containers on the chip: Tactile-SNN next to the hybrid, for the seeds that both have."""
    seeds = {row: _seeds_of(work, row) for row in ("tactile-snn", "hybrid")}
    shared = sorted(set.intersection(*seeds.values()))
    if not shared:
        return None
    figure, panels = plt.subplots(1, len(seeds), figsize=(7.6, 4.2), layout="constrained")
    for axes, row, label in zip(panels, seeds, ("Tactile-SNN", "Hybrid"), strict=True):
        counts = counts_of([work / f"containers-{row}-{seed}.json" for seed in shared])
        assert counts is not None
        axes.imshow(counts / counts.sum(axis=1, keepdims=True), cmap="Blues", vmin=0, vmax=1)
        right = np.trace(counts) / counts.sum()
        axes.set(
            title=f"{label}\n{right:.2f} of {int(counts.sum())} predictions right",
            xlabel="class predicted",
            ylabel="class",
            xticks=range(0, len(counts), LEVELS),
            yticks=range(0, len(counts), LEVELS),
        )
    return figure


def _seeds_of(work: Path, row: str) -> set[int]:
    """Return the seeds of Containers that have figures."""
    return {int(path.stem[-1]) for path in work.glob(f"containers-{row}-[0-9].json")}


def objects(work: Path) -> Figure | None:
    """Draw confusions of Objects on the chip: the paper's hybrid first, then the best network."""
    named = {
        "Hybrid": sorted(work.glob("predicted-objects-hybrid.json")),
        "Three Window-SNNs and hybrid": sorted(
            work.glob("objects-three-windows-and-trained-hybrid-[0-9].json")
        ),
    }
    counts = {label: counts_of(files) for label, files in named.items()}
    if any(found is None for found in counts.values()):
        return None
    figure, panels = plt.subplots(1, len(counts), figsize=(7.6, 4.2), layout="constrained")
    for axes, (label, found) in zip(panels, counts.items(), strict=True):
        assert found is not None
        axes.imshow(found / found.sum(axis=1, keepdims=True), cmap="Blues", vmin=0, vmax=1)
        axes.set(
            title=f"{label}\n{int(found.sum())} predictions",
            xlabel="object predicted",
            ylabel="object",
        )
        axes.set(xticks=range(0, len(found), 5), yticks=range(0, len(found), 5))
    return figure


def _matrix(axes: Axes, part: np.ndarray[Any, Any], what: str) -> None:
    """Draw a confusion matrix in shares of each row, with numbers in cells that do not round to 0.00."""
    shares = part / part.sum(axis=1, keepdims=True)
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1)
    for row, column in np.argwhere(shares >= 0.005):
        ink = "white" if shares[row, column] > 0.6 else "#404040"
        axes.text(
            column,
            row,
            f"{shares[row, column]:.2f}",
            ha="center",
            va="center",
            color=ink,
            fontsize=7,
        )
    axes.set(
        xlabel=f"{what} predicted", ylabel=what, xticks=range(len(part)), yticks=range(len(part))
    )


def profiles(work: Path) -> Figure | None:
    """Draw how training went: loss and validation accuracy by epoch, seed 0, in the phase that chooses the epoch."""
    logs = {"Tactile-SNN": "containers-tactile-snn-0.csv", "Hybrid": "containers-hybrid-0.csv"}
    read = {label: _log(work / name) for label, name in logs.items() if (work / name).exists()}
    if len(read) < len(logs):
        return None
    figure, panels = plt.subplots(1, 2, figsize=(7.6, 2.8), layout="constrained")
    for (label, log), colour in zip(read.items(), (ORANGE, BLUE), strict=True):
        panels[0].plot(log["loss"], color=colour, linewidth=1.2, label=f"{label}, training")
        panels[0].plot(
            log["validation_loss"], ":", color=colour, linewidth=1.2, label=f"{label}, validation"
        )
        panels[1].plot(log["validation_accuracy"], color=colour, linewidth=0.9, label=label)
    panels[0].set(title="Containers, loss", xlabel="epoch", ylim=(0, None))
    panels[1].set(title="Containers, validation accuracy", xlabel="epoch", ylim=(0, 1))
    for axes in panels:
        axes.legend(fontsize=7)
    return figure


def _log(path: Path) -> Mapping[str, list[float]]:
    """Return the curves of a training log, of the phase that chooses the epoch."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["phase"] == "select"]
    return {
        key: [float(row[key]) for row in rows]
        for key in ("loss", "validation_loss", "validation_accuracy")
    }


def curves(tables: Path) -> Figure | None:
    """Draw learning curves with their 95 % intervals."""
    table = read_table(tables / "learning-curve.csv")
    if table is None:
        return None
    figure, axes = plt.subplots(figsize=(5.2, 3.2), layout="constrained")
    for name, colour in (("Objects", BLUE), ("Containers", ORANGE)):
        rows = [list(map(float, row[2:])) for row in table[1] if row[0] == name]
        if rows:
            learned, _, right, low, high = np.array(rows).T
            axes.errorbar(
                learned,
                right,
                (right - low, high - right),
                color=colour,
                marker="o",
                capsize=3,
                label=name,
            )
    axes.set(
        xlabel="recordings to learn from", ylabel="accuracy, held out", xscale="log", ylim=(0.4, 1)
    )
    axes.set_xticks([45, 90, 180, 216, 432], [45, 90, 180, 216, 432])
    axes.minorticks_off()
    axes.legend()
    return figure


def front(tables: Path) -> Figure | None:
    """Draw energy against accuracy on the chip, and the line of points that no other point beats in both."""
    table = read_table(tables / "front.csv")
    if table is None:
        return None
    figure, panels = plt.subplots(1, 2, figsize=(8.4, 3.6), layout="constrained")
    for axes, name in zip(panels, ("Objects", "Containers"), strict=True):
        rows = [row for row in table[1] if row[0] == name]
        kinds = {row[2]: None for row in table[1]}
        for kind, colour, marker in zip(
            kinds, (INK, ORANGE, BLUE, VIOLET), ("o", "s", "D", "^"), strict=False
        ):
            points = [
                (float(row[5]), float(row[4].split(" ")[0])) for row in rows if row[2] == kind
            ]
            if points:
                axes.scatter(*np.array(points).T, color=colour, marker=marker, s=26, label=kind)
        best, line = 0.0, []
        for energy, right in sorted((float(row[5]), float(row[4].split(" ")[0])) for row in rows):
            if right > best:
                best, line = right, [*line, (energy, right)]
        axes.plot(*np.array(line).T, color=INK, linewidth=0.8, drawstyle="steps-post", zorder=0)
        axes.set(title=name, xlabel="energy per recording, µJ", ylabel="accuracy on the chip")
    named = {
        label: handle
        for axes in panels
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(named.values(), named, loc="outside lower center", ncols=4)
    return figure


def data_table(data: Path) -> Table:
    """Return the table of the data: numbers of recordings, classes, steps, channels and events of each part."""
    rows = []
    for name in ("Objects", "Containers"):
        for split in ("train", "test"):
            recordings = read_recordings(data / f"Ev-{name}.zip", split=split)
            assert recordings.labels is not None
            events = recordings.spikes.sum(axis=(1, 2), dtype=np.int64)
            first_steps = recordings.spikes.any(axis=2).argmax(axis=1)
            samples, steps, channels = recordings.spikes.shape
            recordings_of_class = np.bincount(recordings.labels)
            rows.append(
                [f"{name}, {split}", str(samples), str(len(recordings_of_class)), str(recordings_of_class[0]), str(steps), f"{0.02 * steps:g}",
                 str(channels), f"{events.mean():,.0f}", f"{events.min():,}", f"{events.max():,}", f"{first_steps.mean():.0f}"]
            )  # fmt: skip
    head = ["set", "recordings", "classes", "of a class", "steps", "seconds", "channels"]
    return [
        *head,
        "events, mean",
        "events, least",
        "events, most",
        "first event at step, mean",
    ], rows


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data/neutouch")
    parser.add_argument("--work", type=Path, default=ROOT / "runs/results")
    parser.add_argument("--docs", type=Path, default=ROOT / "docs/research")
    args = parser.parse_args(arguments)
    mpl.use("svg")
    tables = args.docs / "results"
    with mpl.rc_context(STYLE):
        drawn = {
            "orders": orders(), "operations": operations(tables), "levels": levels(args.work), "objects": objects(args.work),
            "containers": containers(args.work), "profiles": profiles(args.work), "learning-curve": curves(tables), "front": front(tables),
        }  # fmt: skip
        for name, figure in drawn.items():
            if figure is not None:
                _save(figure, args.docs / f"images/results-{name}.svg")
    write_table(tables / "data.csv", data_table(args.data))


if __name__ == "__main__":
    main()
