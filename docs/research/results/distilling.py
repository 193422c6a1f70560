"""Networks of windows that learn from the predictions of a committee: the ways with ``teachers`` of ``tried_settings.yaml``.

A teacher's prediction of a recording must come from a network that has learned neither from this recording, or it is
overconfident, nor from the fold that is held out to measure the student. So if one of the four folds is held out, each of the
other three is scored by teachers that learned from the remaining two. A teacher of two folds can score both others, one for each
of two students, so six trainings (the pairs of four folds) serve four students.
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


def distilled(way: Distilled, division: Division, rows: Rows) -> Scorer:
    """Train the student on ``rows``, all folds of a division but one, by their labels and by what the teachers predict.

    Training has no hook for such a loss, so the loss and the batches of its module are replaced while it runs.
    """
    student = division.way_of_name[way.student]
    assert isinstance(student, Setting)
    teacher_probabilities = torch.softmax(
        torch.from_numpy(np.sum([said_by(name, division, rows) for name in way.teachers], axis=0)),
        dim=1,
    )
    loss, numbered = distilling(teacher_probabilities, way.weight)
    with (
        mock.patch.object(training, "Loss", loss),
        mock.patch.object(training, "batches", numbered),
    ):
        return student.learn(division, rows)


def said_by(name: str, division: Division, rows: Rows) -> Floats:
    """Return a teacher's log-probabilities (rows, classes), for each fold by a network that learned from the others of ``rows``."""
    fold = division.fold
    folds_of_rows = sorted({int(fold[row]) for row in rows})
    assert len(folds_of_rows) == FOLDS - 1, (
        "a student learns from all folds but the one that measures it"
    )
    scores = np.empty((len(rows), division.classes))
    for scored in folds_of_rows:
        learned = tuple(k for k in folds_of_rows if k != scored)
        scores[fold[rows] == scored] = pair_scores(name, division, learned)[
            rows[fold[rows] == scored]
        ]
    return scores


def pair_scores(name: str, division: Division, learned: tuple[int, ...]) -> Floats:
    """Return the log-probabilities of all recordings by a teacher that learned from some folds; for these folds they are NaN."""
    path = (
        division.work
        / f"{division.dataset}-{name}-{division.repeat}-of-{'-'.join(map(str, learned))}.npy"
    )
    if not path.exists():
        is_learned = np.isin(division.fold, learned)
        teacher = division.way_of_name[name]
        assert isinstance(teacher, Setting)
        scores = np.full((len(is_learned), division.classes), np.nan)
        scores[~is_learned] = teacher.learn(division, np.flatnonzero(is_learned))(
            division.recordings.spikes[~is_learned]
        )
        np.save(path, scores)
        print(
            f"{path.stem}: {np.mean(scores[~is_learned].argmax(axis=1) == division.labels[~is_learned]):.3f}",
            flush=True,
        )
    return np.asarray(np.load(path))


def distilling(said: Tensor, weight: float) -> tuple[Any, Any]:
    """Return a loss and a function of batches that put ``weight`` on what the teachers predict.

    ``said``: their probabilities, (samples, classes). The batches draw numbers of recordings in place of labels; so they know which
    of these probabilities belong to the batch, and leave them in ``fed`` for the loss that is computed next.
    """
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
