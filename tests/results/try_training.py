"""Compare ways of training on the train parts of the recordings: what `docs/results/tried-training.csv` holds.

    nice -n 5 python tests/results/try_training.py --data FOLDER --dataset containers --repeats 3

The train part is divided into four stratified folds, ``--repeats`` times. Each setting learns from three of them and is
measured on the fourth after its last epoch, so that nothing is chosen on what measures. **The test part is never read.**
Class scores of the held-out recordings are files under ``--work``: what is there is not made again. A committee adds the
log-probabilities of settings, which costs no training. Accuracies after three quarters, half and a quarter of the steps are
those of recordings that end there.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.training.batches import epoch_generator
from locsnn_compile.training.config import TrainingConfig, config_from_mapping, read_config
from locsnn_compile.training.measure import class_scores
from locsnn_compile.training.train import train

ROOT = Path(__file__).parents[2]
FOLDS = 4
SEEN = (1.0, 0.75, 0.5, 0.25)
"""Shares of the steps that are played."""


@dataclass(frozen=True)
class Setting:
    """A way of training: options over ``examples/configs/DATASET-CONFIG.yaml``."""

    label: str
    options: Mapping[str, Any] = field(default_factory=dict)
    config: str = "window-snn"


@dataclass(frozen=True)
class Committee:
    """Settings whose log-probabilities are added, each times its weight."""

    label: str
    members: Mapping[str, float]


def folds(labels: NDArray[np.int64], repeat: int) -> NDArray[np.int64]:
    """Return the fold 0..3 of each recording, every class spread evenly, (samples,)."""
    rng = epoch_generator(repeat, 77)
    found = np.empty(len(labels), dtype=np.int64)
    for label in np.unique(labels):
        rows = rng.permutation(np.flatnonzero(labels == label))
        found[rows] = (np.arange(len(rows)) + rng.integers(FOLDS)) % FOLDS
    return found


def settings_of(path: Path) -> dict[str, Setting | Committee]:
    """Return the settings of a YAML file by their short names."""
    import yaml

    found: dict[str, Setting | Committee] = {}
    for name, entry in yaml.safe_load(path.read_text(encoding="utf-8")).items():
        found[name] = Committee(**entry) if "members" in entry else Setting(**entry)
    return found


def config_of(setting: Setting, dataset: str, repeat: int) -> TrainingConfig:
    """Return what a setting trains with: no validation part, one phase, a seed for each repeat."""
    values = read_config(ROOT / f"examples/configs/{dataset}-{setting.config}.yaml") | dict(setting.options)
    return config_from_mapping(values | {"seed": repeat, "validation_fraction": 0.0, "refit": False})


def scores_of(
    work: Path, recordings: Recordings, dataset: str, name: str, setting: Setting, repeat: int
) -> NDArray[np.float64]:
    """Return the log-probabilities (share seen, samples, classes) of each recording when it was held out."""
    path = work / f"{dataset}-{name}-{repeat}.npy"
    if path.exists():
        return np.asarray(np.load(path))
    before = time.perf_counter()
    labels, config = recordings.labels, config_of(setting, dataset, repeat)
    assert labels is not None
    fold = folds(labels, repeat)
    found = np.empty((len(SEEN), len(labels), 1 + int(labels.max())))
    for held in range(FOLDS):
        rows = np.flatnonzero(fold != held)
        result = train(recordings.subset(rows), config, classes=found.shape[2])
        for share, scores in zip(SEEN, found, strict=True):
            heard = recordings.spikes[fold == held].copy()
            heard[:, int(share * heard.shape[1]) :] = 0
            scores[fold == held] = class_scores(result.network, heard)
    logits = config.count_scale * found
    top = logits.max(axis=2, keepdims=True)
    found = logits - top - np.log(np.exp(logits - top).sum(axis=2, keepdims=True))
    np.save(path, found)
    right = float((found[0].argmax(axis=1) == labels).mean())
    print(f"{dataset} {name} {repeat}: {right:.3f} in {time.perf_counter() - before:.0f} s", flush=True)
    return found


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data/neutouch")
    parser.add_argument("--work", type=Path, default=ROOT / "runs/tried")
    parser.add_argument("--settings", type=Path, default=Path(__file__).with_name("tried_settings.yaml"))
    parser.add_argument("--dataset", choices=("objects", "containers"), default="containers")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--names", nargs="*")
    parser.add_argument("--table", type=Path)
    args = parser.parse_args(arguments)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    args.work.mkdir(parents=True, exist_ok=True)
    recordings = read_recordings(args.data / f"Ev-{args.dataset.title()}.zip", split="train")
    labels, known = recordings.labels, settings_of(args.settings)
    assert labels is not None
    rows = []
    for name in args.names or list(known):
        found = [_of_repeat(args.work, recordings, args.dataset, name, known, repeat) for repeat in range(args.repeats)]
        if any(scores is None for scores in found):
            continue  # a committee whose members have not been trained
        parts = [(r, fold) for r in range(args.repeats) for fold in range(FOLDS)]
        seen = min(len(scores) for scores in found if scores is not None)
        hits = [scores[:seen].argmax(axis=2) == labels for scores in found if scores is not None]
        right = np.array([hits[r][:, folds(labels, r) == fold].mean(axis=1) for r, fold in parts])
        error = right[:, 0].std(ddof=1) / len(parts) ** 0.5
        early = [f"{share:.3f}" for share in right.mean(axis=0)[1:]]
        early += ["-"] * (len(SEEN) - 1 - len(early))
        rows.append([known[name].label, len(parts), f"{right[:, 0].mean():.3f}", f"{error:.3f}", *early])
        print(f"{name:24} {rows[-1]}", flush=True)
    if args.table:
        with args.table.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerows(
                [["training", "parts", "accuracy", "standard error", "three quarters", "half", "quarter"], *rows]
            )


def _of_repeat(
    work: Path, recordings: Recordings, dataset: str, name: str, known: Mapping[str, Setting | Committee], repeat: int
) -> NDArray[np.float64] | None:
    """Return the scores of a setting, or of a committee if its members have some."""
    setting = known[name]
    if isinstance(setting, Setting):
        return scores_of(work, recordings, dataset, name, setting, repeat)
    parts = [(weight, work / f"{dataset}-{member}-{repeat}.npy") for member, weight in setting.members.items()]
    if not all(path.exists() for _, path in parts):
        return None
    each = [weight * np.load(path) for weight, path in parts]
    return np.asarray(sum(scores[: min(map(len, each))] for scores in each))


if __name__ == "__main__":
    main()
