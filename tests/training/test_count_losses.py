"""The losses of class scores, against their formulas written out in numpy, and the options that shape them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from locsnn_compile.errors import InputError
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.measure import Loss, class_weights, label_shares, weighted_counts

SEEDS = st.integers(0, 2**31)


def draw(seed: int, batch: int = 3, classes: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random (counts of a time branch, counts of a location branch, labels); counts are (batch, classes)."""
    rng = np.random.default_rng(seed)
    time, location = rng.integers(0, 60, size=(2, batch, classes)).astype(np.float64)
    return time, location, rng.integers(0, classes, size=batch)


@given(seed=SEEDS, right=st.floats(1, 200), wrong=st.floats(0, 10))
@settings(max_examples=25, deadline=None)
def test_the_spike_count_loss_is_its_formula(seed: int, right: float, wrong: float) -> None:
    counts, _, labels = draw(seed)
    expected = np.mean(
        [
            0.5 * sum((row[k] - (right if k == label else wrong)) ** 2 for k in range(4))
            for row, label in zip(counts, labels, strict=True)
        ]
    )
    loss = Loss(TrainingConfig(loss="spike-count", target_right=right, target_wrong=wrong), 4)
    mean_loss = loss.of_counts(torch.from_numpy(counts), torch.from_numpy(labels)).mean()
    assert float(mean_loss) == pytest.approx(expected, rel=1e-12)


@given(seed=SEEDS, weight=st.floats(0, 2))
@settings(max_examples=25, deadline=None)
def test_the_spike_count_loss_of_two_branches_is_its_formula(seed: int, weight: float) -> None:
    time, location, labels = draw(seed)
    branches = {"time": torch.from_numpy(time), "location": torch.from_numpy(location)}
    targets = np.where(np.arange(4) == labels[:, None], 150, 5)
    expected = np.mean(0.5 * ((time + weight * location - targets) ** 2).sum(axis=1))
    counts = weighted_counts(branches, weight)
    loss = Loss(TrainingConfig(loss="spike-count", target_right=150.0, target_wrong=5.0), 4)
    mean_loss = loss.of_counts(counts, torch.from_numpy(labels)).mean()
    assert float(mean_loss) == pytest.approx(expected, rel=1e-12)


def test_a_single_branch_is_not_weighted() -> None:
    counts = torch.ones(2, 3)
    assert weighted_counts({"location": counts}, 0.5) is counts


