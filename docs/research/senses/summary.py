"""Sum up the table of trainings, and draw what a linear classifier tells from each view next to what branches learn.

    python docs/research/senses/summary.py

Reads ``trainings.csv`` and ``views.csv``; writes ``summary.csv``, ``../images/senses.svg`` and the
table of test figures of ``../senses.md``.
"""

import csv
import statistics
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from run_senses import HERE, SENSES
from trainings import read_rows
from views import WHOLE, read_figures

Row = Mapping[str, str]
OF_A_NETWORK = (
    "sense", "purpose", "network", "walk", "delays", "hidden", "options", "epochs",
)  # fmt: skip
"""Columns that identify a network; a line of the summary is the mean over its rounds, folds and seeds."""
MEASURED = (
    "float_accuracy",
    "chip_accuracy",
    "counts",
    "counts_in_bins",
    "energy_nj",
    "cores",
    "seconds",
)
TITLES = {
    "icub_grasp": "grasps",
    "fsdd": "spoken digits",
    "braille": "Braille",
    "nmnist": "N-MNIST",
}
BEGIN = "<!-- reported: begin -->\n"
END = "<!-- reported: end -->"
"""Marks of the table of test figures on the page."""
INK, ORANGE, GREEN = "#808080", "#d98324", "#3f9c5a"
BRANCHES = (
    ("tactile-snn", ORANGE, "time neurons, trained"),
    ("location-tactile-snn", GREEN, "location neurons, trained"),
)
"""Networks of one branch, and how they are drawn."""
STYLE = {
    "svg.fonttype": "none", "svg.hashsalt": "senses", "font.size": 9, "font.family": "sans-serif",
    "text.color": INK, "axes.labelcolor": INK, "axes.edgecolor": INK,
    "xtick.color": INK, "ytick.color": INK, "axes.spines.top": False, "axes.spines.right": False,
    "axes.titlesize": 10, "legend.frameon": False,
}  # fmt: skip


def summary(rows: Sequence[Row]) -> list[dict[str, str]]:
    """Return a line per network and purpose: means, and deviations of accuracies."""
    of_network: dict[tuple[str, ...], list[Row]] = defaultdict(list)
    for row in rows:
        of_network[tuple(row[name] for name in OF_A_NETWORK)].append(row)
    return [line(key, of_network[key]) for key in sorted(of_network)]


def line(key: Sequence[str], rows: Sequence[Row]) -> dict[str, str]:
    """Return the line of one network."""
    cells = dict(zip(OF_A_NETWORK, key, strict=True))
    cells["trainings"] = str(len(rows))
    for name in MEASURED:
        values = [float(row[name]) for row in rows]
        digits = 3 if "accuracy" in name or "counts" in name else 1
        cells[name] = f"{statistics.mean(values):.{digits}f}"
        if name.endswith("accuracy"):
            cells[f"{name}_sd"] = deviation(values)
    return cells


def deviation(values: Sequence[float]) -> str:
    """Return the sample standard deviation; an empty cell for a single value."""
    return f"{statistics.stdev(values):.3f}" if len(values) > 1 else ""


def write_summary(path: Path, lines: Sequence[Mapping[str, str]]) -> None:
    """Write the lines of the summary."""
    columns = [*OF_A_NETWORK, "trainings"]
    for name in MEASURED:
        columns.append(name)
        if name.endswith("accuracy"):
            columns.append(f"{name}_sd")
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)


