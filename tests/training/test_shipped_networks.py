"""The networks that ship: their files, cards and configurations agree, and they reach the accuracy that they claim.

Accuracies are measured on the real recordings, if these lie next to the repository. Programs must spike like the
networks in torch from which they are compiled.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import hw_model as hw
import locsnn_compile as lc
from hw_model.values import IntArray
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import neutouch, read_layout
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.frontends import load
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.networks import build_network
from locsnn_compile.network.network import Network
from locsnn_compile.pipeline import lower
from locsnn_compile.settings import TRAINABLE
from locsnn_compile.training.config import TrainingConfig, config_from_mapping, read_config
from locsnn_compile.training.target import chip_numbers
from tests.support.real_recordings import REAL, on_real_recordings

ROOT = Path(__file__).parents[2]
NAMES = ("objects", "containers")
CHIP = hw.chip("loihi-sim")
WEIGHT_BITS = 8
SEEDS = [0, 1, 2, 3, 4]
"""The seeds of the runs that a model card lists."""
CONTAINERS_TEST = 60
OBJECTS_TEST = 144
"""Recordings of the test parts."""


def model(name: str) -> Path:
    """The file of a network that ships."""
    return ROOT / f"examples/models/{name}.pt"


def card_of(path: Path) -> str:
    """The text of the model card next to a file."""
    return path.with_suffix(".md").read_text(encoding="utf-8")


def rows_by_seed(card: str, row: str) -> dict[int, tuple[str, ...]]:
    """Return the rows of a card's table of runs, by seed; ``row`` is the pattern of a line, with the seed first."""
    return {int(seed): tuple(figures) for seed, *figures in re.findall(row, card, re.M)}


def trained_with(checkpoint: Checkpoint, options: dict[str, Any]) -> dict[str, Any]:
    """Return the values with which a network was trained for some options; those that its file lacks had defaults."""
    defaults = vars(TrainingConfig(defaults="fixed"))
    return {name: checkpoint.training.get(name, defaults[name]) for name in options}


def options_of(config: str) -> dict[str, Any]:
    """Return all options of a shipped configuration."""
    return vars(config_from_mapping(read_config(ROOT / f"examples/configs/{config}.yaml")))


def mismatches(checkpoint: Checkpoint, network: Network, recordings: Recordings) -> tuple[int, int]:
    """Return (spikes in which torch and the compiled program differ, all spikes of torch)."""
    assert checkpoint.chip is not None
    in_torch = build_network(checkpoint.description, chip=checkpoint.chip)
    in_torch.load_weights(checkpoint.float_weights)
    with torch.no_grad():
        torch_spikes = in_torch(torch.from_numpy(recordings.spikes.copy()).float())
    simulated = hw.simulate(lower(network, CHIP, WEIGHT_BITS).program, recordings.spikes)
    differing = sum(
        int((simulated.spikes[name] != spikes.numpy()).sum())
        for name, spikes in torch_spikes.items()
    )
    return differing, sum(int(spikes.sum()) for spikes in torch_spikes.values())


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_network_has_its_name_and_no_recordings(name: str) -> None:
    checkpoint = read_checkpoint(ROOT / f"examples/models/{name}-hybrid.pt")
    assert checkpoint.description.name == f"{name}-hybrid"
    assert checkpoint.description.architecture == "hybrid"
    # The licence of the recordings that it was trained on does not allow us to ship any of them.
    assert checkpoint.recordings is None
    assert checkpoint.training["dataset"] == f"Ev-{name.title()}.zip"


@pytest.mark.parametrize("name", NAMES)
def test_shipped_networks_were_trained_by_the_shipped_configuration(name: str) -> None:
    options = options_of(f"{name}-hybrid")
    del options["seed"]  # the network that ships is that of the best of five
    assert trained_with(read_checkpoint(model(f"{name}-hybrid")), options) == options


