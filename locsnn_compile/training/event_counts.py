"""The baseline of every training run: how well the mere numbers of events predict the classes.

The baseline is ridge regression, a linear method, from the number of events of every channel to the classes. With z the
counts of a recording, each shifted and scaled to mean 0 and standard deviation 1 over the n training recordings, and
with a 1 appended for the bias, the scores of the classes are

    scores = W z        W = argmin  sum over training recordings |onehot(label) - W z|^2  +  n |W|^2

The ridge n |W|^2, one per recording, was chosen by hand. A network that does worse than this baseline has not used the
order of events, and has lost information that their numbers alone have; the report of a run says so.
"""

import numpy as np

from hw_model.values import ByteArray, FloatArray, Frozen, IntArray

BINS = 8
"""Number of bins of time of the second baseline, which counts the events of every channel in each of them."""
MAX_UNKNOWNS = 8_192
"""Most rows of the square matrix that is solved: it takes 0.5 GB in float64."""


class Baselines(Frozen):
    """The accuracies of the baselines on recordings that they did not learn from.

    - ``counts``: by the number of events of every channel
    - ``counts_in_bins``: by these numbers in each of :data:`BINS` bins of time

    Each is None if both recordings and counts are too many to solve for (:data:`MAX_UNKNOWNS`).
    """

    counts: float | None
    counts_in_bins: float | None

    @property
    def better(self) -> float:
        """The larger of the two; 0 if none was measured."""
        return max(self.counts or 0.0, self.counts_in_bins or 0.0)


def measure_baselines(
    training: ByteArray, training_labels: IntArray, test: ByteArray, test_labels: IntArray
) -> Baselines:
    """Return the baselines of one set of recordings, learned from another; both are (samples, steps, channels)."""
    accuracies: list[float | None] = []
    for bins in (1, BINS):
        training_counts = counts_in_bins(training, bins)
        # The system that is solved has a row per recording or per count, whichever are fewer.
        if min(training_counts.shape) > MAX_UNKNOWNS:
            accuracies.append(None)
            continue
        scores = ridge_scores(training_counts, training_labels, counts_in_bins(test, bins))
        accuracies.append(float((scores.argmax(axis=1) == test_labels).mean()))
    in_one_bin, in_bins = accuracies
    return Baselines(counts=in_one_bin, counts_in_bins=in_bins)


def counts_in_bins(spikes: ByteArray, bins: int) -> FloatArray:
    """Return the number of events of every channel in each of ``bins`` bins of time, (samples, bins * channels).

    If the number of steps is not a multiple of ``bins``, the first bins are one step longer; with fewer steps than
    bins, the last bins are empty.
    """
    parts = np.array_split(spikes, bins, axis=1)
    return np.concatenate([part.sum(axis=1, dtype=np.float64) for part in parts], axis=1)


def ridge_scores(training: FloatArray, labels: IntArray, test: FloatArray) -> FloatArray:
    """Return class scores (samples, classes) of ``test`` counts, learned from ``training`` counts and ``labels``.

    Counts are (samples, counts).
    """
    mean = training.mean(axis=0)
    deviation = training.std(axis=0)
    # A channel that never varies in training says nothing. By an infinite scale its z is always 0;
    # dividing by 0 would let its first change decide alone.
    scale = np.where(deviation > 0, deviation, np.inf)
    z = _with_one((training - mean) / scale)
    targets = np.eye(int(labels.max()) + 1)[labels]
    ridge = float(len(z))
    samples, counts = z.shape
    # Two forms of the same solution, z^T (z z^T + ridge)^-1 = (z^T z + ridge)^-1 z^T: the smaller system is solved.
    if samples <= counts:
        weights = z.T @ np.linalg.solve(z @ z.T + ridge * np.eye(samples), targets)
    else:
        weights = np.linalg.solve(z.T @ z + ridge * np.eye(counts), z.T @ targets)
    return np.asarray(_with_one((test - mean) / scale) @ weights)


def _with_one(counts: FloatArray) -> FloatArray:
    """Return counts (samples, counts) with a column of ones behind them, whose weight is the bias."""
    return np.concatenate([counts, np.ones((len(counts), 1))], axis=1)
