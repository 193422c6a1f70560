"""The picture of the benchmarks page: time per recording by tool, and cost against size and activity."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

INK = "#808080"
"""Text and axes: readable on white and on black."""
OURS, FIRST, SECOND = "#2f81c7", "#d98324", "#3f9c5a"
STYLE = {
    "svg.fonttype": "none", "svg.hashsalt": "benchmarks", "font.size": 9, "font.family": "sans-serif",
    "text.color": INK, "axes.labelcolor": INK, "axes.edgecolor": INK, "xtick.color": INK, "ytick.color": INK,
    "axes.spines.top": False, "axes.spines.right": False, "axes.titlesize": 10, "legend.frameon": False,
}  # fmt: skip


def draw(records: dict[str, Any], path: Path) -> None:
    """Draw the three panels as SVG on a transparent background; the same figures give the same bytes."""
    mpl.use("svg")
    with mpl.rc_context(STYLE):
        figure, panels = plt.subplots(
            1, 3, figsize=(11, 3.4), width_ratios=(1.25, 1, 1), layout="constrained"
        )
        tools(panels[0], [records[f"side_by_side_{name}"] for name in ("small", "large")])
        size(panels[1], records["sizes"]["sizes"])
        activity(
            panels[2], {kind: records[f"activity_{kind}"]["rates"] for kind in ("dense", "local")}
        )
        for panel in panels:
            panel.minorticks_off()
        figure.savefig(path, transparent=True, metadata={"Date": None})
        plt.close(figure)


def tools(axes: Axes, workloads: list[dict[str, Any]]) -> None:
    """Draw the time of a recording, a row for each tool and a mark for each network."""
    labels = [f"{row['tool']}, {short(row['mode'])}" for row in workloads[0]["rows"]]
    for workload, marker, colour in zip(workloads, "os", (FIRST, SECOND), strict=True):
        seconds = [row["seconds"] for row in workload["rows"]]
        axes.plot(
            seconds, range(len(seconds)), marker, color=colour, label=workload["name"], markersize=5
        )
    axes.set_xscale("log")
    axes.set_yticks(range(len(labels)), labels)
    axes.invert_yaxis()
    axes.grid(axis="x", color=INK, alpha=0.25)
    axes.set(title="seconds per recording")
    axes.legend(loc="upper right")


def short(mode: str) -> str:
    """Return a mode without the batch size, which differs from network to network."""
    return "batch" if mode.startswith("batch") else mode


def size(axes: Axes, found: list[dict[str, Any]]) -> None:
    """Draw the time of a recording against compartments, next to a straight line through the first size."""
    compartments = [m["compartments"] for m in found]
    seconds = [m["seconds"] * 1e3 for m in found]
    axes.loglog(compartments, seconds, "o-", color=OURS, markersize=4, label="hw_model")
    axes.loglog(
        compartments,
        [seconds[0] * n / compartments[0] for n in compartments],
        ":",
        color=INK,
        label="linear",
    )
    axes.grid(color=INK, alpha=0.25)
    axes.set(title="ms per recording", xlabel="compartments, 2 % of them firing")
    axes.legend(loc="upper left")


def activity(axes: Axes, kinds: dict[str, list[dict[str, Any]]]) -> None:
    """Draw the time of a recording against synaptic operations."""
    for (kind, found), colour in zip(kinds.items(), (FIRST, SECOND), strict=True):
        ops, seconds = [m["synaptic_ops"] for m in found], [m["seconds"] * 1e3 for m in found]
        axes.loglog(ops, seconds, "o-", color=colour, markersize=4, label=kind)
    axes.grid(color=INK, alpha=0.25)
    axes.set(title="ms per recording", xlabel="synaptic operations per recording")
    axes.legend(loc="upper left")