@pytest.mark.parametrize("name", NAMES)
def test_model_cards_agree_with_their_networks(name: str) -> None:
    training = read_checkpoint(model(f"{name}-hybrid")).training
    card = card_of(model(f"{name}-hybrid"))
    rows = rows_by_seed(card, r"^\| (\d) \| (\d+) \| ([\d.]+) \| ([\d.]+) \|$")
    assert sorted(rows) == SEEDS
    figures = [(float(validation), float(test)) for _, validation, test in rows.values()]
    # The best validation accuracy, and of equal ones the first seed.
    best = min(SEEDS, key=lambda seed: (-figures[seed][0], seed))
    assert training["seed"] == best
    epoch, validation, test = rows[best]
    assert int(epoch) == training["chosen_epoch"]
    assert f"{training['validation_accuracy']:.3f}" == validation
    assert f"{training['test_accuracy']:.3f}" == test
    # The exact accuracies, from which the card's figures of three digits were rounded.
    recordings = training["test_recordings"]
    tests = np.array([round(test * recordings) for _, test in figures]) / recordings
    assert f"mean {tests.mean():.3f}, sample standard deviation {tests.std(ddof=1):.3f}" in card


@on_real_recordings
@pytest.mark.parametrize("name", NAMES)
def test_shipped_networks_reach_their_test_accuracy(name: str) -> None:
    checkpoint = read_checkpoint(ROOT / f"examples/models/{name}-hybrid.pt")
    recordings = read_recordings(REAL / f"Ev-{name.title()}.zip", split="test")
    network = build_network(checkpoint.description)
    network.load_weights(checkpoint.weights)
    with torch.no_grad():
        counts = network.double().counts(torch.from_numpy(recordings.spikes.copy()).double())
    assert recordings.labels is not None
    assert (
        float((counts.argmax(dim=1).numpy() == recordings.labels).mean())
        == checkpoint.training["test_accuracy"]
    )


@pytest.mark.parametrize("name", NAMES)
def test_shipped_networks_are_written_and_read_back_equal(tmp_path: Path, name: str) -> None:
    path = ROOT / f"examples/models/{name}-hybrid.pt"
    checkpoint = read_checkpoint(path)
    Checkpoint(checkpoint.description, checkpoint.weights, training=checkpoint.training).save(
        tmp_path / "again.pt"
    )
    read_back = read_checkpoint(tmp_path / "again.pt")
    assert read_back.description == checkpoint.description
    assert all(
        np.array_equal(read_back.weights[key], checkpoint.weights[key])
        for key in checkpoint.weights
    )


TWO = ROOT / "examples/recordings/two-fingertips.npz"


def test_a_network_of_two_fingertips_ships_with_its_recordings() -> None:
    checkpoint = read_checkpoint(model("two-fingertips"))
    test = read_recordings(TWO, test_share=0.2)
    assert checkpoint.description.input.sensor == neutouch(2)
    assert checkpoint.description.location_delays == (0, 4)
    assert checkpoint.recordings is not None
    assert np.array_equal(checkpoint.recordings.spikes, test.spikes)
    options = options_of("two-fingertips-hybrid")
    assert trained_with(checkpoint, options) == options
    card = card_of(model("two-fingertips"))
    assert "**Everything here is synthetic.**" in card
    for part in ("validation", "test"):
        accuracy = checkpoint.training[f"{part}_accuracy"]
        assert re.search(rf"^\| {part} \| \d \| {accuracy:.3f} \|$", card, re.M)
    command = "locsnn train --data examples/recordings/two-fingertips.npz --config examples/configs/two-fingertips-hybrid.yaml"
    assert command in card
    assert command in (ROOT / "docs/how-to/train-a-network.md").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("strategy", TRAINABLE)
def test_both_engines_spike_alike_on_two_fingertips(strategy: str) -> None:
    network = load(model("two-fingertips"))
    test = read_recordings(TWO, test_share=0.2)
    program = lower(network, CHIP, WEIGHT_BITS, strategy).program
    slow, fast = (
        hw.simulate(program, test.spikes, engine=engine) for engine in ("reference", "fast")
    )
    for name, spikes in slow.spikes.items():
        assert np.array_equal(fast.spikes[name], spikes), name
    assert np.array_equal(slow.prediction, test.labels)


