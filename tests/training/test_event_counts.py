"""The baseline of every run, ridge regression from event counts, against least squares by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from locsnn_compile.training.event_counts import counts_in_bins, measure_baselines, ridge_scores


def by_least_squares(training: np.ndarray, labels: np.ndarray, test: np.ndarray) -> np.ndarray:
    """Return the class scores of test counts by least squares, with the ridge as further rows of the system."""
    mean = training.mean(axis=0)
    scale = training.std(axis=0)
    scale[scale == 0] = np.inf
    z = np.c_[(training - mean) / scale, np.ones(len(training))]
    ridge = np.sqrt(len(training)) * np.eye(z.shape[1])
    classes = labels.max() + 1
    targets = np.r_[np.eye(classes)[labels], np.zeros((z.shape[1], classes))]
    weights = np.linalg.lstsq(np.r_[z, ridge], targets, rcond=None)[0]
    return np.c_[(test - mean) / scale, np.ones(len(test))] @ weights


@pytest.mark.parametrize("channels", [3, 40], ids=["fewer channels", "fewer recordings"])
def test_scores_are_those_of_ridge_regression(channels: int) -> None:
    rng = np.random.default_rng(0)
    training = rng.poisson(4, (12, channels)).astype(float)
    test = rng.poisson(4, (5, channels)).astype(float)
    training[:, 0] = 2  # a channel that does not vary
    labels = np.arange(12) % 3
    scores = ridge_scores(training, labels, test)
    assert np.allclose(scores, by_least_squares(training, labels, test))


def test_the_first_bins_are_a_step_longer_if_steps_do_not_divide_evenly() -> None:
    spikes = np.ones((1, 10, 2), dtype=np.uint8)
    assert counts_in_bins(spikes, 4).tolist() == [[3, 3, 3, 3, 2, 2, 2, 2]]
    assert counts_in_bins(spikes, 1).tolist() == [[10, 10]]


def test_classes_that_differ_only_in_time_are_told_apart_by_counts_in_bins_alone() -> None:
    spikes = np.zeros((20, 16, 1), dtype=np.uint8)
    spikes[::2, 1:5] = 1
    spikes[1::2, 11:15] = 1
    labels = np.arange(20) % 2
    baselines = measure_baselines(spikes, labels, spikes, labels)
    assert (baselines.counts, baselines.counts_in_bins, baselines.better) == (0.5, 1.0, 1.0)
