"""Options that the user does not give are chosen from the training recordings, and given ones never change.

Shipped configurations fix all defaults, so that they train the networks that ship. The scores by which windows are
chosen are compared with linear discriminant analysis, with the whole matrix inverted.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.cli.main import main
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.graph_and_windows import AXONS_OF_CORE, MAX_WINDOW_NEURONS
from locsnn_compile.training.chosen import choose
from locsnn_compile.training.config import config_from_mapping, read_config
from locsnn_compile.training.learning_signs import epoch_to_look_at, reach_of
from locsnn_compile.training.rates import rate_for_updates
from locsnn_compile.training.window_choice import (
    SMOOTHINGS,
    balanced_rows,
    candidate_windows,
    prototype_scores,
)

CONFIGS = Path(__file__).parents[2] / "examples/configs"


def groups(samples: int = 36, *, channels: int = 40, steps: int = 60, seed: int = 0) -> Recordings:
    """Return recordings of three classes, each with more events in a third of the channels."""
    rng = np.random.default_rng(seed)
    labels = np.arange(samples) % 3
    rates = np.full((samples, steps, channels), 0.01)
    third = channels // 3
    for sample, label in enumerate(labels):
        rates[sample, :, label * third : (label + 1) * third] = 0.08
    spikes = (rng.random(rates.shape) < rates).astype(np.uint8)
    return Recordings(spikes, labels, step_seconds=None, source="a")


def save(path: Path, recordings: Recordings) -> str:
    """Write recordings as a .npz file, and return its name."""
    spikes = recordings.spikes.transpose(0, 2, 1)
    np.savez(path, spikes=spikes, labels=recordings.labels)
    return str(path)


def test_the_network_and_its_windows_are_chosen() -> None:
    config = choose({"channels": 40}, groups()).config
    assert (config.model, config.optimizer, config.epochs) == ("window-snn", "prototypes", 1)
    assert (config.event_dropout, config.channel_dropout) == (0.0, 0.0)
    assert config.window_steps > 6  # of 60 steps with few events
    assert config.weight_decay in SMOOTHINGS


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "expected"),
    [
        pytest.param({"model": "hybrid"}, {"model": "hybrid", "theta": 10.0}, id="network"),
        pytest.param({"hidden": 8}, {"model": "hybrid-window", "hidden": 8}, id="hidden neurons"),
        pytest.param({"window_steps": 4}, {"window_steps": 4, "window_stride": 3}, id="windows"),
        pytest.param({"optimizer": "sgd"}, {"optimizer": "sgd"}, id="optimizer"),
        pytest.param({"event_dropout": 0.2}, {"optimizer": "sgd", "event_dropout": 0.2}, id="dropout"),
        pytest.param({"epochs": 7}, {"optimizer": "prototypes", "epochs": 7}, id="epochs"),
        pytest.param(
            {"model": "hybrid", "learning_rate": 0.5}, {"learning_rate": 0.5}, id="learning rate"
        ),
        pytest.param({"weight_decay": 0.7}, {"weight_decay": 0.7}, id="smoothing"),
    ],
)  # fmt: skip
def test_given_options_are_not_changed(values: dict[str, Any], expected: dict[str, Any]) -> None:
    config = choose({"channels": 40, **values}, groups()).config
    assert {name: getattr(config, name) for name in expected} == expected


@pytest.mark.parametrize(
    ("steps", "count_scale", "line"),
    [
        pytest.param(
            25,
            0.4,
            "  count_scale 0.4: an output spikes at most once in each of 25 steps",
            id="short",
        ),
        pytest.param(
            320,
            0.031,
            "  count_scale 0.031: an output spikes at most once in each of 320 steps",
            id="long",
        ),
    ],
)
def test_scores_of_a_xylo_reach_as_far_in_short_recordings_as_in_long_ones(
    steps: int, count_scale: float, line: str
) -> None:
    chosen = choose({"target": "xylo-imu", "channels": 12}, groups(channels=12, steps=steps))
    assert chosen.config.count_scale == count_scale
    assert line in chosen.lines


def test_a_network_for_a_xylo_has_slow_and_fast_neurons_whose_spikes_cost() -> None:
    config = config_from_mapping({"target": "xylo-imu", "channels": 12})
    assert (config.dash_syn, config.dash_mem) == ("2", "3 5")
    assert (config.spike_cost, config.learning_rate) == (0.001, 0.004)


def test_with_fixed_defaults_nothing_is_chosen() -> None:
    values = {"channels": 40, "defaults": "fixed"}
    chosen = choose(values, groups())
    assert (chosen.config, chosen.lines) == (config_from_mapping(values), ())


@pytest.mark.parametrize(
    ("epochs", "rate"),
    [
        pytest.param(250, 0.032, id="750 updates"),
        pytest.param(40, 0.1, id="120 updates, no more than the largest rate"),
        pytest.param(4000, 0.003, id="12,000 updates, no less than the usual rate"),
    ],
)
def test_the_learning_rate_falls_with_the_number_of_updates(epochs: int, rate: float) -> None:
    # Of 48 recordings, 42 are learned from and the others validate: three batches of 16 per epoch.
    values = {"channels": 40, "model": "hybrid", "epochs": epochs}
    assert choose(values, groups(48)).config.learning_rate == rate


def test_uneven_classes_get_weights_by_which_they_count_alike() -> None:
    labels = np.repeat([0, 1, 2], [20, 10, 5])
    spikes = np.ones((35, 60, 40), dtype=np.uint8)
    values = {"channels": 40, "model": "hybrid"}
    chosen = choose(values, Recordings(spikes, labels, step_seconds=None, source="a"))
    assert chosen.config.class_weights == "balanced"
    assert "  class_weights balanced: classes have 5 to 20 recordings" in chosen.lines


def test_short_recordings_get_a_low_threshold_and_a_grid_gets_a_walk_of_neighbours() -> None:
    values = {"grid": "8x5", "polarities": 1, "model": "hybrid"}
    config = choose(values, groups(steps=24)).config
    assert (config.theta, config.order) == (2.0, "hilbert")


@pytest.mark.parametrize(
    ("channels", "steps"),
    [(2, 200), (16, 20), (8, 3000), (4096, 40), (64, 1)],
    ids=["2 channels", "20 steps", "3,000 steps", "4,096 channels", "one step"],
)
def test_windows_fit_any_recording(channels: int, steps: int) -> None:
    spikes = np.zeros((6, steps, channels), dtype=np.uint8)
    spikes[::2, :, : channels // 2] = 1
    polarities = 2
    candidates = candidate_windows(spikes, polarities)
    assert candidates
    for windows in candidates:
        assert windows.of_channel(steps) * channels <= MAX_WINDOW_NEURONS
        assert windows.of_channel(steps) * polarities <= AXONS_OF_CORE


def test_with_a_class_without_recordings_weights_are_learned_by_descent() -> None:
    recordings = groups()
    labels = np.where(recordings.labels == 1, 3, recordings.labels)
    without_class_1 = Recordings(recordings.spikes, labels, step_seconds=None, source="a")
    config = choose({"channels": 40}, without_class_1).config
    assert (config.model, config.optimizer) == ("window-snn", "sgd")


def test_one_recording_of_each_class_is_learned_from() -> None:
    checkpoint = lc.train(groups(3), {"channels": 40}, test=groups(9, seed=5))
    assert checkpoint.training["test_accuracy"] == 1.0


def test_of_a_large_set_recordings_are_drawn_evenly_from_the_classes() -> None:
    labels = np.repeat([0, 1], [900, 50])
    rows = balanced_rows(labels, most=100, seed=1)
    assert np.bincount(labels[rows]).tolist() == [50, 50]


def test_scores_of_cross_validation_are_those_of_discriminant_analysis() -> None:
    rng = np.random.default_rng(2)
    hidden = rng.random((14, 6))
    classes = np.arange(14) % 2
    training, held_out = np.arange(10), np.arange(10, 14)
    scores = prototype_scores(hidden @ hidden.T, classes, training, held_out)
    training_hidden = hidden[training]
    training_classes = classes[training]
    means = np.stack([training_hidden[training_classes == label].mean(axis=0) for label in (0, 1)])
    apart = training_hidden - means[training_classes]
    for smoothing, score in zip(SMOOTHINGS, scores, strict=True):
        ridge = smoothing * (apart**2).sum() / len(training)
        s = ridge * np.linalg.inv(apart.T @ apart + ridge * np.eye(hidden.shape[1]))
        of_prototypes = np.einsum("kh,hg,kg->k", means, s, means)
        expected = hidden[held_out] @ s @ means.T - 0.5 * of_prototypes
        assert np.allclose(score, expected)


def test_the_command_prints_what_it_chose_and_stores_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = save(tmp_path / "a.npz", groups())
    output = tmp_path / "o.pt"
    assert main(["train", "--data", data, "--channels", "40", "-o", str(output)]) == 0
    lines = capsys.readouterr().out.splitlines()
    facts = "36 recordings, 40 channels, 60 steps, 3 classes, 0.032 events per channel and step"
    assert lines[0] == f"chosen from the train part ({facts}):"
    assert lines[1] == "  model window-snn: its neurons count events in windows of time"
    entry = read_checkpoint(output).training
    assert str(entry["chosen"]).startswith(lines[1].strip())
    assert (entry["model"], entry["optimizer"]) == ("window-snn", "prototypes")
    assert entry["accuracy_of_counts"] == 1.0


def test_a_run_that_does_not_learn_warns_early_and_exits_with_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = save(tmp_path / "a.npz", groups())
    options = ["--defaults", "fixed", "--model", "hybrid", "--channels", "40", "--epochs", "6"]
    assert main(["train", "--data", data, *options, "-o", str(tmp_path / "o.pt")]) == 3
    assert (tmp_path / "o.pt").exists()
    printed = capsys.readouterr()
    early = [line for line in printed.err.splitlines() if line.startswith("! ")]
    assert len(early) == 1
    assert early[0].startswith(
        "! After 3 of 6 epochs: no output neuron spikes in any of the 30 recordings it was "
        "trained on; hidden neurons are silent in "
    )
    assert early[0].endswith(
        "of the recordings; each weight could move by 0.021 in 12 steps (the threshold of a neuron "
        "is 10). Give --learning-rate 0.1."
    )
    assert "every prediction is a tie. Give --learning-rate 0.1." in printed.out


def test_reach_is_the_sum_of_the_learning_rates() -> None:
    # A cosine of six epochs adds up to 3.5 of its largest rate; there are two updates an epoch.
    config = config_from_mapping({"model": "hybrid", "epochs": 6})
    reach = reach_of(config, recordings=30, epochs=6)
    assert reach.updates == 12
    assert reach.distance == pytest.approx(2 * 3.5 * 0.003)
    assert [epoch_to_look_at(epochs) for epochs in (4, 40, 250)] == [3, 4, 10]
    assert [rate_for_updates(updates) for updates in (1, 240, 8_000)] == [0.1, 0.1, 0.003]


# The defaults with which the networks that ship were trained.
FIXED = {
    "model": "hybrid",
    "order": "loop",
    "optimizer": "adamw",
    "learning_rate": 0.003,
    "weight_decay": 0.1,
    "epochs": 250,
    "batch_size": 16,
    "event_dropout": 0.5,
    "channel_dropout": 0.3,
    "class_weights": "equal",
    "theta": 10.0,
    "window_steps": 6,
    "window_stride": 3,
    "window_levels": "1 2",
    "initial_scale": 3.0,
    "count_scale": 0.1,
}
FIXED_OF_WINDOWS = {
    "model": "window-snn",
    "optimizer": "sgd",
    "learning_rate": 0.005,
    "weight_decay": 0.0001,
    "count_scale": 1.0,
}


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_a_shipped_configuration_has_the_defaults_of_the_network_that_ships(path: Path) -> None:
    values = read_config(path)
    assert values["defaults"] == "fixed"
    config = config_from_mapping(values)
    assert choose(values, groups()).config == config
    of_model = FIXED_OF_WINDOWS if config.model == "window-snn" else {}
    left_out = {name: value for name, value in (FIXED | of_model).items() if name not in values}
    if config.model in ("gru-mlp", "cnn-3d"):
        left_out.pop("count_scale", None)
    assert {name: getattr(config, name) for name in left_out} == left_out
