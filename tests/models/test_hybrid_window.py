"""``hybrid-window``, the network with a time, a location and a window branch.

Torch, the float reference and both engines of the simulator must add the scores of the three branches to the same sums.
Files, sessions on streams, early stops and training must treat all three.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.cli.main import main
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.data.write import write_recordings
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.models.graph_and_windows import WindowParameters
from locsnn_compile.models.networks import TouchNetwork, build_network
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.training.config import config_from_mapping
from locsnn_compile.training.measure import weighted_counts
from locsnn_compile.training.train import train
from locsnn_compile.verification.observation import Observed
from locsnn_compile.verification.over_time import OverTime, over_time

ORDER = tuple(range(39, 0, -1))  # the taxels backwards
CHANNELS = 78  # 39 taxels with two polarities


def described(steps: int = 40, hidden: int = 6) -> NetworkDescription:
    """A network of time, location and window neurons; windows have 4 steps, every 2 steps."""
    layout = InputLayout(neutouch(1), steps, step_seconds=0.02)
    windows = WindowParameters(steps=4, stride=2, levels=(1, 3))
    return NetworkDescription(
        "hybrid-window",
        layout,
        classes=3,
        hidden=hidden,
        neuron=None,
        location_order="own",
        location_taxels=ORDER,
        window=windows,
    )


def touches(samples: int, steps: int = 40, share: float = 0.2) -> np.ndarray:
    """Random recordings of a fingertip with a share of events."""
    return (np.random.default_rng(samples).random((samples, steps, CHANNELS)) < share).astype(
        np.uint8
    )


def random_network(description: NetworkDescription) -> TouchNetwork:
    """An untrained network whose windows have random weights too."""
    network = build_network(description, seed=1, initial_scale=6.0)
    assert isinstance(network, TouchNetwork)
    rng = np.random.default_rng(0)
    shapes = {name: description.weight_shapes[name] for name in description.window_names}
    network.windows.load_weights(
        {name: rng.normal(size=shape).astype(np.float32) for name, shape in shapes.items()}
    )
    return network


def test_torch_the_reference_and_both_engines_add_the_branches_alike(tmp_path: Path) -> None:
    description = described()
    network, x = random_network(description), touches(5)
    Checkpoint(description, network.weights()).save(tmp_path / "h.pt")
    loaded = lc.load(tmp_path / "h.pt")
    assert [phase.name for phase in loaded.phases] == ["time", "location", "window"]
    outputs = loaded.readout.populations
    assert outputs[:3] == ("time_output", "location_output", "window_output_1")
    assert loaded.readout.potentials_from == (None, None, *(2,) * (len(outputs) - 2))
    with torch.no_grad():
        branches = network.double().scores(network(torch.from_numpy(x).double()))
    assert list(branches) == ["time", "location", "window"]
    assert all(float(scores.abs().sum()) > 0 for scores in branches.values())
    total = sum(scores.numpy() for scores in branches.values())
    assert np.allclose(evaluate(loaded, x).scores, total, atol=1e-4)
    compiled = lc.compile(
        loaded,
        strategy="dendrite",
        events=Recordings(x, labels=None, step_seconds=0.02, source="touches"),
    )
    fast = hw.simulate(compiled.program, x)
    reference = hw.simulate(compiled.program, x, engine="reference")
    on_grid = evaluate(compiled.levels.quantized.on_grid(), x)
    assert np.array_equal(fast.scores, reference.scores)
    assert np.array_equal(fast.scores, on_grid.scores)
    weights = dict(zip(outputs, compiled.program.readout.weights, strict=True))  # type: ignore[union-attr]
    assert all(weight.is_integer() for weight in weights.values())
    # The chip adds in units of the registers of windows; the weight of a spike converts them. Quantised weights make
    # a small difference.
    chip_total = np.asarray(fast.scores) / weights["time_output"]
    assert np.abs(chip_total - total).max() < 0.1 * np.abs(total).max()


def test_sessions_and_early_stops_agree_with_whole_simulations() -> None:
    description = described()
    checkpoint = Checkpoint(description, random_network(description).weights(), None, {}, "")
    x = touches(4)
    x[:, 12:] = 0  # touches that end early, so that a stop before the end is possible
    compiled = lc.compile(
        checkpoint,
        strategy="reset",
        events=Recordings(x, np.zeros(4, np.int64), step_seconds=0.02, source="touches"),
    )
    simulated = hw.simulate(compiled.program, x)
    predictions = np.asarray(simulated.prediction)
    for recording, scores in zip(x, np.asarray(simulated.scores), strict=True):
        assert np.array_equal(hw.Session(compiled.program).push(recording).scores[-1], scores)
    stops = hw.stop_when_proven(compiled.program, x)
    assert np.array_equal(stops.prediction, predictions)
    # With the predictions at the end as labels, all are right at the end.
    accuracies = over_time(Observed(compiled.levels, x, predictions))
    assert isinstance(accuracies, OverTime)
    assert accuracies.right["together"][-1] == 1.0


def test_each_branch_alone_predicts_other_classes_than_all_together() -> None:
    """So the tests above would notice a branch that is left out."""
    network = random_network(described())
    x = torch.from_numpy(touches(40)).float()
    branches = network.scores(network(x))
    together = network.counts(x).argmax(dim=1)
    assert all((scores.argmax(dim=1) != together).any() for scores in branches.values())


def test_lambda_weighs_the_location_branch_only() -> None:
    time, location, window = (torch.full((1, 2), value) for value in (1.0, 10.0, 100.0))
    total = weighted_counts({"time": time, "location": location, "window": window}, 0.5)
    assert total.tolist() == [[1.0 + 0.5 * 10.0 + 100.0] * 2]


def test_a_checkpoint_keeps_the_windows(tmp_path: Path) -> None:
    description = described()
    weights = random_network(description).weights()
    Checkpoint(description, weights).save(tmp_path / "h.pt")
    checkpoint = read_checkpoint(tmp_path / "h.pt")
    assert checkpoint.description == description
    assert list(checkpoint.weights) == list(description.weight_shapes)
    assert all(np.array_equal(checkpoint.weights[name], weights[name]) for name in weights)


@pytest.mark.parametrize(
    ("window", "message"),
    [
        (
            {"steps": 4, "stride": 2},
            "checkpoint 'h.pt': window: the key 'levels' is missing. Write it again with 'locsnn train'.",
        ),
        (
            {"steps": 4, "stride": 0, "levels": [1]},
            "checkpoint 'h.pt': window.stride: it must be a whole number of at least 1 (got 0). Write it again with 'locsnn train'.",
        ),
    ],
    ids=["no levels", "no stride"],
)
def test_faulty_windows_in_a_file_are_named(
    tmp_path: Path, window: dict[str, object], message: str
) -> None:
    description = described()
    Checkpoint(description, random_network(description).weights()).save(tmp_path / "h.pt")
    values = torch.load(tmp_path / "h.pt", weights_only=True)
    torch.save(values | {"window": window}, tmp_path / "h.pt")
    with pytest.raises(InputError) as caught:
        read_checkpoint(tmp_path / "h.pt")
    assert str(caught.value) == message


def test_a_network_without_a_window_branch_takes_no_windows() -> None:
    layout = InputLayout(neutouch(1), steps=40, step_seconds=0.02)
    with pytest.raises(InputError) as caught:
        NetworkDescription(
            "hybrid",
            layout,
            classes=3,
            hidden=6,
            neuron=None,
            location_order="own",
            location_taxels=ORDER,
            window=WindowParameters(),
        )
    assert str(caught.value) == (
        "architecture 'hybrid': its window is of another kind (WindowParameters against NoneType). Correct the description."
    )


def test_all_three_branches_learn() -> None:
    recordings = synthetic_touches(24, steps=40, classes=3, seed=3)
    config = config_from_mapping(
        {"model": "hybrid-window", "epochs": 4, "validation_fraction": 0.0, "hidden": 6}
    )
    result = train(recordings, config)
    start = build_network(
        result.network.description, seed=0, initial_scale=config.initial_scale
    ).weights()
    assert all(
        not np.array_equal(start[name], weights)
        for name, weights in result.network.weights().items()
    )
    assert result.history[-1].loss < result.history[0].loss


def test_the_command_starts_from_such_a_network_and_trains_it_on_integers(tmp_path: Path) -> None:
    write_recordings(tmp_path / "touches.npz", synthetic_touches(9, steps=40, classes=3, seed=1))
    (tmp_path / "own.yaml").write_text(
        "model: hybrid-window\nwindow_steps: 8\nwindow_levels: 2 4\ntau_sr: 5.0\nhidden: 4\n"
    )
    train_with = ["train", "--data", str(tmp_path / "touches.npz"), "--epochs", "2", "--quiet"]
    first, second = tmp_path / "first.pt", tmp_path / "second.pt"
    assert main([*train_with, "--config", str(tmp_path / "own.yaml"), "-o", str(first)]) == 0
    assert main([*train_with, "--from", str(first), "-o", str(second)]) == 0
    description = read_checkpoint(second).description
    assert description.window == WindowParameters(steps=8, stride=3, levels=(2, 4))
    assert description.srm("time").tau_sr == 5.0
    on_chip = ["--from", str(first), "--target", "loihi-sim"]
    assert main([*train_with, *on_chip, "-o", str(second)]) == 0
    chip = read_checkpoint(second).chip
    assert chip is not None
    assert list(chip.populations) == list(description.weight_shapes)
