"""Classes by their nearest prototype, the mean of their recordings, on the folds of ``try_training.py``: no training at all.

    python tests/results/try_prototypes.py --data FOLDER

Recordings are spikes of windows, as `window-snn` hears them. Distances are plain, or whitened by how recordings differ from the
prototype of their class: those of this set, or of both (Objects and Containers share the sensor, not the classes). **The test
part is never read.**
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from results_page import write_table
from try_training import FOLDS, ROOT, folds

from locsnn_compile.data.read import read_recordings

STEPS, STRIDE, ROWS = 6, 3, 250
SMOOTH = (0.1, 0.3, 1.0, 3.0)
"""How much of the plain distance is in a whitened one, in units of the mean variance."""
Floats = NDArray[np.float64]


def windows(spikes: NDArray[np.uint8]) -> Floats:
    """Return which channel had an event in which window of the first ``ROWS`` steps, (samples, windows * channels)."""
    events = np.cumsum(np.pad(spikes[:, :ROWS].astype(np.int32), ((0, 0), (1, 0), (0, 0))), axis=1)
    starts = np.arange(0, ROWS - STEPS + 1, STRIDE)
    return (events[:, starts + STEPS] > events[:, starts]).reshape(len(spikes), -1).astype(np.float64)


def prototypes(x: Floats, labels: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Return the mean of each class, and how every recording differs from its own."""
    means = np.stack([x[labels == label].mean(axis=0) for label in np.unique(labels)])
    return means, x - means[labels]


def nearest(x: Floats, means: Floats, apart: Floats, smooth: float | None) -> NDArray[np.int64]:
    """Return the class of the nearest mean; the metric is (smooth * v I + apart^T apart / n)^-1 where ``smooth`` is given."""
    if smooth is None:
        scores = x @ means.T - 0.5 * (means**2).sum(axis=1)
        return np.asarray(scores.argmax(axis=1))
    scale = smooth * (apart**2).sum() / len(apart) / len(apart)
    inner = np.linalg.inv(scale * len(apart) * np.eye(len(apart)) + apart @ apart.T)
    turned = means - (means @ apart.T) @ inner @ apart
    scores = x @ turned.T - 0.5 * (means * turned).sum(axis=1)
    return np.asarray(scores.argmax(axis=1))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data/neutouch")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--table", type=Path)
    args = parser.parse_args(arguments)
    sets = {}
    for name in ("objects", "containers"):
        recordings = read_recordings(args.data / f"Ev-{name.title()}.zip", split="train")
        # Containers begin to be touched two seconds later than Objects on average.
        spikes = recordings.spikes if name == "objects" else recordings.spikes[:, -ROWS:]
        sets[name] = windows(spikes), recordings.labels
    rows = []
    for name, (x, labels) in sets.items():
        (other, others) = sets["containers" if name == "objects" else "objects"]
        _, foreign = prototypes(other, others)
        ways = {"plain": (None, False)}
        for smooth in SMOOTH:
            ways |= {f"whitened, {smooth:g}": (smooth, False), f"whitened by both sets, {smooth:g}": (smooth, True)}
        for label, (smooth, both) in ways.items():
            right = []
            for repeat in range(args.repeats):
                fold = folds(labels, repeat)
                for held in range(FOLDS):
                    means, apart = prototypes(x[fold != held], labels[fold != held])
                    apart = np.concatenate([apart, foreign]) if both else apart
                    found = nearest(x[fold == held], means, apart, smooth)
                    right.append(float((found == labels[fold == held]).mean()))
            error = np.std(right, ddof=1) / len(right) ** 0.5
            rows.append(
                [
                    f"{name.title()}, nearest prototype, {label}",
                    str(len(right)),
                    f"{np.mean(right):.3f}",
                    f"{error:.3f}",
                ]
            )
            print(rows[-1], flush=True)
    if args.table:
        write_table(args.table, (["training", "parts", "accuracy", "standard error"], rows))


if __name__ == "__main__":
    main()
