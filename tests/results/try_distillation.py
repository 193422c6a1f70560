"""Windows that learn from what a committee of windows and hybrid says: a row of `tried-training.csv`.

    python tests/results/try_distillation.py --data FOLDER --weight 0.5

On each of the folds of ``try_training.py`` the committee learns from the three others, and then the windows from the same
three: their loss is ``--weight`` parts what the committee says of the recordings as they are fed, dropped events and all, and
the label for the rest. **The test part is never read.** Figures of a fold are files under ``--work``.
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
from try_training import FOLDS, ROOT, Committee, Setting, config_of, folds, settings_of

from locsnn_compile.data.read import read_recordings
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training import train as training
from locsnn_compile.training.batches import batches
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.measure import Loss, class_scores, weighted_counts


def distilling(members: Sequence[tuple[TouchModel, float]], weight: float) -> tuple[Any, Any]:
    """Return a loss and batches that put ``weight`` on what members, each with its count_scale, say of a batch."""
    fed: list[Tensor] = []

    def remembered(*given: Any) -> Iterator[Any]:
        for x, y in batches(*given):
            fed[:] = [torch.from_numpy(x)]
            yield x, y

    class Distilling(Loss):
        def __call__(
            self, network: TouchModel, activity: Mapping[str, Tensor], labels: Tensor, weights: Tensor | None = None
        ) -> Tensor:
            with torch.no_grad():
                said = [torch.log_softmax(scale * member.total(member(fed[0])), dim=1) for member, scale in members]
            counts = weighted_counts(network.scores(activity), self.config.location_weight)
            shares = torch.softmax(torch.stack(said).sum(dim=0), dim=1)
            soft = torch.nn.functional.cross_entropy(self.config.count_scale * counts, shares)
            return (1.0 - weight) * super().__call__(network, activity, labels, weights) + weight * soft

    return Distilling, remembered


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
    known = settings_of(Path(__file__).with_name("tried_settings.yaml"))
    student, *teachers = (known[name] for name in (args.student, *args.teachers))
    fold, right, classes = folds(labels, repeat), [], 1 + int(labels.max())
    for held in range(FOLDS):
        path = args.work / f"{args.dataset}-distilled-{args.weight:g}-{repeat}-{held}.txt"
        if not path.exists():
            learned, members = recordings.subset(np.flatnonzero(fold != held)), []
            for teacher in teachers:
                config = of(teacher, args.dataset, repeat)
                members.append((training.train(learned, config, classes=classes).network, config.count_scale))
            loss, remembered = distilling(members, args.weight)
            with mock.patch.object(training, "Loss", loss), mock.patch.object(training, "batches", remembered):
                network = training.train(learned, of(student, args.dataset, repeat), classes=classes).network
            played, wanted = recordings.spikes[fold == held], labels[fold == held]
            logits = [torch.from_numpy(scale * class_scores(member, played)) for member, scale in members]
            both = sum(torch.log_softmax(each, dim=1) for each in logits)
            found = [class_scores(network, played).argmax(axis=1), np.asarray(both).argmax(axis=1)]
            path.write_text(" ".join(f"{(each == wanted).mean():.4f}" for each in found) + "\n")
        right.append([float(text) for text in path.read_text().split()])
        print(
            f"{args.weight:g}: fold {held}: distilled {right[-1][0]:.3f}, its committee {right[-1][1]:.3f}", flush=True
        )
    mean, error = np.mean(right, axis=0), np.std(right, axis=0, ddof=1) / FOLDS**0.5
    print(f"distilled {mean[0]:.3f} +- {error[0]:.3f}, its committee {mean[1]:.3f} +- {error[1]:.3f}")


def of(setting: Setting | Committee, dataset: str, repeat: int) -> TrainingConfig:
    assert isinstance(setting, Setting)
    return config_of(setting, dataset, repeat)


if __name__ == "__main__":
    main()