@pytest.mark.parametrize("name", NAMES)
def test_networks_trained_on_the_chips_integers_are_those_of_their_configurations(
    name: str,
) -> None:
    checkpoint = read_checkpoint(model(f"{name}-hybrid-loihi"))
    assert checkpoint.description.name == f"{name}-hybrid-loihi"
    assert checkpoint.recordings is None
    assert checkpoint.chip is not None
    assert (checkpoint.chip.target, checkpoint.chip.strategy) == ("loihi-sim", "dendrite")
    assert {numbers.weight_bits for numbers in checkpoint.chip.populations.values()} == {8}
    assert checkpoint.training["start_sha256"] == read_checkpoint(model(f"{name}-hybrid")).sha256
    options = {
        name: value
        for name, value in options_of(f"{name}-hybrid-loihi").items()
        if name in checkpoint.training
    }
    assert trained_with(checkpoint, options) == options


@pytest.mark.parametrize("name", NAMES)
def test_cards_of_networks_trained_on_the_chips_integers_agree_with_them(name: str) -> None:
    training = read_checkpoint(model(f"{name}-hybrid-loihi")).training
    card = card_of(model(f"{name}-hybrid-loihi"))
    rows = rows_by_seed(card, r"^\| (\d) \| ([\d.]+) \| ([\d.]+) \|$")
    assert sorted(rows) == SEEDS
    assert f"{training['test_accuracy']:.3f}" == rows[int(training["seed"] or 0)][1]
    tests = np.array([float(test) for _, test in rows.values()])
    stated = re.search(
        r"Test: mean ([\d.]+), sample standard deviation ([\d.]+), over five seeds", card
    )
    assert stated is not None
    # The card's means are those of the exact accuracies, and its table has rounded ones.
    assert [float(figure) for figure in stated.groups()] == pytest.approx(
        [tests.mean(), tests.std(ddof=1)], abs=1e-3
    )


@pytest.mark.parametrize("name", NAMES)
def test_programs_of_shipped_networks_spike_as_trained(name: str) -> None:
    checkpoint = read_checkpoint(model(f"{name}-hybrid-loihi"))
    network = load(model(f"{name}-hybrid-loihi"))
    touches = synthetic_touches(12, steps=checkpoint.description.input.steps, seed=3)
    differing, spikes = mismatches(checkpoint, network, touches)
    assert differing == 0
    assert spikes > 10_000


@on_real_recordings
@pytest.mark.parametrize("name", NAMES)
def test_shipped_networks_on_the_chip_reach_their_test_accuracy(name: str) -> None:
    checkpoint = read_checkpoint(model(f"{name}-hybrid-loihi"))
    network = load(model(f"{name}-hybrid-loihi"))
    test = read_recordings(REAL / f"Ev-{name.title()}.zip", split="test")
    assert mismatches(checkpoint, network, test)[0] == 0
    program = lower(network, CHIP, WEIGHT_BITS).program
    prediction = hw.simulate(program, test.spikes).prediction
    assert float((prediction == test.labels).mean()) == checkpoint.training["test_accuracy"]


@on_real_recordings
@pytest.mark.minutes
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("strategy", TRAINABLE)
@pytest.mark.parametrize("bits", [8, 4])
def test_every_strategy_spikes_as_trained_on_all_recordings(
    tmp_path: Path, name: str, strategy: str, bits: int
) -> None:
    start = read_checkpoint(model(f"{name}-hybrid"))
    config = TrainingConfig(target="loihi-sim", strategy=strategy, weight_bits=bits)
    chip = chip_numbers(config, start.description, start.weights)
    on_chip = build_network(start.description, chip=chip)
    on_chip.load_weights(start.weights)
    Checkpoint(start.description, on_chip.mantissas(), chip=chip).save(tmp_path / "on-chip.pt")
    checkpoint = read_checkpoint(tmp_path / "on-chip.pt")
    network = load(tmp_path / "on-chip.pt")
    for split in ("test", "train"):
        recordings = read_recordings(REAL / f"Ev-{name.title()}.zip", split=split)
        assert mismatches(checkpoint, network, recordings)[0] == 0


