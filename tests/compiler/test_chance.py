"""Whether an accuracy can be told from chance: sums of binomial terms, written out."""

import math
from fractions import Fraction

import numpy as np
import pytest

from locsnn_compile.verification.chance import chance_of


def at_least(right: int, recordings: int, share: Fraction) -> float:
    """The probability that guesses, each right with a share, are right in so many of the recordings or more."""
    terms = (
        math.comb(recordings, k) * share**k * (1 - share) ** (recordings - k)
        for k in range(right, recordings + 1)
    )
    return float(sum(terms))


@pytest.mark.parametrize("right", [0, 5, 8, 9, 10, 20])
def test_the_test_is_a_sum_of_binomial_terms(right: int) -> None:
    labels = np.repeat([0, 1, 2, 3], 5)
    predicted = np.where(np.arange(20) < right, labels, -1)
    found = chance_of(predicted, labels)
    assert found is not None
    assert (found.recordings, found.right, found.commonest_share) == (20, right, 0.25)
    assert found.p_value == pytest.approx(at_least(right, 20, Fraction(1, 4)), rel=1e-12)
    # With a share of a quarter, 9 of 20 are reached by 4.1 % of guesses, and 8 by 10.2 %.
    assert found.told_apart == (right >= 9)


def test_few_recordings_and_a_single_label_are_not_tested() -> None:
    few = np.arange(19) % 2
    assert chance_of(few, few) is None
    alike = np.ones(20, dtype=np.int64)
    assert chance_of(alike, alike) is None
