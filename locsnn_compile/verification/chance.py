"""Whether an accuracy differs significantly from chance, by an exact one-sided binomial test.

A report shows the result next to the accuracy, so that 60 % on a handful of recordings is not taken for learning.
"""

import numpy as np

from hw_model.values import Frozen, IntArray

FEWEST_RECORDINGS = 20
"""Smallest number of labelled recordings for which accuracy is tested; chosen by hand."""
SIGNIFICANCE = 0.05
"""The usual level: accuracy differs from chance if guessing reaches it with a smaller probability."""


class Chance(Frozen):
    """The probability of being right by chance on at least ``right`` of ``recordings`` recordings.

    By chance, a prediction is right with probability ``commonest_share``, the share of the commonest label: always
    guessing this label is the best that can be done without looking. ``p_value`` is the probability of ``right`` or
    more.
    """

    recordings: int
    right: int
    commonest_share: float
    p_value: float

    @property
    def told_apart(self) -> bool:
        """Whether the accuracy differs significantly from chance."""
        return self.p_value < SIGNIFICANCE


def chance_of(predicted: IntArray, labels: IntArray) -> Chance | None:
    """Return the test of predictions (samples,), -1 where nothing is predicted, against labels (samples,).

    Return None for fewer than :data:`FEWEST_RECORDINGS`, and if all have the same label.
    """
    recordings = len(labels)
    counts = np.bincount(labels)
    if recordings < FEWEST_RECORDINGS or np.count_nonzero(counts) < 2:
        return None
    right = int((predicted == labels).sum())
    share = float(counts.max() / recordings)
    return Chance(recordings, right, share, _at_least(right, recordings, share))


def _at_least(right: int, recordings: int, share: float) -> float:
    """Return the probability of ``right`` or more successes: sum over k of C(n, k) p^k (1 - p)^(n - k)."""
    if right == 0:
        return 1.0
    from scipy.special import bdtrc  # loads slowly, and only labelled recordings need it

    return float(bdtrc(right - 1, recordings, share))