WINDOWS = {"containers-best": "levels", "containers-window-16": "16-steps"}
"""The networks of windows that ship -> the ends of the names of their configurations."""


@pytest.mark.parametrize("name", WINDOWS)
def test_networks_of_windows_are_those_of_their_configurations(name: str) -> None:
    checkpoint = read_checkpoint(model(name))
    assert (checkpoint.description.name, checkpoint.description.architecture) == (
        name,
        "window-snn",
    )
    assert checkpoint.recordings is None
    options = {
        key: value
        for key, value in options_of(f"containers-window-snn-{WINDOWS[name]}").items()
        if key in checkpoint.training
    }
    # The seed was fixed beforehand, and not picked by the result.
    assert options["seed"] == checkpoint.training["seed"] == 0
    assert trained_with(checkpoint, options) == options


# ``wrong`` is the number of wrong predictions of all five runs together.
@pytest.mark.parametrize(("name", "wrong"), [("containers-best", 37), ("containers-window-16", 38)])
def test_cards_of_networks_of_windows_agree_with_them(name: str, wrong: int) -> None:
    training = read_checkpoint(model(name)).training
    card = card_of(model(name))
    rows = rows_by_seed(card, r"^\| (\d) \| ([\d.]+) \| ([\d.]+) \|$")
    assert sorted(rows) == SEEDS
    assert rows[0][0] == f"{training['test_accuracy']:.3f}"
    right = np.array([round(CONTAINERS_TEST * float(test)) for test, _ in rows.values()])
    assert int(len(SEEDS) * CONTAINERS_TEST - right.sum()) == wrong
    tests = right / CONTAINERS_TEST
    assert (
        f"Test: mean {tests.mean():.3f}, sample standard deviation {tests.std(ddof=1):.3f}, over five seeds"
        in card
    )


