"""Whether an accuracy differs from guessing the commonest label: the p-value against sums of binomial terms."""

import math
from fractions import Fraction

import numpy as np
import pytest

from locsnn_compile.verification.chance import chance_of


def at_least(right: int, recordings: int, share: Fraction) -> float:
    """Return the probability that guesses are right in ``right`` recordings or more; ``share`` is that of each guess."""
    terms = (
        math.comb(recordings, k) * share**k * (1 - share) ** (recordings - k)
        for k in range(right, recordings + 1)
    )
    return float(sum(terms))


@pytest.mark.parametrize("right", [0, 5, 8, 9, 10, 20])
def test_the_p_value_is_a_sum_of_binomial_terms(right: int) -> None:
    labels = np.repeat([0, 1, 2, 3], 5)
    predicted = np.where(np.arange(20) < right, labels, -1)
    chance = chance_of(predicted, labels)
    assert chance is not None
    assert chance.recordings == 20
    assert chance.right == right
    assert chance.commonest_share == 0.25
    assert chance.p_value == pytest.approx(at_least(right, 20, Fraction(1, 4)), rel=1e-12)
    # Guesses at a share of a quarter are right 9 times of 20 or more with 4.1 %, and 8 times with 10.2 %: only the
    # former is below the usual 5 %.
    assert chance.told_apart == (right >= 9)


def test_few_recordings_and_a_single_label_are_not_tested() -> None:
    labels_of_19_recordings = np.arange(19) % 2
    assert chance_of(labels_of_19_recordings, labels_of_19_recordings) is None
    equal_labels = np.ones(20, dtype=np.int64)
    assert chance_of(equal_labels, equal_labels) is None
