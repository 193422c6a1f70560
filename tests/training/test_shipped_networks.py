"""The shipped networks reach the accuracy they claim, on the real recordings where these are at hand."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import torch

from locsnn_compile.data.read import read_recordings
from locsnn_compile.models.checkpoint import save_checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.networks import build_network
from locsnn_compile.training.config import TrainingConfig, config_from_mapping, read_config

ROOT = Path(__file__).parents[2]
REAL = ROOT.parent / "shared/data/neutouch"
NAMES = ("objects", "containers")


@pytest.mark.parametrize("name", NAMES)
def test_shipped_networks_are_whole(name: str) -> None:
    found = read_checkpoint(ROOT / f"examples/models/{name}-hybrid.pt")
    assert found.description.name == f"{name}-hybrid"
    assert found.description.architecture == "hybrid"
    # Weights alone: the recordings they were trained on are not ours to give away.
    assert found.recordings is None
    assert found.training["dataset"] == f"Ev-{name.title()}.zip"


@pytest.mark.parametrize("name", NAMES)
def test_shipped_networks_were_trained_by_the_shipped_configuration(name: str) -> None:
    training = read_checkpoint(ROOT / f"examples/models/{name}-hybrid.pt").training
    config = config_from_mapping(read_config(ROOT / f"examples/configs/{name}-hybrid.yaml"))
    # Options that came later have no entry in older files: they are as they were, at their defaults.
    defaults = vars(TrainingConfig())
    given = {key: value for key, value in vars(config).items() if key != "seed"}
    assert {key: training.get(key, defaults[key]) for key in given} == given


@pytest.mark.parametrize("name", NAMES)
def test_model_cards_agree_with_their_networks(name: str) -> None:
    training = read_checkpoint(ROOT / f"examples/models/{name}-hybrid.pt").training
    card = (ROOT / f"examples/models/{name}-hybrid.md").read_text(encoding="utf-8")
    rows = {int(row[0]): row[1:] for row in re.findall(r"^\| (\d) \| (\d+) \| ([\d.]+) \| ([\d.]+) \|$", card, re.M)}
    assert sorted(rows) == [0, 1, 2, 3, 4]
    figures = [(float(validation), float(test)) for _, validation, test in rows.values()]
    best = min(range(5), key=lambda seed: (-figures[seed][0], seed))
    assert training["seed"] == best
    epoch, validation, test = rows[best]
    assert int(epoch) == training["chosen_epoch"]
    assert f"{training['validation_accuracy']:.3f}" == validation
    assert f"{training['test_accuracy']:.3f}" == test
    tests = np.array([test for _, test in figures])
    assert f"mean {tests.mean():.3f}, sample standard deviation {tests.std(ddof=1):.3f}" in card


@pytest.mark.skipif(not REAL.is_dir(), reason="the real recordings are not beside the repository")
@pytest.mark.parametrize("name", NAMES)
def test_shipped_networks_reach_their_test_accuracy(name: str) -> None:
    found = read_checkpoint(ROOT / f"examples/models/{name}-hybrid.pt")
    recordings = read_recordings(REAL / f"Ev-{name.title()}.zip", split="test")
    network = build_network(found.description)
    network.load_weights(found.weights)
    with torch.no_grad():
        counts = network.double().counts(torch.from_numpy(recordings.spikes.copy()).double())
    assert recordings.labels is not None
    assert float((counts.argmax(dim=1).numpy() == recordings.labels).mean()) == found.training["test_accuracy"]


@pytest.mark.parametrize("name", NAMES)
def test_shipped_networks_survive_a_round_trip(tmp_path: Path, name: str) -> None:
    path = ROOT / f"examples/models/{name}-hybrid.pt"
    found = read_checkpoint(path)
    save_checkpoint(tmp_path / "again.pt", found.description, found.weights, training=found.training)
    again = read_checkpoint(tmp_path / "again.pt")
    assert again.description == found.description
    assert all(np.array_equal(again.weights[key], found.weights[key]) for key in found.weights)