@on_real_recordings
@pytest.mark.parametrize("name", WINDOWS)
def test_networks_of_windows_predict_on_the_chip_as_in_torch(name: str) -> None:
    checkpoint = read_checkpoint(model(name))
    test = read_recordings(REAL / "Ev-Containers.zip", split="test")
    in_torch = build_network(checkpoint.description)
    in_torch.load_weights(checkpoint.weights)
    with torch.no_grad():
        scores = in_torch.double().counts(torch.from_numpy(test.spikes.copy()).double())
    program = lower(load(model(name)), CHIP, WEIGHT_BITS).program
    prediction = np.asarray(hw.simulate(program, test.spikes).prediction)
    assert np.array_equal(prediction, scores.argmax(dim=1).numpy())
    assert float((prediction == test.labels).mean()) == checkpoint.training["test_accuracy"]
    assert test.labels is not None
    # Classes are four containers with five fill levels each: in wrong predictions, only the level is wrong.
    wrong = prediction != test.labels
    assert (prediction[wrong] // 5 == test.labels[wrong] // 5).all()


def test_the_best_network_of_objects_is_that_of_its_configurations() -> None:
    checkpoint = read_checkpoint(model("objects-best"))
    assert (checkpoint.description.name, checkpoint.description.architecture) == (
        "objects-best",
        "hybrid-window",
    )
    assert checkpoint.recordings is None
    assert checkpoint.chip is not None
    assert (checkpoint.chip.target, checkpoint.chip.strategy) == ("loihi-sim", "reset")
    assert {numbers.weight_bits for numbers in checkpoint.chip.populations.values()} == {8}
    assert checkpoint.training["seed"] == 0
    assert "hybrid_start_sha256" in checkpoint.training
    assert "test_accuracy" not in checkpoint.training  # its card says that no test part was read
    names = {"hybrid": "hybrid-reset", "windows": "window-snn", "windows_2": "window-snn-quarter"}
    for part, name in (names | {"windows_3": "window-snn-prototypes"}).items():
        options = options_of(f"objects-{name}") | {"validation_fraction": 0.0, "refit": False}
        stored = {
            key: value for key, value in options.items() if f"{part}_{key}" in checkpoint.training
        }
        assert len(stored) > 50
        assert {key: checkpoint.training[f"{part}_{key}"] for key in stored} == stored
        assert checkpoint.training[f"{part}_test_accuracy"] is None


def predictions_on_the_chip(recordings: Recordings) -> IntArray:
    """Return the predictions of the best network of Objects on the chip, whose spikes and scores must be torch's."""
    checkpoint = read_checkpoint(model("objects-best"))
    in_torch = build_network(checkpoint.description, chip=checkpoint.chip)
    in_torch.load_weights(checkpoint.float_weights)
    with torch.no_grad():
        activity = in_torch(torch.from_numpy(recordings.spikes.copy()).float())
    program = lower(load(model("objects-best")), CHIP, WEIGHT_BITS).program
    simulated = hw.simulate(program, recordings.spikes)
    spiking = [name for name in activity if name.startswith(("time", "location"))]
    assert len(spiking) == 4
    for name in spiking:
        assert np.array_equal(simulated.spikes[name], activity[name].numpy()), name
    # Scores differ by a constant factor.
    scores = in_torch.total(activity).double().numpy()
    chip_shares = simulated.scores / np.abs(simulated.scores).max()
    assert np.allclose(chip_shares, scores / np.abs(scores).max(), atol=1e-6)
    assert np.array_equal(simulated.prediction, scores.argmax(axis=1))
    return np.asarray(simulated.prediction)


def test_the_best_network_of_objects_spikes_on_the_chip_as_in_torch() -> None:
    predictions = predictions_on_the_chip(synthetic_touches(8, steps=250, seed=3))
    assert len(set(predictions.tolist())) > 1


@on_real_recordings
def test_the_best_network_of_objects_reaches_the_accuracy_of_its_card_on_the_chip() -> None:
    test = read_recordings(REAL / "Ev-Objects.zip", split="test")
    card = card_of(model("objects-best"))
    rows = rows_by_seed(card, r"^\| (\d) \| ([\d.]+) \| [\d.]+ \|$")
    assert sorted(rows) == SEEDS
    right = np.array([round(OBJECTS_TEST * float(accuracy)) for (accuracy,) in rows.values()])
    tests = right / OBJECTS_TEST
    assert (
        f"Test: mean {tests.mean():.3f}, sample standard deviation {tests.std(ddof=1):.3f}, over five seeds"
        in card
    )
    assert float((predictions_on_the_chip(test) == test.labels).mean()) == tests[0]


GRASPS = ROOT / "examples/recordings/grasps.npz"


def test_a_network_of_grasps_ships_with_its_recordings_and_their_licence() -> None:
    checkpoint = read_checkpoint(model("grasps-hybrid"))
    assert checkpoint.recordings is not None
    options = options_of("grasps-hybrid")
    class_none = 9  # the class of no object, by its number in place of its name
    assert trained_with(checkpoint, options) == options | {"tie": class_none}
    card = card_of(model("grasps-hybrid"))
    for words in ("Copyright 2012 Harold Soh", "H. Soh, Y. Su, Y. Demiris", "IROS 2012"):
        assert words in card
    assert "locsnn train --data examples/recordings/grasps.npz" in card


def test_the_network_of_grasps_reaches_its_test_accuracy() -> None:
    checkpoint = read_checkpoint(model("grasps-hybrid"))
    sensor = read_layout(ROOT / "examples/recordings/icub-hand.yaml")
    test = read_recordings(GRASPS, split="test", sensor=sensor, test_share=0.2, fold=1)
    compiled = lc.compile(checkpoint, strategy="delay-line", events=test, diagnosis=False)
    accuracy = compiled.report["accuracy"]
    assert accuracy["reference"] == checkpoint.training["test_accuracy"]
    card = card_of(model("grasps-hybrid"))
    row = f"| 1 | {accuracy['reference']:.3f} | {accuracy['chip']:.3f} |"
    assert row in card