@given(seed=SEEDS, scale=st.floats(0.01, 1), smoothing=st.floats(0, 0.5))
@settings(max_examples=25, deadline=None)
def test_the_cross_entropy_of_counts_is_its_formula(
    seed: int, scale: float, smoothing: float
) -> None:
    counts, _, labels = draw(seed)
    logits = scale * counts
    top = logits.max(axis=1, keepdims=True)
    log_probabilities = logits - top - np.log(np.exp(logits - top).sum(axis=1, keepdims=True))
    targets = np.where(np.arange(4) == labels[:, None], 1 - smoothing, 0) + smoothing / 4
    expected = -(targets * log_probabilities).sum(axis=1).mean()
    loss = Loss(TrainingConfig(count_scale=scale, label_smoothing=smoothing), 4)
    mean_loss = loss.of_counts(torch.from_numpy(counts), torch.from_numpy(labels)).mean()
    assert float(mean_loss) == pytest.approx(expected, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("branch_loss", [0.25, 1.0])
def test_branches_have_a_share_of_the_loss(branch_loss: float) -> None:
    time, location, labels = draw(3)
    branches = {"time": torch.from_numpy(time), "location": torch.from_numpy(location)}
    y = torch.from_numpy(labels)

    class Branches:
        """A network whose activity is the scores of its branches."""

        def scores(self, activity: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
            return activity

    def loss(share: float, scores: dict[str, torch.Tensor]) -> float:
        return float(Loss(TrainingConfig(branch_loss=share), 4)(Branches(), scores, y))  # type: ignore[arg-type]

    loss_of_branches = [loss(0.0, {name: counts}) for name, counts in branches.items()]
    mean_of_branches = sum(loss_of_branches) / 2
    expected = (1 - branch_loss) * loss(0.0, branches) + branch_loss * mean_of_branches
    assert loss(branch_loss, branches) == pytest.approx(expected, rel=1e-9)


class Counted:
    """A network whose activity, for row numbers as input, is a row of given counts, and whose scores are its activity."""

    def __init__(self, counts: np.ndarray) -> None:
        self.counts = torch.from_numpy(counts)

    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        return self.counts[x]

    def scores(self, activity: torch.Tensor) -> dict[str, torch.Tensor]:
        return {"time": activity}


@pytest.mark.parametrize("kind", ["cross-entropy", "spike-count"])
@given(seed=SEEDS)
@settings(max_examples=10, deadline=None)
def test_recordings_count_as_much_as_their_class(kind: str, seed: int) -> None:
    counts, _, labels = draw(seed, batch=5)
    network = Counted(counts)
    loss = Loss(TrainingConfig(loss=kind), 4)
    rows = torch.arange(5)
    weights = torch.from_numpy(np.random.default_rng(seed).uniform(0, 3, 4))
    y = torch.from_numpy(labels)
    losses = [float(loss(network, network(rows[i : i + 1]), y[i : i + 1])) for i in range(5)]  # type: ignore[arg-type]
    weighted_loss = float(loss(network, network(rows), y, weights))  # type: ignore[arg-type]
    assert weighted_loss == pytest.approx(np.mean(weights[y].numpy() * losses), rel=1e-9)
    with_equal_weights = float(loss(network, network(rows), y, torch.ones(4)))  # type: ignore[arg-type]
    assert with_equal_weights == pytest.approx(float(loss(network, network(rows), y)))  # type: ignore[arg-type]


def test_balanced_classes_count_alike() -> None:
    labels = np.array([0] * 6 + [2] * 2)
    assert class_weights(TrainingConfig(), labels, 3) is None
    weights = class_weights(TrainingConfig(class_weights="balanced"), labels, 3)
    assert weights is not None
    weight_of_recording = weights.numpy()[labels]
    assert weight_of_recording.sum() == len(labels)  # 1 on average
    assert weight_of_recording[labels == 0].sum() == weight_of_recording[labels == 2].sum() == 4


NEAR = {"neighbour_smoothing": 0.1, "class_order": "0-2, 3-4"}


def test_neighbouring_classes_share_a_label() -> None:
    shares = label_shares(TrainingConfig(label_smoothing=0.0, **NEAR), 6)
    assert shares.round(12).tolist() == [
        [0.9, 0.1, 0, 0, 0, 0],
        [0.1, 0.8, 0.1, 0, 0, 0],
        [0, 0.1, 0.9, 0, 0, 0],
        [0, 0, 0, 0.9, 0.1, 0],
        [0, 0, 0, 0.1, 0.9, 0],
        [0, 0, 0, 0, 0, 1],
    ]


def test_neighbours_share_the_probability_that_label_smoothing_leaves() -> None:
    shares = label_shares(TrainingConfig(label_smoothing=0.3, **NEAR), 6)
    assert shares[1].round(12).tolist() == [0.12, 0.61, 0.12, 0.05, 0.05, 0.05]
    assert shares.sum(axis=1).round(12).tolist() == [1.0] * 6


def test_a_file_may_state_how_near_classes_are(tmp_path: Path) -> None:
    (tmp_path / "near.csv").write_text("0,2,0\n2,0,1\n0,0,0\n")
    config = TrainingConfig(
        label_smoothing=0.0, neighbour_smoothing=0.1, class_order=str(tmp_path / "near.csv")
    )
    assert label_shares(config, 3).round(12).tolist() == [[0.8, 0.2, 0], [0.2, 0.7, 0.1], [0, 0, 1]]


def test_the_loss_uses_the_shares_of_neighbours_as_targets() -> None:
    config = TrainingConfig(label_smoothing=0.0, count_scale=1.0, **NEAR)
    counts, y = torch.tensor([[1.0, 3.0, 2.0, 0, 0, 0]], dtype=torch.float64), torch.tensor([0])
    logs = counts.log_softmax(dim=1)[0]
    assert float(Loss(config, 6).of_counts(counts, y)) == pytest.approx(
        float(-0.9 * logs[0] - 0.1 * logs[1])
    )


RANGES = "Give, for example, '0-4 5-9'."


@pytest.mark.parametrize(
    ("smoothing", "order", "message"),
    [
        (0.1, "0:4", f"it must be ranges of classes, or a .csv file (got '0:4'). {RANGES}"),
        (0.1, "levels", f"it must be ranges of classes, or a .csv file (got 'levels'). {RANGES}"),
        (0.1, "0-1-2", f"it must be ranges of classes, or a .csv file (got '0-1-2'). {RANGES}"),
        (0.1, "0-1 2-6", f"a range must rise within the classes (got '2-6' against 0-5). {RANGES}"),
        (0.1, "3-3", f"a range must rise within the classes (got '3-3' against 0-5). {RANGES}"),
        (
            0.1,
            "none.csv",
            f"its file is missing, or does not hold numbers (got 'none.csv'). {RANGES}",
        ),
        (
            0.1,
            "words.csv",
            f"its file is missing, or does not hold numbers (got 'words.csv'). {RANGES}",
        ),
        (
            0.1,
            "small.csv",
            f"its matrix is not (classes, classes) (got (1, 2) against (6, 6)). {RANGES}",
        ),
        (
            0.1,
            "minus.csv",
            f"its matrix must hold 0 or more, and 0 for a class and itself (got 'minus.csv'). {RANGES}",
        ),
        (
            0.1,
            "itself.csv",
            f"its matrix must hold 0 or more, and 0 for a class and itself (got 'itself.csv'). {RANGES}",
        ),
        (
            0.4,
            "0-5",
            "label 1 would get no more than a neighbour (0.2 against 0.4). Give a smaller share.",
        ),
    ],
)
def test_impossible_neighbours_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, smoothing: float, order: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, matrix in (
        ("small", np.zeros((1, 2))),
        ("minus", -np.ones((6, 6))),
        ("itself", np.eye(6)),
    ):
        np.savetxt(f"{name}.csv", matrix, delimiter=",")
    Path("words.csv").write_text("a,b\n")
    option = "neighbour_smoothing" if smoothing == 0.4 else "class_order"
    with pytest.raises(InputError) as caught:
        Loss(TrainingConfig(neighbour_smoothing=smoothing, class_order=order), 6)
    assert str(caught.value) == f"training option '{option}': {message}"
