"""The paper's hybrid on five splits of all recordings: `docs/research/results/splits.csv`.

    python docs/research/results/five_splits.py --data FOLDER

The paper divides all of its recordings five times (80/20) and trains one network on each split. Here the train part and
the test part of a public set are joined and divided in five rounds, as ``locsnn train --split 0.2 --fold 1`` to ``5``
divides recordings without parts: each recording is tested on in one round. Round k trains with seed k - 1. Its epoch is
chosen on a validation part of what it trains on.

Networks are files under ``--work``: what is there is not trained again, and a killed training goes on.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from measure_run import config_of, parts, train_network
from result_rows import DATASETS, ROWS, Dataset, Row
from tables import NOT_RUN, Table, merged, read_table, write_table

from locsnn_compile.data.read import Division
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.models.checkpoint_reader import read_checkpoint

ROOT = Path(__file__).parents[3]
TEST_SHARE = 0.2
ROUNDS = range(1, 6)
RECORDED = ("objects", "containers")
"""Data sets of recordings; the others are made up."""
NETWORKS = tuple(row for row in ROWS if row.name in ("hybrid", "hybrid-published"))


def joined(train_part: Recordings, test_part: Recordings, source: str) -> Recordings:
    """Return the recordings of both parts as one set, those of the train part first."""
    labels = [part.needed_labels("divide them by") for part in (train_part, test_part)]
    return replace(
        train_part,
        spikes=np.concatenate([train_part.spikes, test_part.spikes]),
        labels=np.concatenate(labels),
        source=source,
    )


def train_round(
    work: Path, row: Row, dataset: Dataset, recordings: Recordings, round_number: int
) -> None:
    """Train the network of one round, unless it is there."""
    path = network_of(work, row, dataset, round_number)
    if path.exists():
        return
    division = Division(TEST_SHARE, round_number)
    train_part, test_part = (
        division.part(recordings, Path(recordings.source), name) for name in ("train", "test")
    )
    train_network(path, config_of(row, dataset, round_number - 1), train_part, test_part)


def network_of(work: Path, row: Row, dataset: Dataset, round_number: int) -> Path:
    """Return the file of the network of a round."""
    return work / f"{dataset.name}-{row.name}-split-{round_number}.pt"


def splits(work: Path) -> Table:
    """Return the float accuracy of each round on the recordings that it did not train on."""
    rows = []
    for name in RECORDED:
        dataset = DATASETS[name]
        for row in NETWORKS:
            networks = [network_of(work, row, dataset, number) for number in ROUNDS]
            cells = [accuracy_cell(network) for network in networks]
            rows.append([f"{row.label}, {dataset.title}", *cells])
    return ["network", *(f"split {number}" for number in ROUNDS)], rows


def accuracy_cell(network: Path) -> str:
    """Return the test accuracy that a checkpoint keeps, as a cell."""
    if not network.exists():
        return NOT_RUN
    return f"{read_checkpoint(network).training['test_accuracy']:.4f}"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = [row.name for row in NETWORKS]
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data/neutouch")
    parser.add_argument("--work", type=Path, default=ROOT / "runs/results")
    parser.add_argument("--datasets", nargs="*", choices=RECORDED, default=RECORDED)
    parser.add_argument("--rows", nargs="*", choices=names, default=names)
    parser.add_argument("--table", type=Path, default=ROOT / "docs/research/results/splits.csv")
    args = parser.parse_args(arguments)
    args.work.mkdir(parents=True, exist_ok=True)
    for row in NETWORKS:
        for name in args.datasets:
            dataset = DATASETS[name]
            if row.name not in args.rows:
                continue
            recordings = joined(*parts(args.data, dataset), source=str(dataset.archive))
            for round_number in ROUNDS:
                train_round(args.work, row, dataset, recordings, round_number)
    write_table(args.table, merged(splits(args.work), read_table(args.table)))


if __name__ == "__main__":
    main()
