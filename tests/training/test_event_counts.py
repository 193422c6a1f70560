"""What counting events reaches is the baseline of every run: ridge regression, by its definition."""

from __future__ import annotations

import numpy as np
import pytest

from locsnn_compile.training.event_counts import counts_in_bins, measure_baselines, ridge_scores


def by_definition(known: np.ndarray, labels: np.ndarray, unknown: np.ndarray) -> np.ndarray:
    """Solve the least squares with the penalty as more rows: a way of its own."""
    mean, scale = known.mean(axis=0), known.std(axis=0)
    scale[scale == 0] = np.inf
    z = np.c_[(known - mean) / scale, np.ones(len(known))]
    penalty = np.sqrt(len(known)) * np.eye(z.shape[1])
    wanted = np.r_[np.eye(labels.max() + 1)[labels], np.zeros((z.shape[1], labels.max() + 1))]
    weights = np.linalg.lstsq(np.r_[z, penalty], wanted, rcond=None)[0]
    return np.c_[(unknown - mean) / scale, np.ones(len(unknown))] @ weights


@pytest.mark.parametrize("channels", [3, 40], ids=["fewer channels", "fewer recordings"])
def test_scores_are_those_of_ridge_regression(channels: int) -> None:
    rng = np.random.default_rng(0)
    known, unknown = rng.poisson(4, (12, channels)), rng.poisson(4, (5, channels))
    known[:, 0] = 2  # a channel that says nothing
    labels = np.arange(12) % 3
    scores = ridge_scores(known.astype(float), labels, unknown.astype(float))
    assert np.allclose(scores, by_definition(known.astype(float), labels, unknown.astype(float)))


def test_bins_share_the_steps_of_a_recording() -> None:
    spikes = np.ones((1, 10, 2), dtype=np.uint8)
    assert counts_in_bins(spikes, 4).tolist() == [[3, 3, 3, 3, 2, 2, 2, 2]]
    assert counts_in_bins(spikes, 1).tolist() == [[10, 10]]


def test_order_in_time_is_seen_in_bins_alone() -> None:
    # The first class is active first; numbers of events are equal.
    spikes = np.zeros((20, 16, 1), dtype=np.uint8)
    spikes[::2, 1:5], spikes[1::2, 11:15] = 1, 1
    labels = np.arange(20) % 2
    found = measure_baselines(spikes, labels, spikes, labels)
    assert (found.counts, found.counts_in_bins, found.better) == (0.5, 1.0, 1.0)
