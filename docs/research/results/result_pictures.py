"""Pictures of the results page: accuracy over time, and confusions, as SVG on a transparent ground."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from result_rows import DATASETS, SEEDS
from tables import RunFigures

INK = "#808080"
STYLE = {
    "svg.fonttype": "none", "svg.hashsalt": "results", "font.size": 9, "font.family": "sans-serif",
    "text.color": INK, "axes.labelcolor": INK, "axes.edgecolor": INK, "xtick.color": INK, "ytick.color": INK,
    "axes.spines.top": False, "axes.spines.right": False, "axes.titlesize": 10, "legend.frameon": False,
}  # fmt: skip
LINES = {
    "time": ("O1, time branch", "#d98324", "--"), "location": ("O2, location branch", "#3f9c5a", ":"),
    "together": ("O, both", "#2f81c7", "-"), "time_weighted": ("O_tw, time-weighted", "#8a4fbf", "-."),
}  # fmt: skip
SHOWN = "hybrid"
"""The row of ``result_rows.py`` that is drawn."""


def draw(runs_of_all: RunFigures, folder: Path) -> None:
    """Draw both pictures, if every data set has all seeds of the row; the same figures give the same bytes."""
    mpl.use("svg")
    runs_of_dataset = {
        name: list(seeds.values()) for (name, row), seeds in runs_of_all.items() if row == SHOWN
    }
    if [len(runs) for runs in runs_of_dataset.values()] != [len(SEEDS)] * len(DATASETS):
        return
    folder.mkdir(exist_ok=True)
    with mpl.rc_context(STYLE):
        _save(_over_time(runs_of_dataset), folder / "results-over-time.svg")
        _save(_confusion(runs_of_dataset), folder / "results-confusion.svg")


def _save(figure: Figure, path: Path) -> None:
    """Write a figure as SVG without a date, so that equal figures are equal files."""
    figure.savefig(path, transparent=True, metadata={"Date": None})
    plt.close(figure)


def _over_time(shown: Mapping[str, list[Mapping[str, Any]]]) -> Figure:
    """Draw the accuracy after each step, a panel for each data set and a line for each branch, means over seeds."""
    figure, panels = plt.subplots(
        1, len(shown), figsize=(4.6 * len(shown), 3.4), layout="constrained", squeeze=False
    )
    for axes, (name, runs) in zip(panels[0], shown.items(), strict=True):
        for key, (label, colour, style) in LINES.items():
            curves = [run["right"][key] for run in runs if key in run["right"]]
            if curves:
                axes.plot(np.mean(curves, axis=0), style, color=colour, label=label, linewidth=1.4)
        axes.set(
            title=f"{DATASETS[name].title}, psi {runs[0]['psi']:g}",
            xlabel="time steps seen",
            ylabel="accuracy",
            ylim=(0, 1),
        )
    figure.legend(
        *panels[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=len(LINES)
    )
    return figure


def _confusion(shown: Mapping[str, list[Mapping[str, Any]]]) -> Figure:
    """Draw which class is taken for which, a panel for each data set, over all seeds."""
    figure, panels = plt.subplots(
        1, len(shown), figsize=(4.6 * len(shown), 4.2), layout="constrained", squeeze=False
    )
    for axes, (name, runs) in zip(panels[0], shown.items(), strict=True):
        classes = runs[0]["classes"]
        counts = np.zeros((classes, classes))
        for run in runs:
            np.add.at(counts, (run["labels"], run["predictions"]), 1)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        axes.imshow(counts / counts.sum(axis=1, keepdims=True), cmap="Blues", vmin=0, vmax=1)
        axes.set(title=f"{DATASETS[name].title}, on the chip", xlabel="predicted", ylabel="class")
    return figure
