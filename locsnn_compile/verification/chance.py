"""Whether an accuracy can be told from chance, by an exact binomial test."""

import numpy as np

from hw_model.values import Frozen, IntArray

FEWEST_RECORDINGS = 20
"""Labelled recordings from which on accuracy is tested."""
SIGNIFICANCE = 0.05
"""Accuracy is told from chance where guessing reaches it less often than this."""


class Chance(Frozen):
    """How often guessing would be right in ``right`` of ``recordings`` or more.

    A guess is the commonest label, which has the share ``commonest_share`` of the recordings; ``p_value`` is the
    probability that this share gives so many right ones.
    """

    recordings: int
    right: int
    commonest_share: float
    p_value: float

    @property
    def told_apart(self) -> bool:
        """Whether the accuracy can be told from chance."""
        return self.p_value < SIGNIFICANCE


def chance_of(predicted: IntArray, labels: IntArray) -> Chance | None:
    """Return the test of predictions (samples,), -1 where nothing is predicted, against labels (samples,).

    None for fewer than 20 recordings, and if all have one label, so that there is nothing to tell apart.
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
