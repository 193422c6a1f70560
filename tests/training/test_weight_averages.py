"""Running averages of weights, alone and in a run; the picture of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
import torch
from torch import nn

from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.profile import profile
from locsnn_compile.training.schedule import follow_weights
from locsnn_compile.training.state import EpochRecord
from locsnn_compile.training.train import train

CONFIG = TrainingConfig(
    model="tactile-snn", hidden=4, epochs=4, batch_size=4, weight_average=0.9, refit=True
)
RECORDINGS = synthetic_touches(12, steps=20, classes=2, seed=5)


def layer(value: float) -> nn.Linear:
    network = nn.Linear(1, 1, bias=False)
    with torch.no_grad():
        network.weight.fill_(value)
    return network


def test_an_average_follows_the_weights() -> None:
    network, average = layer(5.0), layer(1.0)
    for _ in range(2):
        follow_weights(average, network, 0.75)
    assert average.weight.item() == 1.0 * 0.75**2 + 5.0 * (1 - 0.75**2)
    assert network.weight.item() == 5.0


@pytest.mark.parametrize("refit", [False, True], ids=["chosen", "refitted"])
def test_a_run_keeps_averages(refit: bool) -> None:
    config = replace(CONFIG, refit=refit)
    averaged = train(RECORDINGS, config).network.weights()
    plain = train(RECORDINGS, replace(config, weight_average=0.0)).network.weights()
    assert any((averaged[name] != plain[name]).any() for name in plain)


def test_a_stopped_run_with_averages_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    whole = train(RECORDINGS, CONFIG).network.weights()
    state = tmp_path / "run.state"
    stops = iter([False, True])

    def stop(*_: object) -> None:
        if next(stops, False):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(RECORDINGS, CONFIG, state_path=state, save_every=1, progress=stop)
    resumed = train(RECORDINGS, CONFIG, state_path=state, save_every=1).network.weights()
    assert all((whole[name] == resumed[name]).all() for name in whole)


def test_the_picture_has_what_was_measured(tmp_path: Path) -> None:
    history = [
        EpochRecord("select", 1, 0.1, 2.0, 2.5, 0.25), EpochRecord("select", 2, 0.05, 1.0, 1.5, 0.5),
        EpochRecord("refit", 1, 0.1, 1.75, None, None),
    ]  # fmt: skip
    words = [
        element.text
        for element in ElementTree.fromstring(profile(history, "a <b>")).iter()
        if element.text
    ]
    assert "Training of a <b>" in words
    for label in (
        "training, part of the recordings",
        "training afresh, all recordings",
        "accuracy",
    ):
        assert label in words
    assert "accuracy" not in [
        element.text
        for element in ElementTree.fromstring(profile(history[2:], "b")).iter()
        if element.text
    ]
    train(RECORDINGS, replace(CONFIG, epochs=1), name="touch", log_path=tmp_path / "log.csv")
    assert b"Training of touch" in (tmp_path / "log.svg").read_bytes()
