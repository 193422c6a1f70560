"""Windows that learn from what a committee of windows and hybrid says of the recordings: a row of `tried-training.csv`.

    python tests/results/try_distillation.py --data FOLDER --weight 0.5

What the committee says of a recording are the scores that ``try_training.py`` kept of it when it was held out, so that they are not
overconfident. Its members learned from the other folds, the one that measures among them: the figure is too good, if anything.
**The test part is never read.**
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch
from torch import Tensor
from try_training import FOLDS, ROOT, Setting, config_of, folds, settings_of

from locsnn_compile.data.read import read_recordings
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training import train as training
from locsnn_compile.training.batches import batches
from locsnn_compile.training.measure import Loss, class_scores, weighted_counts


def distilling(said: Tensor, weight: float) -> tuple[Any, Any]:
    """Return a loss and batches that put ``weight`` on what is ``said`` of the recordings, (samples, classes) shares."""
    fed: list[Tensor] = []

    def numbered(spikes: Any, labels: Any, config: Any, rng: Any, polarities: int) -> Iterator[Any]:
        for x, rows in batches(spikes, np.arange(len(labels)), config, rng, polarities):
            fed[:] = [said[rows]]
            yield x, labels[rows]

    class Distilling(Loss):
        def __call__(
            self, network: TouchModel, activity: Mapping[str, Tensor], labels: Tensor, weights: Tensor | None = None
        ) -> Tensor:
            counts = weighted_counts(network.scores(activity), self.config.location_weight)
            soft = torch.nn.functional.cross_entropy(self.config.count_scale * counts, fed[0].to(counts))
            return (1.0 - weight) * super().__call__(network, activity, labels, weights) + weight * soft

    return Distilling, numbered


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data/neutouch")
    parser.add_argument("--work", type=Path, default=ROOT / "runs/tried")
    parser.add_argument("--dataset", default="objects")
    parser.add_argument("--student", default="base")
    parser.add_argument("--teachers", nargs="+", default=["base", "hybrid"])
    parser.add_argument("--weight", type=float, default=0.5)
    args = parser.parse_args(arguments)
    recordings = read_recordings(args.data / f"Ev-{args.dataset.title()}.zip", split="train")
    labels, repeat = recordings.labels, 0
    assert labels is not None
    scores = sum(np.load(args.work / f"{args.dataset}-{name}-{repeat}.npy")[0] for name in args.teachers)
    said = torch.softmax(torch.from_numpy(np.asarray(scores)), dim=1)
    setting = settings_of(Path(__file__).with_name("tried_settings.yaml"))[args.student]
    assert isinstance(setting, Setting)
    fold, right = folds(labels, repeat), []
    for held in range(FOLDS):
        rows = np.flatnonzero(fold != held)
        loss, numbered = distilling(said[torch.from_numpy(rows)], args.weight)
        with mock.patch.object(training, "Loss", loss), mock.patch.object(training, "batches", numbered):
            result = training.train(
                recordings.subset(rows), config_of(setting, args.dataset, repeat), classes=said.shape[1]
            )
        found = class_scores(result.network, recordings.spikes[fold == held]).argmax(axis=1)
        right.append(float((found == labels[fold == held]).mean()))
        print(f"{args.weight:g}: fold {held} {right[-1]:.3f}", flush=True)
    print(f"{args.weight:g}: {np.mean(right):.3f} +- {np.std(right, ddof=1) / FOLDS**0.5:.3f}")


if __name__ == "__main__":
    main()
