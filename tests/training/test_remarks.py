"""The remarks of a run: sentences, on lines that begin with ``!``, about data and about what was not learned.

Runs that learned from good data must have none. All classes *tie* in a recording if their scores are equal: the
recording then predicts no class.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from locsnn_compile.cli.main import main
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import SensorLayout, neutouch
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.models.graph_and_windows import GraphParameters
from locsnn_compile.models.networks import build_network
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.export import carried_rows
from locsnn_compile.training.measure import (
    Loss,
    chance_remarks,
    confusion,
    data_remarks,
    evaluate,
    result_remarks,
    tie_remarks,
)

Capture = pytest.CaptureFixture[str]
CHANNELS = 78  # of a fingertip: 39 taxels with two polarities


def save(path: Path, labels: list[int], *, silent: int = 0) -> str:
    """Write recordings of 30 steps of noise, with ten busy channels for each label; return the path.

    The first ``silent`` recordings have no event.
    """
    rng = np.random.default_rng(0)
    spikes = (rng.random((len(labels), CHANNELS, 30)) < 0.05).astype(np.uint8)
    for i, label in enumerate(labels):
        spikes[i, 10 * label : 10 * label + 10, 5:25] |= rng.random((10, 20)) < 0.5
    spikes[:silent] = 0
    np.savez(path, spikes=spikes, labels=labels)
    return str(path)


def train(tmp_path: Path, data: str, *options: str) -> int:
    """Run ``locsnn train`` and return its exit code, but 0 instead of 3.

    A run that learned nothing ends with 3. Most of these runs are too short to learn, and their remarks are tested.
    """
    code = main(["train", "--data", data, "-o", str(tmp_path / "o.pt"), *options])
    return 0 if code == 3 else code


def remarks(capsys: Capture) -> list[str]:
    """Return the remarks that were printed; the standard error must have nothing but a line for each epoch."""
    printed = capsys.readouterr()
    assert all(" epoch " in line and ", loss " in line for line in printed.err.splitlines())
    return [line for line in printed.out.splitlines() if line.startswith("! ")]


SILENT = "! No output neuron spikes in any of the 12 recordings it was trained on: every prediction is a tie. Give --learning-rate 0.1."
"""The advised rate is the largest: a run of one epoch has few updates of its weights."""
CHANCE = "! Accuracy 0.500 on the 12 recordings it was trained on is not clearly above chance, 0.500 for the commonest label."
FIXED = ("--defaults", "fixed")
"""Options that are left out have fixed values. By default, they are chosen from the data."""
QUICK = (*FIXED, "--model", "tactile-snn", "--hidden", "4", "--epochs", "1")
"""An epoch after which no output neuron spikes yet."""
STUCK = (*FIXED, "--hidden", "4", "--epochs", "1", "--learning-rate", "1e-9")
"""An epoch that hardly changes the random weights. The networks that it is for have scores without any spike."""


@pytest.mark.parametrize(
    ("labels", "silent", "options", "expected"),
    [
        pytest.param(
            [0, 1] * 6, 0, (*FIXED, "--model", "window-snn", "--epochs", "8"), [], id="learned"
        ),
        pytest.param([0, 1] * 6, 0, QUICK, [SILENT], id="silent outputs"),
        pytest.param(
            [0, 2, 5] * 4,
            0,
            QUICK,
            [
                "! No recording to train on has label 1, 3, 4: labels count from 0 to 5 here.",
                SILENT,
            ],
            id="gaps",
        ),
        pytest.param(
            [1, 2] * 6,
            0,
            QUICK,
            ["! No recording to train on has label 0: labels count from 0 to 2 here.", SILENT],
            id="labels from 1",
        ),
        pytest.param(
            [0, 1] * 6,
            3,
            QUICK,
            ["! 3 of 12 recordings to train on have no event.", SILENT],
            id="some are empty",
        ),
        pytest.param(
            [0] * 12,
            0,
            QUICK,
            # The outputs are silent as well, but with one class there is nothing that they could tell apart.
            ["! All recordings to train on have label 0: there is nothing to tell apart."],
            id="one class",
        ),
        pytest.param([0, 1] * 6, 0, ("--model", "gru-mlp", *STUCK), [CHANCE], id="GRU at chance"),
        pytest.param(
            [0, 1] * 6, 0, ("--model", "tactile-sgnet", *STUCK), [CHANCE], id="graph at chance"
        ),
    ],
)
def test_a_run_prints_these_remarks(
    tmp_path: Path,
    labels: list[int],
    silent: int,
    options: tuple[str, ...],
    expected: list[str],
    capsys: Capture,
) -> None:
    data = save(tmp_path / "a.npz", labels, silent=silent)
    assert train(tmp_path, data, *options) == 0
    assert remarks(capsys) == expected
    assert train(tmp_path, data, *options, "--quiet") == 0
    assert capsys.readouterr() == ("", "")


def test_an_accuracy_on_the_test_part_that_is_at_chance_is_remarked(
    tmp_path: Path, capsys: Capture
) -> None:
    rng = np.random.default_rng(1)
    for part, count in (("train", 8), ("test", 4)):
        (tmp_path / "set" / part).mkdir(parents=True)
        for i in range(count):
            # In the test part, the labels are swapped.
            first = 10 * (i % 2 if part == "train" else 1 - i % 2)
            spikes = np.zeros((CHANNELS, 30), dtype=np.uint8)
            spikes[first : first + 10] = rng.random((10, 30)) < 0.4
            np.save(tmp_path / "set" / part / f"sample_{i}_label_{i % 2}.npy", spikes)
    assert train(tmp_path, str(tmp_path / "set"), "--model", "window-snn", "--epochs", "8") == 0
    assert remarks(capsys) == [
        "! Accuracy 0.000 on the 4 recordings of the test part is not clearly above chance, 0.500 for the commonest label."
    ]


def test_recordings_without_any_event_are_refused(tmp_path: Path, capsys: Capture) -> None:
    data = save(tmp_path / "a.npz", [0, 1, 0, 1], silent=4)
    assert train(tmp_path, data) == 2
    assert capsys.readouterr() == (
        "",
        f"recordings '{tmp_path}/a.npz': none of them has an event (4 recordings). Give recordings with events.\n",
    )
    (tmp_path / "a_label_0.tact").write_text("1 1 0.0\n1 2 0.001\n1 1 0.1\n")
    assert train(tmp_path, str(tmp_path / "a_label_0.tact"), "--threshold", "1") == 2
    assert capsys.readouterr() == (
        "",
        f"recordings '{tmp_path}/a_label_0.tact': none of them has an event (3 of 3 events dropped: 0 outside the steps, 3 in bins "
        "of at most 1). Lower --threshold, or give more --steps.\n",
    )
    # Nothing was written.
    assert not list(tmp_path.glob("o.*"))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("tactile-snn", "No output neuron spikes"),
        ("hybrid-lif", "No output neuron spikes"),
        ("window-snn", "All class scores are equal"),
        ("gru-mlp", "All class scores are equal"),
    ],
)
def test_all_recordings_tie_in_networks_whose_weights_are_0(name: str, words: str) -> None:
    rng = np.random.default_rng(0)
    labels = np.arange(5) % 3
    spikes = (rng.random((5, 24, CHANNELS)) < 0.2).astype(np.uint8)
    recordings = Recordings(spikes, labels, step_seconds=None, source="a")
    # The networks with a branch that walks over locations need its order.
    location = {}
    if name in ("hybrid-lif", "window-snn"):
        location = {"location_order": "loop", "location_taxels": tuple(range(1, 40))}
    described = NetworkDescription(
        name,
        InputLayout(neutouch(1), steps=24, step_seconds=None),
        classes=3,
        hidden=4,
        **location,  # type: ignore[arg-type]
    )
    network = build_network(described, seed=0)
    for weight in network.parameters():
        weight.data.zero_()
    assert result_remarks(network, recordings) == [
        f"{words} in any of the 5 recordings it was trained on: every prediction is a tie. Give more --epochs, or a larger --learning-rate."
    ]
    # Two recordings are of class 0, which argmax returns for equal scores; ties must not count as right.
    _, accuracy = evaluate(network, Loss(TrainingConfig(), classes=3), recordings.spikes, labels)
    assert accuracy == 0.0
    counts = np.bincount(labels, minlength=3)
    confused = confusion(network, recordings)
    # A row for each label, a column for each class, and a last one for ties.
    all_tie = np.column_stack([np.zeros((3, 3)), counts])
    np.testing.assert_array_equal(confused, all_tie)
    assert tie_remarks(confused) == [
        "All classes tie in 5 of 5 test recordings: they predict no class (column 'tie') and count as wrong."
    ]
    # Now ties predict class 2.
    network.tie_class = 2
    _, accuracy = evaluate(network, Loss(TrainingConfig(), classes=3), recordings.spikes, labels)
    assert accuracy == counts[2] / 5
    confused = confusion(network, recordings)
    np.testing.assert_array_equal(confused[:, 2], counts)
    assert tie_remarks(confused) == []


@pytest.mark.parametrize(
    ("right", "is_remarked"),
    [
        pytest.param(5, True, id="half"),
        pytest.param(7, True, id="luck"),
        pytest.param(8, False, id="more than luck"),
    ],
)
def test_an_accuracy_that_guesses_could_reach_is_remarked(right: int, is_remarked: bool) -> None:
    # Of ten recordings of two classes, guesses have 5 right on average, with a standard deviation of sqrt(10) / 2 = 1.58.
    # One case in twenty is 1.645 deviations above: 7.6.
    assert bool(chance_remarks(right / 10, np.arange(10) % 2, "of these")) == is_remarked


@pytest.mark.parametrize(
    ("name", "layers"),
    [("location-tactile-snn", 2), ("location-tactile-snn-lif", 2), ("hybrid-graph", 4)],
)
@pytest.mark.parametrize("further_channels", [0, 1])
def test_a_walk_that_ends_before_outputs_can_spike_is_remarked(
    name: str, layers: int, further_channels: int
) -> None:
    """The network itself must agree: even with huge weights, a spike takes a location per layer."""
    channels = layers + further_channels
    layout = InputLayout(SensorLayout("few", channels), steps=24, step_seconds=None)
    options: dict[str, Any] = {
        "location_order": "loop",
        "location_taxels": tuple(range(1, channels + 1)),
    }
    if name == "hybrid-graph":
        options["graph"] = GraphParameters("tree", ((1, 2), (2, 3)))
    described = NetworkDescription(name, layout, classes=2, hidden=4, **options)
    network = build_network(described, seed=0)
    for weight in network.parameters():
        weight.data.fill_(1000.0)
    activity = network(torch.ones((1, 24, channels)))
    spikes = bool(network.scores(activity)["location"].any())
    assert spikes == (further_channels > 0)
    recordings = Recordings(np.ones((4, 24, channels)), np.arange(4) % 2, None, "a")
    remarks_on_data = data_remarks(recordings, 2, TrainingConfig(model=name, channels=channels))
    remark = (
        f"The location branch walks over {layers} channels and says nothing: its outputs spike {layers} channels "
        "after an event at the earliest. Give --model tactile-snn, or window-snn."
    )
    assert remarks_on_data == ([] if spikes else [remark])


def test_many_missing_labels_are_counted() -> None:
    labels = np.array([0, 40])
    recordings = Recordings(np.ones((2, 3, CHANNELS)), labels, step_seconds=None, source="a")
    # Without validation there is no remark that nothing was held back for it.
    config = TrainingConfig(validation_fraction=0.0)
    assert data_remarks(recordings, 41, config) == [
        "No recording to train on has label 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12 and 27 more: labels count from 0 to "
        "40 here."
    ]


@pytest.mark.parametrize(
    ("labels", "silent", "options", "expected"),
    [
        pytest.param([0, 1, 2] * 4, [], {}, [], id="good data"),
        pytest.param(
            [0, 1, 2] * 4,
            [1, 4, 7, 10],
            {},
            [
                "4 of 12 recordings to train on have no event.",
                "No recording of label 1 (slide) has an event: all classes tie, so it is never right. With --tie 1, ties "
                "predict it.",
            ],
            id="a silent class",
        ),
        pytest.param(
            [0, 1, 2] * 4,
            [1, 4, 7, 10],
            {"tie": "slide"},
            [
                "4 of 12 recordings to train on have no event.",
                "No recording of label 1 (slide) has an event.",
            ],
            id="a silent class that ties predict",
        ),
        pytest.param(
            [0, 1, 2] * 4,
            [1, 4, 7, 10],
            {
                "model": "hybrid-window"
            },  # the potentials of its windows have biases, so nothing ties
            [
                "4 of 12 recordings to train on have no event.",
                "No recording of label 1 (slide) has an event.",
            ],
            id="a silent class of a network that adds potentials",
        ),
        pytest.param(
            [0] * 10 + [1] * 5 + [2] * 2,
            [],
            {},
            [
                "Labels are uneven: label 0 (press) has 10 recordings, label 2 (twist) 2. With balanced class weights, all "
                "count equally."
            ],
            id="imbalance",
        ),
        pytest.param(
            [0] * 10 + [1] * 5 + [2] * 2, [], {"class_weights": "balanced"}, [], id="balanced"
        ),
        pytest.param([0] * 9 + [1] * 5 + [2] * 2, [], {}, [], id="less than five to one"),
        pytest.param(
            [0, 1, 2],
            [],
            {},
            [
                "Every label has one recording to train on: none was held back, and the last epoch was taken."
            ],
            id="one recording of each label",
        ),
        pytest.param([0, 1, 2], [], {"validation_fraction": 0.0}, [], id="no validation"),
        pytest.param(
            [1, 1],
            [],
            {},
            [
                "No recording to train on has label 0, 2: labels count from 0 to 2 here.",
                "All recordings to train on have label 1: there is nothing to tell apart.",
            ],
            id="one label",
        ),
    ],
)
def test_faults_of_recordings_are_remarked(
    labels: list[int], silent: list[int], options: dict, expected: list[str]
) -> None:
    """``silent`` are the numbers of the recordings without events."""
    spikes = np.ones((len(labels), 3, CHANNELS))
    spikes[silent] = 0
    recordings = Recordings(
        spikes,
        np.array(labels),
        step_seconds=None,
        source="a",
        class_names=("press", "slide", "twist"),
    )
    assert data_remarks(recordings, 3, TrainingConfig(**options)) == expected


@pytest.mark.parametrize(
    ("labels", "most", "rows"),
    [
        pytest.param(
            [0] * 90 + [1] * 6 + [2] * 4, 6, [0, 45, 90, 93, 96, 98], id="as many of a small class"
        ),
        pytest.param([0] * 8 + [1], 4, [0, 2, 5, 8], id="a class that has too few"),
        pytest.param([0, 1, 2, 3, 4, 5], 3, [0, 2, 4], id="fewer than classes"),
        pytest.param([1, 0, 1, 0], 9, [0, 1, 2, 3], id="all"),
        pytest.param([1, 0, 1, 0], 0, [], id="none"),
    ],
)
def test_carried_recordings_are_of_all_classes(
    labels: list[int], most: int, rows: list[int]
) -> None:
    """A checkpoint carries at most ``most`` recordings: as many of each class, evenly spread over its ``rows``."""
    assert carried_rows(np.array(labels), len(labels), most).tolist() == rows


def test_a_checkpoint_carries_recordings_of_rare_classes(tmp_path: Path) -> None:
    # Six recordings evenly spread over all would leave out the rare classes.
    data = save(tmp_path / "a.npz", [0] * 20 + [1] * 2 + [2] * 2)
    assert train(tmp_path, data, *QUICK, "--recordings", "6", "--quiet") == 0
    carried = read_checkpoint(tmp_path / "o.pt").recordings
    assert carried is not None
    assert carried.labels is not None
    assert carried.labels.tolist() == [0, 0, 1, 1, 2, 2]


@pytest.mark.parametrize("name", ["tactile-snn", "window-snn", "hybrid-graph", "gru-mlp"])
def test_recordings_of_different_lengths_get_the_longest_or_the_option(
    tmp_path: Path, name: str
) -> None:
    rng = np.random.default_rng(0)
    # The longest is in the test part, which counts as well.
    for part, lengths in (("train", (20, 26, 23, 20)), ("test", (18, 30))):
        (tmp_path / "set" / part).mkdir(parents=True)
        for i, steps in enumerate(lengths):
            spikes = (rng.random((39, 2, steps)) < 0.2).astype(np.uint8)
            np.save(tmp_path / "set" / part / f"sample_{i}_label_{i % 2}.npy", spikes)
    # Small networks, which train faster; that of windows alone has no hidden neurons.
    hidden = () if name == "window-snn" else ("--hidden", "4")
    sizes = ("--model", name, *hidden, "--epochs", "1", "--quiet")
    if name == "hybrid-graph":
        # Features per node of its two graphs, of taxels and of time steps: few, for speed.
        (tmp_path / "c.yaml").write_text("features: 2\nstep_features: 2\n")
        sizes = (*sizes, "--config", str(tmp_path / "c.yaml"))
    assert train(tmp_path, str(tmp_path / "set"), *sizes) == 0
    assert read_checkpoint(tmp_path / "o.pt").description.input.steps == 30
    assert train(tmp_path, str(tmp_path / "set"), *sizes, "--steps", "22") == 0
    assert read_checkpoint(tmp_path / "o.pt").description.input.steps == 22


def test_a_transposed_file_is_refused(tmp_path: Path, capsys: Capture) -> None:
    np.savez(tmp_path / "a.npz", spikes=np.ones((4, 30, CHANNELS)), labels=[0, 1, 0, 1])
    assert train(tmp_path, str(tmp_path / "a.npz")) == 2
    assert capsys.readouterr() == (
        "",
        f"file '{tmp_path}/a.npz': its axes look like (samples, steps, channels) (4 x 30 x 78 values). "
        "Give --axes samples,steps,channels, or transpose it to (samples, channels, steps), as files have it.\n",
    )
