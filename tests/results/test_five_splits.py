"""Five splits of all recordings (``five_splits.py``): what each round trains and tests on, and the table of rounds.

Training is replaced by a class that keeps what it is given; recordings carry their numbers in their spikes.
"""

from __future__ import annotations

import csv
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.training.config import TrainingConfig

STUDY = Path(__file__).parents[2] / "docs/research/results"
CLASSES = 20
TRAIN_OF_CLASS = 12
TEST_OF_CLASS = 3
CHANNELS = 10
"""Bits of the number of a recording, which is 300 at most."""


@pytest.fixture(autouse=True)
def study_can_be_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let tests import ``five_splits``, a program that lies next to its page."""
    monkeypatch.syspath_prepend(str(STUDY))


def numbered(numbers: range, recordings_of_class: int, source: str) -> Recordings:
    """Return recordings of one step whose spikes are their numbers in binary."""
    bits = np.arange(CHANNELS)
    spikes = (np.array(numbers)[:, None, None] >> bits) & 1
    labels = np.repeat(np.arange(CLASSES), recordings_of_class)
    return Recordings(spikes, labels, step_seconds=0.02, source=source)


def numbers_of(recordings: Recordings) -> list[int]:
    """Return the numbers of recordings, from their spikes (see :func:`numbered`)."""
    return (recordings.spikes[:, 0] @ (1 << np.arange(CHANNELS))).tolist()


def both_parts(*_: object) -> tuple[Recordings, Recordings]:
    """Recordings 1 to 240 to train on and 241 to 300 to test on, as many as Containers has."""
    to_train = CLASSES * TRAIN_OF_CLASS
    every = to_train + CLASSES * TEST_OF_CLASS
    return (
        numbered(range(1, to_train + 1), TRAIN_OF_CLASS, "train"),
        numbered(range(to_train + 1, every + 1), TEST_OF_CLASS, "test"),
    )


class Rounds:
    """Stands for ``train_network``, and keeps what it was given in each round."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.seeds: list[int] = []
        self.trained: list[list[int]] = []
        self.tested: list[list[int]] = []
        self.tested_of_class: list[list[int]] = []

    def __call__(
        self, path: Path, config: TrainingConfig, train: Recordings, test: Recordings
    ) -> None:
        assert test.labels is not None
        path.touch()
        self.names.append(path.name)
        self.seeds.append(config.seed)
        self.trained.append(numbers_of(train))
        self.tested.append(numbers_of(test))
        self.tested_of_class.append(np.bincount(test.labels).tolist())


@pytest.fixture
def rounds(monkeypatch: pytest.MonkeyPatch) -> Rounds:
    """Replace recordings, training and checkpoints of the program; return what keeps the rounds."""
    import five_splits

    rounds = Rounds()
    monkeypatch.setattr(five_splits, "parts", both_parts)
    monkeypatch.setattr(five_splits, "train_network", rounds)
    # Network k of five has an accuracy of k/8.
    monkeypatch.setattr(
        five_splits,
        "read_checkpoint",
        lambda path: SimpleNamespace(training={"test_accuracy": int(path.stem[-1]) / 8}),
    )
    return rounds


def run(folder: Path, *further: str) -> list[list[str]]:
    """Run the program on Containers for some rows, by default the hybrid; return the table that it writes."""
    import five_splits

    table = folder / "splits.csv"
    arguments = ["--work", str(folder), "--table", str(table), "--datasets", "containers"]
    five_splits.main([*arguments, "--rows", *(further or ["hybrid"])])
    with table.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def test_five_rounds_test_on_each_recording_of_both_parts_once(
    rounds: Rounds, tmp_path: Path
) -> None:
    run(tmp_path)
    every = list(range(1, 301))
    assert sorted(number for tested in rounds.tested for number in tested) == every
    for trained, tested in zip(rounds.trained, rounds.tested, strict=True):
        assert sorted(trained + tested) == every
    assert rounds.tested_of_class == [[(TRAIN_OF_CLASS + TEST_OF_CLASS) // 5] * CLASSES] * 5
    assert rounds.seeds == [0, 1, 2, 3, 4]


def test_networks_that_are_there_are_not_trained_again(rounds: Rounds, tmp_path: Path) -> None:
    for number in (1, 2, 4):
        (tmp_path / f"containers-hybrid-split-{number}.pt").touch()
    run(tmp_path)
    assert rounds.names == ["containers-hybrid-split-3.pt", "containers-hybrid-split-5.pt"]


def test_table_of_splits_keeps_rows_whose_networks_are_not_there(
    rounds: Rounds, tmp_path: Path
) -> None:
    # k/8 of the networks of all five rounds: see `rounds`.
    of_rounds = ["0.1250", "0.2500", "0.3750", "0.5000", "0.6250"]
    table = run(tmp_path)
    assert table[0] == ["network", *(f"split {number}" for number in range(1, 6))]
    assert ["Hybrid, lambda 1, loop, Containers", *of_rounds] in table
    for network in tmp_path.glob("*.pt"):
        network.unlink()
    table = run(tmp_path, "hybrid-published")
    assert ["Hybrid, lambda 1, loop, Containers", *of_rounds] in table
    assert ["Hybrid, published training, Containers", *of_rounds] in table
    assert ["Hybrid, lambda 1, loop, Objects", *["not run"] * 5] in table
