"""What a time branch and a location branch can see, measured without training them.

    python docs/research/senses/views.py --data FOLDER

A time neuron has a weight per channel, and its kernel smears time; a location neuron has a weight
per step, and its kernel smears the *walk*, the order in which it visits the channels. So a time
neuron knows every channel at a coarse time, and a location neuron every step at a coarse place on
the walk. Here ridge regression gets numbers of events at both resolutions: of every channel in bins
of some steps, or of every step in bins of some channels along a walk. What it cannot tell apart, a
branch of that kind can hardly tell apart either.

Rows that the table has are not computed again. Only folds of the train part are used.
"""

import argparse
import csv
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
from run_senses import HERE, ROOT, SENSES
from sense import Parts, Sense

from hw_model.values import ByteArray, FloatArray, Frozen
from locsnn_compile.data.orders import channel_walk, location_order
from locsnn_compile.training.event_counts import ridge_scores

WIDTHS = (5, 20)
"""Widths of bins: the kernel of the networks (``tau_sr`` 10) has its peak at 10, its mean at 20."""
WHOLE = 0
"""The width of a bin that holds everything."""
WALKS: Mapping[str, tuple[str, ...]] = {
    "icub_grasp": ("loop", "reverse", "raster", "snake", "hilbert", "spiral", "tour"),
    "fsdd": ("loop", "reverse", "spiral"),
    "braille": ("loop", "reverse", "raster", "snake", "hilbert", "spiral", "tour"),
    "nmnist": ("raster", "reverse", "snake", "hilbert", "spiral", "tour"),
}


class View(Frozen, eq=True):
    """What is counted: every channel in bins of ``width`` steps, or every step in bins of channels.

    ``axis``: the axis that is smeared, ``time`` or ``location``, as that of a branch. ``walk``: the
    order of the channels; empty if it does not matter. ``width`` 0: one bin for all.
    """

    axis: str
    walk: str
    width: int


class Figure(Frozen):
    """The accuracy of ridge regression on a view of a fold of the train part."""

    sense: str
    axis: str
    walk: str
    width: int
    fold: int
    counts: int
    accuracy: float


def views(sense: str) -> Iterator[View]:
    """Yield the views of a set."""
    for width in (WHOLE, *WIDTHS):
        yield View("time", "", width)
    yield View("location", "", WHOLE)
    for walk in WALKS[sense]:
        for width in WIDTHS:
            yield View("location", walk, width)


def counts(spikes: ByteArray, view: View, walk: np.ndarray | None) -> FloatArray:
    """Return the counts (samples, bins * other axis) of spikes (samples, steps, channels)."""
    # Bring the axis that is smeared to the middle, in the order of the walk.
    smeared = spikes
    if view.axis == "location":
        ordered = spikes if walk is None else spikes[:, :, walk]
        smeared = ordered.transpose(0, 2, 1)
    length = smeared.shape[1]
    starts = np.arange(0, length, view.width or length)
    binned = np.add.reduceat(smeared, starts, axis=1, dtype=np.float64)
    return np.asarray(binned.reshape(len(spikes), -1))


def measure(sense: Sense, view: View, parts: Parts, data: Path, fold: int) -> Figure:
    """Return the accuracy of ridge regression that learned from one part and is measured on the other."""
    layout = sense.sensor(data)
    walk = None
    if view.walk and layout is not None:
        _, taxels = location_order(view.walk, layout)
        walk = channel_walk(taxels, layout)
    learned_counts = counts(parts.learned.spikes, view, walk)
    measured_counts = counts(parts.measured.spikes, view, walk)
    labels = parts.learned.needed_labels("learn from")
    truth = parts.measured.needed_labels("measure with")
    predicted = ridge_scores(learned_counts, labels, measured_counts).argmax(axis=1)
    return Figure(
        sense=sense.name,
        axis=view.axis,
        walk=view.walk,
        width=view.width,
        fold=fold,
        counts=learned_counts.shape[1],
        accuracy=round(float((predicted == truth).mean()), 4),
    )


def main() -> None:
    """Compute the rows that the table lacks."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data")
    parser.add_argument("--table", type=Path, default=HERE / "views.csv")
    parser.add_argument("--senses", nargs="*", choices=list(SENSES), default=list(SENSES))
    parser.add_argument("--folds", nargs="*", type=int, default=[1, 2, 3, 4])
    arguments = parser.parse_args()
    rows = read_figures(arguments.table)
    names = ("sense", "axis", "walk", "width", "fold")
    known = {tuple(str(row[name]) for name in names) for row in rows}
    for name in arguments.senses:
        sense = SENSES[name]
        for fold in arguments.folds:
            missing = [
                view
                for view in views(name)
                if (name, view.axis, view.walk, str(view.width), str(fold)) not in known
            ]
            if not missing:
                continue
            parts = sense.to_choose(arguments.data, 1, fold)
            for view in missing:
                figure = measure(sense, view, parts, arguments.data, fold)
                rows.append(asdict(figure))
                print(figure, flush=True)
            write_figures(arguments.table, rows)


def read_figures(table: Path) -> list[dict[str, str]]:
    """Return the rows of a table, none if there is no such file."""
    if not table.exists():
        return []
    with table.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def write_figures(table: Path, rows: list[dict[str, object]]) -> None:
    """Write all rows."""
    columns = [field.name for field in fields(Figure)]
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