def reported_table(lines: Sequence[Mapping[str, str]]) -> str:
    """Return the table of the page: networks that played the test parts, the most accurate of each set first."""
    rows = [
        "| set | network | trainings | float | on the chip | deviation | nJ a recording | cores |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    reported = [cells for cells in lines if cells["purpose"] == "report"]
    for sense in SENSES:
        of_sense = [cells for cells in reported if cells["sense"] == sense]
        for cells in sorted(of_sense, key=lambda each: -float(each["chip_accuracy"])):
            of_row = [TITLES[sense], in_words(cells), cells["trainings"]]
            of_row += [cells["float_accuracy"], cells["chip_accuracy"], cells["chip_accuracy_sd"]]
            of_row += [f"{float(cells['energy_nj']):,.0f}", f"{float(cells['cores']):.1f}"]
            rows.append(f"| {' | '.join(of_row)} |")
    return "\n".join(rows) + "\n"


def in_words(cells: Mapping[str, str]) -> str:
    """Return a description of a network: its name, neurons and delays if they are not the default, and its options."""
    words = [f"`{cells['network']}`"]
    if cells["hidden"] != "0":
        words.append(f"{cells['hidden']} neurons")
    if cells["delays"]:
        delays = cells["delays"].split()
        words.append(f"delays of {delays[0]} to {delays[-1]} steps")
    words.append("default options" if cells["options"] == "{}" else "chosen options")
    return ", ".join(words)


def write_reported(page: Path, table: str) -> None:
    """Put the table between its marks on the page."""
    text = page.read_text("utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    page.write_text(before + BEGIN + table + END + after, "utf-8")


def draw(figures: Sequence[Row], lines: Sequence[Row], path: Path) -> None:
    """Draw, for each set, the accuracy of both views against the width of their bins.

    Next to it, as dots, what a branch of that kind reaches: the best of its ``lines`` of the summary.
    """
    mpl.use("svg")
    with mpl.rc_context(STYLE):
        figure, panels = plt.subplots(1, len(SENSES), figsize=(10.4, 3.0), layout="constrained")
        for axes, sense in zip(panels, SENSES, strict=True):
            draw_views(axes, [row for row in figures if row["sense"] == sense])
            draw_branches(axes, [row for row in lines if row["sense"] == sense])
            axes.set(title=TITLES[sense], ylim=(0, 1), xlabel="width of a bin")
        panels[0].set_ylabel("accuracy, held out")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
        figure.savefig(path, transparent=True, metadata={"Date": None})
        plt.close(figure)


def draw_views(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw the views of one set: a line for time, and one per walk, the best one in front."""
    if not rows:
        axes.text(0.5, 0.5, "not run", transform=axes.transAxes, ha="center")
        return
    widths = sorted({int(row["width"]) for row in rows} - {WHOLE})
    ticks = [*map(str, widths), "all"]
    time = [mean_of(rows, "time", "", width) for width in (*widths, WHOLE)]
    whole = mean_of(rows, "location", "", WHOLE)
    walks = sorted({row["walk"] for row in rows} - {""})
    along = {
        walk: [*(mean_of(rows, "location", walk, width) for width in widths), whole]
        for walk in walks
    }
    # By the widest bins but those that hold everything.
    best = max(walks, key=lambda walk: along[walk][-2])
    for walk in walks:
        axes.plot(ticks, along[walk], color=GREEN, linewidth=0.7, alpha=0.5)
    axes.plot(ticks, time, color=ORANGE, label="every channel, coarse time")
    axes.plot(
        ticks, along[best], color=GREEN, label="every step, coarse location (thin: all walks)"
    )
    axes.annotate(best, (ticks[-2], along[best][-2]), color=GREEN, fontsize=8)


def draw_branches(axes: Axes, lines: Sequence[Row]) -> None:
    """Draw the best accuracy of networks of one branch alone, without delays, which are beyond what a view has."""
    for network, colour, label in BRANCHES:
        accuracies = [
            float(row["float_accuracy"])
            for row in lines
            if (row["network"], row["purpose"], row["delays"]) == (network, "choose", "")
            and "location_delays" not in row["options"]
        ]
        if accuracies:
            axes.plot(["trained"], [max(accuracies)], "o", color=colour, label=label)


def mean_of(rows: Sequence[Row], axis: str, walk: str, width: int) -> float:
    """Return the mean accuracy of a view over folds."""
    return statistics.mean(
        float(row["accuracy"])
        for row in rows
        if (row["axis"], row["walk"], row["width"]) == (axis, walk, str(width))
    )


def main() -> None:
    """Write the summary and the picture."""
    lines = summary(read_rows(HERE / "trainings.csv"))
    write_summary(HERE / "summary.csv", lines)
    write_reported(HERE.parent / "senses.md", reported_table(lines))
    draw(read_figures(HERE / "views.csv"), lines, HERE.parent / "images/senses.svg")


if __name__ == "__main__":
    main()
