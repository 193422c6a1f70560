"""The losses against their formulas, written out in numpy."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.measure import (
    batch_loss,
    class_weights,
    count_cross_entropy,
    spike_count_loss,
    weighted_counts,
)

SEEDS = st.integers(0, 2**31)


def draw(seed: int, batch: int = 3, classes: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    time, location = rng.integers(0, 60, size=(2, batch, classes)).astype(np.float64)
    return time, location, rng.integers(0, classes, size=batch)


@given(seed=SEEDS, right=st.floats(1, 200), wrong=st.floats(0, 10))
@settings(max_examples=25, deadline=None)
def test_spike_count_loss(seed: int, right: float, wrong: float) -> None:
    counts, _, labels = draw(seed)
    expected = np.mean(
        [
            0.5 * sum((row[k] - (right if k == label else wrong)) ** 2 for k in range(4))
            for row, label in zip(counts, labels, strict=True)
        ]
    )
    found = spike_count_loss(torch.from_numpy(counts), torch.from_numpy(labels), target_right=right, target_wrong=wrong)
    assert float(found) == pytest.approx(expected, rel=1e-12)


@given(seed=SEEDS, weight=st.floats(0, 2))
@settings(max_examples=25, deadline=None)
def test_weighted_spike_count_loss(seed: int, weight: float) -> None:
    time, location, labels = draw(seed)
    branches = {"time": torch.from_numpy(time), "location": torch.from_numpy(location)}
    targets = np.where(np.arange(4) == labels[:, None], 150, 5)
    expected = np.mean(0.5 * ((time + weight * location - targets) ** 2).sum(axis=1))
    counts = weighted_counts(branches, weight)
    found = spike_count_loss(counts, torch.from_numpy(labels), target_right=150, target_wrong=5)
    assert float(found) == pytest.approx(expected, rel=1e-12)


def test_a_branch_alone_is_not_weighted() -> None:
    counts = torch.ones(2, 3)
    assert weighted_counts({"location": counts}, 0.5) is counts


@given(seed=SEEDS, scale=st.floats(0.01, 1), smoothing=st.floats(0, 0.5))
@settings(max_examples=25, deadline=None)
def test_count_cross_entropy(seed: int, scale: float, smoothing: float) -> None:
    counts, _, labels = draw(seed)
    logits = scale * counts
    top = logits.max(axis=1, keepdims=True)
    log_share = logits - top - np.log(np.exp(logits - top).sum(axis=1, keepdims=True))
    targets = np.where(np.arange(4) == labels[:, None], 1 - smoothing, 0) + smoothing / 4
    expected = -(targets * log_share).sum(axis=1).mean()
    found = count_cross_entropy(
        torch.from_numpy(counts), torch.from_numpy(labels), count_scale=scale, label_smoothing=smoothing
    )
    assert float(found) == pytest.approx(expected, rel=1e-10, abs=1e-12)


class Counted:
    """A network whose class scores are counts, as they are."""

    def __init__(self, counts: np.ndarray) -> None:
        self.counts = torch.from_numpy(counts)

    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        return self.counts[x]

    def scores(self, activity: torch.Tensor) -> dict[str, torch.Tensor]:
        return {"time": activity}


@pytest.mark.parametrize("loss", ["cross-entropy", "spike-count"])
@given(seed=SEEDS)
@settings(max_examples=10, deadline=None)
def test_recordings_count_as_much_as_their_class(loss: str, seed: int) -> None:
    counts, _, labels = draw(seed, batch=5)
    network, config, rows = Counted(counts), TrainingConfig(loss=loss), torch.arange(5)
    weights = torch.from_numpy(np.random.default_rng(seed).uniform(0, 3, 4))
    y = torch.from_numpy(labels)
    each = [float(batch_loss(network, config, rows[i : i + 1], y[i : i + 1])) for i in range(5)]  # type: ignore[arg-type]
    found = float(batch_loss(network, config, rows, y, weights))  # type: ignore[arg-type]
    assert found == pytest.approx(np.mean(weights[y].numpy() * each), rel=1e-9)
    alike = float(batch_loss(network, config, rows, y, torch.ones(4)))  # type: ignore[arg-type]
    assert alike == pytest.approx(float(batch_loss(network, config, rows, y)))  # type: ignore[arg-type]


def test_balanced_classes_count_alike() -> None:
    labels = np.array([0] * 6 + [2] * 2)
    assert class_weights(TrainingConfig(), labels, 3) is None
    found = class_weights(TrainingConfig(class_weights="balanced"), labels, 3)
    assert found is not None
    shares = found.numpy()[labels]
    assert shares.sum() == 8  # on average a recording counts as before
    assert shares[labels == 0].sum() == shares[labels == 2].sum() == 4
