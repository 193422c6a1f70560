"""How accuracy grows with the recordings to learn from: `docs/research/results/learning-curve.csv`, and its picture.

    python docs/research/results/learning_curve.py --data FOLDER

The recipe of the best network of windows of each set learns from shares of three stratified folds of the train part, and is
measured on the fourth after its last epoch. **The test part is never read.** A smaller share is part of the larger ones. Figures
are files under ``--work``: what is there is not made again, and the table holds what is there.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from tables import write_table
from try_training import scores_of
from ways import FOLDS, ROOT, Division, Setting, settings_of

from locsnn_compile.data.read import read_recordings
from locsnn_compile.training.batches import epoch_generator

SHARES = (0.25, 0.5, 0.75)
RECIPES = {"objects": ("base", 1), "containers": ("near", 2)}
"""Data set -> its setting in ``tried_settings.yaml``, and how often the train part is divided into folds."""


SHARES_STREAM = 78
"""The purpose of the random numbers of :func:`share_of`, as :func:`epoch_generator` takes it."""


def share_of(
    labels: NDArray[np.int64], rows: NDArray[np.int64], share: float, repeat: int
) -> NDArray[np.int64]:
    """Return this share of ``rows``, drawn evenly from the classes; a smaller share is a part of any larger one."""
    rng, rows_of_classes = epoch_generator(repeat, SHARES_STREAM), []
    for label in np.unique(labels):
        rows_of_class = rng.permutation(rows[labels[rows] == label])
        rows_of_classes.append(rows_of_class[: max(1, round(share * len(rows_of_class)))])
    return np.sort(np.concatenate(rows_of_classes))


def right_of(division: Division, name: str, share: float) -> list[list[float]]:
    """Return, for each fold held out: how many recordings the network learned from, and its accuracy on the fold."""
    path, way = (
        division.work / f"curve-{division.dataset}-{share}-{division.repeat}.json",
        division.way_of_name[name],
    )
    if path.exists():
        return json.loads(path.read_text())
    assert isinstance(way, Setting)
    results, fold = [], division.fold
    for held in range(FOLDS):
        rows = share_of(division.labels, np.flatnonzero(fold != held), share, division.repeat)
        predicted = way.learn(division, rows)(division.recordings.spikes[fold == held]).argmax(
            axis=1
        )
        results.append([len(rows), float((predicted == division.labels[fold == held]).mean())])
    path.write_text(json.dumps(results) + "\n")
    print(f"{path.stem}: {np.mean([right for _, right in results]):.3f}", flush=True)
    return results


def whole(division: Division, name: str) -> list[list[float]]:
    """Return what :func:`right_of` does for a share of 1, from the scores that ``try_training.py`` keeps."""
    scores, fold = scores_of(division, name), division.fold
    assert scores is not None
    right = scores[0].argmax(axis=1) == division.labels
    return [[int((fold != held).sum()), float(right[fold == held].mean())] for held in range(FOLDS)]


def row_of(dataset: str, share: float, results: Sequence[Sequence[float]]) -> list[str]:
    """Return a row of the table: mean, and the 95 % interval of Student's t over the folds that were held out."""
    learned, right = np.array(results).T
    error = right.std(ddof=1) / len(right) ** 0.5
    half = float(stats.t.ppf(0.975, len(right) - 1)) * error
    ends = [f"{right.mean() + side * half:.3f}" for side in (-1, 1)]
    return [
        dataset.title(),
        f"{share:g}",
        f"{learned.mean():.0f}",
        str(len(right)),
        f"{right.mean():.3f}",
        *ends,
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data/neutouch")
    parser.add_argument("--work", type=Path, default=ROOT / "runs/tried")
    parser.add_argument("--datasets", nargs="*", choices=tuple(RECIPES), default=tuple(RECIPES))
    parser.add_argument(
        "--table", type=Path, default=ROOT / "docs/research/results/learning-curve.csv"
    )
    args = parser.parse_args(arguments)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    args.work.mkdir(parents=True, exist_ok=True)
    rows, known = [], settings_of(Path(__file__).with_name("tried_settings.yaml"))
    for dataset in args.datasets:
        name, repeats = RECIPES[dataset]
        recordings = read_recordings(args.data / f"Ev-{dataset.title()}.zip", split="train")
        divisions = [
            Division(dataset, recordings, repeat, args.work, args.data, known)
            for repeat in range(repeats)
        ]
        for share in SHARES:
            each = [right_of(division, name, share) for division in divisions]
            rows.append(row_of(dataset, share, [part for parts in each for part in parts]))
        each = [whole(division, name) for division in divisions]
        rows.append(row_of(dataset, 1.0, [part for parts in each for part in parts]))
    head = [
        "set",
        "share of three folds",
        "recordings to learn from",
        "folds held out",
        "accuracy",
        "95 % from",
        "to",
    ]
    write_table(args.table, (head, rows))


if __name__ == "__main__":
    main()
