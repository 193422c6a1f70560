"""Windows that learn from what a committee says of the recordings: the ways with ``teachers`` of ``tried_settings.yaml``.

What the committee says of a recording must come from networks that have not learned from it, or it is overconfident, nor from
what is held out to measure. So where a fold is held out, each of the other three is scored by teachers that learned from the
other two. Those two leave two folds for them to score, one for each student, so six trainings serve four students.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any
from unittest import mock

import numpy as np
import torch
from torch import Tensor
from ways import FOLDS, Distilled, Division, Floats, Rows, Scorer, Setting

from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training import train as training
from locsnn_compile.training.batches import batches
from locsnn_compile.training.measure import Loss, weighted_counts


def distilled(way: Distilled, of: Division, rows: Rows) -> Scorer:
    """Train the student on ``rows``, all folds of a division but one, by their labels and by what the teachers say."""
    student = of.known[way.student]
    assert isinstance(student, Setting)
    said = torch.softmax(
        torch.from_numpy(np.sum([said_by(name, of, rows) for name in way.teachers], axis=0)), dim=1
    )
    loss, numbered = distilling(said, way.weight)
    with (
        mock.patch.object(training, "Loss", loss),
        mock.patch.object(training, "batches", numbered),
    ):
        return student.learn(of, rows)


def said_by(name: str, of: Division, rows: Rows) -> Floats:
    """Return a teacher's log-probabilities (rows, classes), of each fold by one that learned from the others of ``rows``."""
    fold = of.fold
    within = sorted({int(fold[row]) for row in rows})
    assert len(within) == FOLDS - 1, "a student learns from all folds but the one that measures it"
    found = np.empty((len(rows), of.classes))
    for scored in within:
        learned = tuple(k for k in within if k != scored)
        found[fold[rows] == scored] = pair_scores(name, of, learned)[rows[fold[rows] == scored]]
    return found


def pair_scores(name: str, of: Division, learned: tuple[int, ...]) -> Floats:
    """Return the log-probabilities of all recordings by a teacher of some folds; those that it learned from are NaN."""
    path = of.work / f"{of.dataset}-{name}-{of.repeat}-of-{'-'.join(map(str, learned))}.npy"
    if not path.exists():
        known = np.isin(of.fold, learned)
        teacher = of.known[name]
        assert isinstance(teacher, Setting)
        found = np.full((len(known), of.classes), np.nan)
        found[~known] = teacher.learn(of, np.flatnonzero(known))(of.recordings.spikes[~known])
        np.save(path, found)
        print(
            f"{path.stem}: {np.mean(found[~known].argmax(axis=1) == of.labels[~known]):.3f}",
            flush=True,
        )
    return np.asarray(np.load(path))


def distilling(said: Tensor, weight: float) -> tuple[Any, Any]:
    """Return a loss and batches that put ``weight`` on what is ``said`` of the recordings, (samples, classes) shares."""
    fed: list[Tensor] = []

    def numbered(spikes: Any, labels: Any, config: Any, rng: Any, polarities: int) -> Iterator[Any]:
        for x, rows in batches(spikes, np.arange(len(labels)), config, rng, polarities):
            fed[:] = [said[rows]]
            yield x, labels[rows]

    class Distilling(Loss):
        def __call__(
            self,
            network: TouchModel,
            activity: Mapping[str, Tensor],
            labels: Tensor,
            weights: Tensor | None = None,
        ) -> Tensor:
            counts = weighted_counts(network.scores(activity), self.config.location_weight)
            soft = torch.nn.functional.cross_entropy(
                self.config.count_scale * counts, fed[0].to(counts)
            )
            return (1.0 - weight) * super().__call__(
                network, activity, labels, weights
            ) + weight * soft

    return Distilling, numbered
