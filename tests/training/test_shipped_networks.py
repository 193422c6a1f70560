"""The shipped networks reach the accuracy they claim, on the real recordings where these are at hand."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import torch

import hw_model as hw
import locsnn_compile as lc
from hw_model.values import IntArray
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import read_layout
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


def model(name: str) -> Path:
    return ROOT / f"examples/models/{name}.pt"


def mismatches(found: Checkpoint, network: Network, recordings: Recordings) -> tuple[int, int]:
    """Return the spikes that only one of the torch network and the compiled program has, and all of the first."""
    assert found.chip is not None
    own = build_network(found.description, chip=found.chip)
    own.load_weights(found.float_weights)
    with torch.no_grad():
        wanted = own(torch.from_numpy(recordings.spikes.copy()).float())
    played = hw.simulate(lower(network, CHIP, 8).program, recordings.spikes)
    differing = sum(
        int((played.spikes[name] != spikes.numpy()).sum()) for name, spikes in wanted.items()
    )
    return differing, sum(int(spikes.sum()) for spikes in wanted.values())


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
    defaults = vars(TrainingConfig(defaults="fixed"))
    given = {key: value for key, value in vars(config).items() if key != "seed"}
    assert {key: training.get(key, defaults[key]) for key in given} == given


@pytest.mark.parametrize("name", NAMES)
def test_model_cards_agree_with_their_networks(name: str) -> None:
    training = read_checkpoint(ROOT / f"examples/models/{name}-hybrid.pt").training
    card = (ROOT / f"examples/models/{name}-hybrid.md").read_text(encoding="utf-8")
    rows = {
        int(row[0]): row[1:]
        for row in re.findall(r"^\| (\d) \| (\d+) \| ([\d.]+) \| ([\d.]+) \|$", card, re.M)
    }
    assert sorted(rows) == [0, 1, 2, 3, 4]
    figures = [(float(validation), float(test)) for _, validation, test in rows.values()]
    best = min(range(5), key=lambda seed: (-figures[seed][0], seed))
    assert training["seed"] == best
    epoch, validation, test = rows[best]
    assert int(epoch) == training["chosen_epoch"]
    assert f"{training['validation_accuracy']:.3f}" == validation
    assert f"{training['test_accuracy']:.3f}" == test
    recordings = training["test_recordings"]
    tests = (
        np.array([round(test * recordings) for _, test in figures]) / recordings
    )  # not rounded to three digits
    assert f"mean {tests.mean():.3f}, sample standard deviation {tests.std(ddof=1):.3f}" in card


@on_real_recordings
@pytest.mark.parametrize("name", NAMES)
def test_shipped_networks_reach_their_test_accuracy(name: str) -> None:
    found = read_checkpoint(ROOT / f"examples/models/{name}-hybrid.pt")
    recordings = read_recordings(REAL / f"Ev-{name.title()}.zip", split="test")
    network = build_network(found.description)
    network.load_weights(found.weights)
    with torch.no_grad():
        counts = network.double().counts(torch.from_numpy(recordings.spikes.copy()).double())
    assert recordings.labels is not None
    assert (
        float((counts.argmax(dim=1).numpy() == recordings.labels).mean())
        == found.training["test_accuracy"]
    )


@pytest.mark.parametrize("name", NAMES)
def test_shipped_networks_survive_a_round_trip(tmp_path: Path, name: str) -> None:
    path = ROOT / f"examples/models/{name}-hybrid.pt"
    found = read_checkpoint(path)
    Checkpoint(found.description, found.weights, training=found.training).save(
        tmp_path / "again.pt"
    )
    again = read_checkpoint(tmp_path / "again.pt")
    assert again.description == found.description
    assert all(np.array_equal(again.weights[key], found.weights[key]) for key in found.weights)


TWO = ROOT / "examples/recordings/two-fingertips.npz"


def test_a_network_of_two_fingertips_ships_with_its_recordings() -> None:
    found, test = read_checkpoint(model("two-fingertips")), read_recordings(TWO, test_share=0.2)
    assert (found.description.input.channels, found.description.location_delays) == (156, (0, 4))
    assert found.recordings is not None
    assert np.array_equal(found.recordings.spikes, test.spikes)
    given = vars(
        config_from_mapping(read_config(ROOT / "examples/configs/two-fingertips-hybrid.yaml"))
    )
    # Options that came later have no entry in the file: they are as they were, at their defaults.
    defaults = vars(TrainingConfig(defaults="fixed"))
    assert {key: found.training.get(key, defaults[key]) for key in given} == given
    card = model("two-fingertips").with_suffix(".md").read_text(encoding="utf-8")
    assert "**Everything here is synthetic.**" in card
    for part in ("validation", "test"):
        accuracy = found.training[f"{part}_accuracy"]
        assert re.search(rf"^\| {part} \| \d \| {accuracy:.3f} \|$", card, re.M)
    command = "locsnn train --data examples/recordings/two-fingertips.npz --config examples/configs/two-fingertips-hybrid.yaml"
    assert command in card
    assert command in (ROOT / "docs/how-to/train-a-network.md").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("strategy", TRAINABLE)
def test_both_engines_play_two_fingertips_alike(strategy: str) -> None:
    network, test = load(model("two-fingertips")), read_recordings(TWO, test_share=0.2)
    program = lower(network, CHIP, 8, strategy).program
    slow, fast = (
        hw.simulate(program, test.spikes, engine=engine) for engine in ("reference", "fast")
    )
    for name, spikes in slow.spikes.items():
        assert np.array_equal(fast.spikes[name], spikes), name
    assert np.array_equal(slow.prediction, test.labels)


@pytest.mark.parametrize("name", NAMES)
def test_networks_on_the_chips_integers_are_whole(name: str) -> None:
    found = read_checkpoint(model(f"{name}-hybrid-loihi"))
    assert found.description.name == f"{name}-hybrid-loihi"
    assert found.recordings is None
    assert found.chip is not None
    assert (found.chip.target, found.chip.strategy) == ("loihi-sim", "dendrite")
    assert {numbers.weight_bits for numbers in found.chip.populations.values()} == {8}
    assert found.training["start_sha256"] == read_checkpoint(model(f"{name}-hybrid")).sha256
    config = vars(
        config_from_mapping(read_config(ROOT / f"examples/configs/{name}-hybrid-loihi.yaml"))
    )
    # Options that came later are not in the file.
    kept = {key: value for key, value in config.items() if key in found.training}
    assert {key: found.training[key] for key in kept} == kept


@pytest.mark.parametrize("name", NAMES)
def test_cards_of_networks_on_the_chips_integers(name: str) -> None:
    training = read_checkpoint(model(f"{name}-hybrid-loihi")).training
    card = model(f"{name}-hybrid-loihi").with_suffix(".md").read_text(encoding="utf-8")
    rows = {
        int(row[0]): row[1:]
        for row in re.findall(r"^\| (\d) \| ([\d.]+) \| ([\d.]+) \|$", card, re.M)
    }
    assert sorted(rows) == [0, 1, 2, 3, 4]
    assert f"{training['test_accuracy']:.3f}" == rows[int(training["seed"] or 0)][1]
    tests = np.array([float(test) for _, test in rows.values()])
    stated = re.search(
        r"Test: mean ([\d.]+), sample standard deviation ([\d.]+), over five seeds", card
    )
    assert stated is not None
    # Of the figures before they were rounded for the table.
    assert [float(figure) for figure in stated.groups()] == pytest.approx(
        [tests.mean(), tests.std(ddof=1)], abs=1e-3
    )


@pytest.mark.parametrize("name", NAMES)
def test_programs_of_shipped_networks_spike_as_trained(name: str) -> None:
    found, network = (
        read_checkpoint(model(f"{name}-hybrid-loihi")),
        load(model(f"{name}-hybrid-loihi")),
    )
    touches = synthetic_touches(12, steps=found.description.input.steps, seed=3)
    differing, spikes = mismatches(found, network, touches)
    assert differing == 0
    assert spikes > 10_000


@on_real_recordings
@pytest.mark.parametrize("name", NAMES)
def test_shipped_networks_on_the_chip_reach_their_test_accuracy(name: str) -> None:
    found, network = (
        read_checkpoint(model(f"{name}-hybrid-loihi")),
        load(model(f"{name}-hybrid-loihi")),
    )
    test = read_recordings(REAL / f"Ev-{name.title()}.zip", split="test")
    assert mismatches(found, network, test)[0] == 0
    prediction = hw.simulate(lower(network, CHIP, 8).program, test.spikes).prediction
    assert float((prediction == test.labels).mean()) == found.training["test_accuracy"]


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
    own = build_network(start.description, chip=chip)
    own.load_weights(start.weights)
    Checkpoint(start.description, own.mantissas(), chip=chip).save(tmp_path / "on-chip.pt")
    found, network = read_checkpoint(tmp_path / "on-chip.pt"), load(tmp_path / "on-chip.pt")
    for split in ("test", "train"):
        recordings = read_recordings(REAL / f"Ev-{name.title()}.zip", split=split)
        assert mismatches(found, network, recordings)[0] == 0


WINDOWS = {"containers-best": "levels", "containers-window-16": "16-steps"}
"""The networks of windows that ship, and how their configurations end."""


@pytest.mark.parametrize("name", WINDOWS)
def test_networks_of_windows_are_those_of_their_configurations(name: str) -> None:
    found = read_checkpoint(model(name))
    assert (found.description.name, found.description.architecture) == (name, "window-snn")
    assert found.recordings is None
    config = vars(
        config_from_mapping(
            read_config(ROOT / f"examples/configs/containers-window-snn-{WINDOWS[name]}.yaml")
        )
    )
    assert config["seed"] == found.training["seed"] == 0  # fixed beforehand, not picked
    assert {key: found.training[key] for key in config if key in found.training} == {
        key: value for key, value in config.items() if key in found.training
    }


@pytest.mark.parametrize(("name", "wrong"), [("containers-best", 37), ("containers-window-16", 38)])
def test_cards_of_networks_of_windows(name: str, wrong: int) -> None:
    training = read_checkpoint(model(name)).training
    card = model(name).with_suffix(".md").read_text(encoding="utf-8")
    rows = {
        int(row[0]): row[1:]
        for row in re.findall(r"^\| (\d) \| ([\d.]+) \| ([\d.]+) \|$", card, re.M)
    }
    assert sorted(rows) == [0, 1, 2, 3, 4]
    assert rows[0][0] == f"{training['test_accuracy']:.3f}"
    right = np.array([round(60 * float(test)) for test, _ in rows.values()])
    assert int(5 * 60 - right.sum()) == wrong
    tests = right / 60
    assert (
        f"Test: mean {tests.mean():.3f}, sample standard deviation {tests.std(ddof=1):.3f}, over five seeds"
        in card
    )


@on_real_recordings
@pytest.mark.parametrize("name", WINDOWS)
def test_networks_of_windows_on_the_chip(name: str) -> None:
    found, network = read_checkpoint(model(name)), load(model(name))
    test = read_recordings(REAL / "Ev-Containers.zip", split="test")
    own = build_network(found.description)
    own.load_weights(found.weights)
    with torch.no_grad():
        in_torch = (
            own.double().counts(torch.from_numpy(test.spikes.copy()).double()).argmax(dim=1).numpy()
        )
    prediction = np.asarray(hw.simulate(lower(network, CHIP, 8).program, test.spikes).prediction)
    assert np.array_equal(prediction, in_torch)
    assert float((prediction == test.labels).mean()) == found.training["test_accuracy"]
    assert test.labels is not None
    wrong = prediction != test.labels
    assert (
        prediction[wrong] // 5 == test.labels[wrong] // 5
    ).all()  # the container is right, its fill level is not


def test_the_best_network_of_objects_is_of_its_configurations() -> None:
    found = read_checkpoint(model("objects-best"))
    assert (found.description.name, found.description.architecture) == (
        "objects-best",
        "hybrid-window",
    )
    assert found.recordings is None
    assert found.chip is not None
    assert (found.chip.target, found.chip.strategy) == ("loihi-sim", "reset")
    assert {numbers.weight_bits for numbers in found.chip.populations.values()} == {8}
    assert found.training["seed"] == 0
    assert "hybrid_start_sha256" in found.training
    assert "test_accuracy" not in found.training  # its card says that no test part was read
    names = {"hybrid": "hybrid-reset", "windows": "window-snn", "windows_2": "window-snn-quarter"}
    for part, name in (names | {"windows_3": "window-snn-prototypes"}).items():
        config = vars(
            config_from_mapping(read_config(ROOT / f"examples/configs/objects-{name}.yaml"))
        )
        config = config | {"validation_fraction": 0.0, "refit": False}
        kept = {key: value for key, value in config.items() if f"{part}_{key}" in found.training}
        assert len(kept) > 50
        assert {key: found.training[f"{part}_{key}"] for key in kept} == kept
        assert found.training[f"{part}_test_accuracy"] is None


def played_alike(recordings: Recordings) -> IntArray:
    """Return what the best network of Objects predicts on the chip: in torch every spike and every score is the same."""
    found, network = read_checkpoint(model("objects-best")), load(model("objects-best"))
    own = build_network(found.description, chip=found.chip)
    own.load_weights(found.float_weights)
    with torch.no_grad():
        activity = own(torch.from_numpy(recordings.spikes.copy()).float())
    played = hw.simulate(lower(network, CHIP, 8).program, recordings.spikes)
    spiking = [name for name in activity if name.startswith(("time", "location"))]
    assert len(spiking) == 4
    for name in spiking:
        assert np.array_equal(played.spikes[name], activity[name].numpy()), name
    scores = own.total(activity).double().numpy()
    assert np.allclose(
        played.scores / np.abs(played.scores).max(), scores / np.abs(scores).max(), atol=1e-6
    )
    assert np.array_equal(played.prediction, scores.argmax(axis=1))
    return np.asarray(played.prediction)


def test_the_best_network_of_objects_plays_on_the_chip_as_in_torch() -> None:
    assert len(set(played_alike(synthetic_touches(8, steps=250, seed=3)).tolist())) > 1


@on_real_recordings
def test_the_best_network_of_objects_on_the_chip() -> None:
    test = read_recordings(REAL / "Ev-Objects.zip", split="test")
    card = model("objects-best").with_suffix(".md").read_text(encoding="utf-8")
    rows = {
        int(row[0]): float(row[1])
        for row in re.findall(r"^\| (\d) \| ([\d.]+) \| [\d.]+ \|$", card, re.M)
    }
    assert sorted(rows) == [0, 1, 2, 3, 4]
    tests = np.array([round(144 * accuracy) for accuracy in rows.values()]) / 144
    assert (
        f"Test: mean {tests.mean():.3f}, sample standard deviation {tests.std(ddof=1):.3f}, over five seeds"
        in card
    )
    assert float((played_alike(test) == test.labels).mean()) == tests[0]


GRASPS = ROOT / "examples/recordings/grasps.npz"
GRASPS_CONFIG = ROOT / "examples/configs/grasps-hybrid.yaml"


def test_a_network_of_grasps_ships_with_its_recordings_and_their_licence() -> None:
    found = read_checkpoint(model("grasps-hybrid"))
    assert found.recordings is not None
    given = vars(config_from_mapping(read_config(GRASPS_CONFIG)))
    # Options that came later have no entry in the file: they are as they were, at their defaults.
    defaults = vars(TrainingConfig(defaults="fixed"))
    none = 9
    trained_with = {key: found.training.get(key, defaults[key]) for key in given}
    assert trained_with == given | {"tie": none}
    card = model("grasps-hybrid").with_suffix(".md").read_text(encoding="utf-8")
    for words in ("Copyright 2012 Harold Soh", "H. Soh, Y. Su, Y. Demiris", "IROS 2012"):
        assert words in card
    assert "locsnn train --data examples/recordings/grasps.npz" in card


def test_the_network_of_grasps_reaches_its_test_accuracy() -> None:
    found = read_checkpoint(model("grasps-hybrid"))
    sensor = read_layout(ROOT / "examples/recordings/icub-hand.yaml")
    test = read_recordings(GRASPS, split="test", sensor=sensor, test_share=0.2, fold=1)
    compiled = lc.compile(found, strategy="delay-line", events=test, diagnosis=False)
    accuracy = compiled.report["accuracy"]
    assert accuracy["reference"] == found.training["test_accuracy"]
    card = model("grasps-hybrid").with_suffix(".md").read_text(encoding="utf-8")
    row = f"| 1 | {accuracy['reference']:.3f} | {accuracy['chip']:.3f} |"
    assert row in card
