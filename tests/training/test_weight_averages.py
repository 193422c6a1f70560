"""Running averages of weights, by themselves and in a training run, and the picture of a run."""

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
    """A layer with a single weight."""
    network = nn.Linear(1, 1, bias=False)
    with torch.no_grad():
        network.weight.fill_(value)
    return network


def test_an_average_follows_the_weights() -> None:
    network, average = layer(5.0), layer(1.0)
    decay = 0.75
    for _ in range(2):
        follow_weights(average, network, decay)
    assert average.weight.item() == 1.0 * decay**2 + 5.0 * (1 - decay**2)
    assert network.weight.item() == 5.0


@pytest.mark.parametrize("refit", [False, True], ids=["chosen", "refitted"])
def test_the_result_of_a_run_is_the_averages(refit: bool) -> None:
    config = replace(CONFIG, refit=refit)
    averaged = train(RECORDINGS, config).network.weights()
    plain = train(RECORDINGS, replace(config, weight_average=0.0)).network.weights()
    assert any((averaged[name] != plain[name]).any() for name in plain)


def test_a_stopped_run_with_averages_continues_to_the_same_bits(tmp_path: Path) -> None:
    uninterrupted = train(RECORDINGS, CONFIG).network.weights()
    state = tmp_path / "run.state"
    stops = iter([False, True])

    def stop(*_: object) -> None:
        if next(stops, False):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(RECORDINGS, CONFIG, state_path=state, save_every=1, progress=stop)
    resumed = train(RECORDINGS, CONFIG, state_path=state, save_every=1).network.weights()
    assert all((uninterrupted[name] == resumed[name]).all() for name in uninterrupted)


def texts_of(picture: bytes) -> list[str]:
    """The texts in an SVG picture."""
    return [element.text for element in ElementTree.fromstring(picture).iter() if element.text]


def test_the_picture_shows_the_figures_that_were_measured(tmp_path: Path) -> None:
    # Phase, epoch, learning rate, loss, validation loss, validation accuracy.
    history = [
        EpochRecord(
            "select",
            epoch=1,
            learning_rate=0.1,
            loss=2.0,
            validation_loss=2.5,
            validation_accuracy=0.25,
        ),
        EpochRecord(
            "select",
            epoch=2,
            learning_rate=0.05,
            loss=1.0,
            validation_loss=1.5,
            validation_accuracy=0.5,
        ),
        EpochRecord(
            "refit",
            epoch=1,
            learning_rate=0.1,
            loss=1.75,
            validation_loss=None,
            validation_accuracy=None,
        ),
    ]
    words = texts_of(profile(history, "a <b>"))
    assert "Training of a <b>" in words
    for label in (
        "training, part of the recordings",
        "training afresh, all recordings",
        "accuracy",
    ):
        assert label in words
    assert "accuracy" not in texts_of(profile(history[2:], "b"))
    train(RECORDINGS, replace(CONFIG, epochs=1), name="touch", log_path=tmp_path / "log.csv")
    assert b"Training of touch" in (tmp_path / "log.svg").read_bytes()
