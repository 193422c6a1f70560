"""What counting reaches: ridge regression from numbers of events to classes, the baseline of every run.

With z the counts of a recording, each shifted and scaled to mean 0 and standard deviation 1 over the recordings that
are learned from, and with a 1 behind them, the scores of the classes are

    scores = W z        W = argmin  sum over n recordings |onehot(label) - W z|^2  +  n |W|^2

A network that does worse than this has not used the order of events, and has lost what their numbers say.
"""

import numpy as np

from hw_model.values import ByteArray, FloatArray, Frozen, IntArray

BINS = 8
"""Bins of time of the second baseline."""
MAX_UNKNOWNS = 8_192
"""Largest matrix that is solved, in rows: 0.5 GB in float64."""


class Baselines(Frozen):
    """Accuracies of counting on recordings that it did not learn from.

    ``counts``: from the events of every channel; ``counts_in_bins``: from those in :data:`BINS` bins of time. Both are
    None where there are too many recordings and counts at once to solve for.
    """

    counts: float | None
    counts_in_bins: float | None

    @property
    def better(self) -> float:
        """The larger of the two; 0 if none was measured."""
        return max(self.counts or 0.0, self.counts_in_bins or 0.0)


def measure_baselines(
    known: ByteArray, labels: IntArray, unknown: ByteArray, truth: IntArray
) -> Baselines:
    """Learn from recordings ``known`` (samples, steps, channels) and ``labels``; measure on the others."""
    accuracies: list[float | None] = []
    for bins in (1, BINS):
        learned_from = counts_in_bins(known, bins)
        if min(learned_from.shape) > MAX_UNKNOWNS:
            accuracies.append(None)
            continue
        scores = ridge_scores(learned_from, labels, counts_in_bins(unknown, bins))
        accuracies.append(float((scores.argmax(axis=1) == truth).mean()))
    return Baselines(*accuracies)


def counts_in_bins(spikes: ByteArray, bins: int) -> FloatArray:
    """Return events per channel in so many bins of time, (samples, bins * channels).

    Bins differ by a step where they do not divide the recording; of shorter recordings some are empty.
    """
    parts = np.array_split(spikes, bins, axis=1)
    return np.concatenate([part.sum(axis=1, dtype=np.float64) for part in parts], axis=1)


def ridge_scores(known: FloatArray, labels: IntArray, unknown: FloatArray) -> FloatArray:
    """Return class scores (samples, classes) of ``unknown`` counts (samples, counts), learned from ``known`` ones."""
    mean = known.mean(axis=0)
    deviation = known.std(axis=0)
    # A channel that never varies says nothing; dividing by 0 would let its first change decide alone.
    scale = np.where(deviation > 0, deviation, np.inf)
    z = _with_one((known - mean) / scale)
    wanted = np.eye(int(labels.max()) + 1)[labels]
    penalty = float(len(z))
    samples, counts = z.shape
    if samples <= counts:
        weights = z.T @ np.linalg.solve(z @ z.T + penalty * np.eye(samples), wanted)
    else:
        weights = np.linalg.solve(z.T @ z + penalty * np.eye(counts), z.T @ wanted)
    return np.asarray(_with_one((unknown - mean) / scale) @ weights)


def _with_one(counts: FloatArray) -> FloatArray:
    return np.concatenate([counts, np.ones((len(counts), 1))], axis=1)
