"""The network of windows: its hidden neurons against counts by hand, its learning, and its way to the chip."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

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
from locsnn_compile.models.graph_and_windows import WindowParameters, output_parts
from locsnn_compile.models.networks import WindowNetwork
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.training.config import config_from_mapping
from locsnn_compile.training.train import train

ORDER = tuple(range(39, 0, -1))
WEIGHT, BIAS = "location_output", "location_output_bias"


def described(
    steps: int = 12, fingertips: int = 1, windows: WindowParameters | None = None
) -> NetworkDescription:
    """A network of windows of 4 steps, every 2 steps, with neurons for 1 and for 3 events."""
    layout = InputLayout(neutouch(fingertips), steps=steps, step_seconds=0.02)
    window = windows or WindowParameters(steps=4, stride=2, levels=(1, 3))
    return NetworkDescription(
        "window-snn", layout, classes=3, window=window, location_order="own", location_taxels=ORDER
    )


def touches(samples: int, steps: int, fingertips: int = 1, share: float = 0.3) -> NDArray[np.uint8]:
    """Random recordings (samples, steps, channels) with a share of events."""
    rng = np.random.default_rng(samples * steps)
    return (rng.random((samples, steps, 78 * fingertips)) < share).astype(np.uint8)


def random_network(description: NetworkDescription) -> WindowNetwork:
    network = WindowNetwork(description)
    rng = np.random.default_rng(0)
    shapes = description.weight_shapes
    network.load_weights(
        {name: rng.normal(size=shape).astype(np.float32) for name, shape in shapes.items()}
    )
    return network


@given(
    st.integers(1, 5), st.integers(1, 4), st.sets(st.integers(1, 5), min_size=1), st.integers(5, 14)
)
def test_a_hidden_neuron_spikes_where_its_window_holds_enough_events(
    length: int, stride: int, levels: set[int], steps: int
) -> None:
    told = tuple(sorted(level for level in levels if level <= length)) or (1,)
    windows = WindowParameters(length, stride, told)
    description = described(steps, windows=windows)
    x = touches(2, steps)
    found = (
        WindowNetwork(description)
        .hidden(torch.from_numpy(x).float())
        .numpy()
        .reshape(2, 78, -1, len(told))
    )
    starts = range(0, steps - length + 1, stride)
    for place in range(78):
        channel = 2 * (ORDER[place // 2] - 1) + place % 2
        for w, start in enumerate(starts):
            events = x[:, start : start + length, channel].sum(axis=1)
            for k, level in enumerate(told):
                assert (found[:, place, w, k] == (events >= level)).all()
    assert found.shape[2] == len(starts)


@pytest.mark.parametrize("fingertips", [1, 2])
def test_synapses_hear_what_the_layer_counts(fingertips: int) -> None:
    description = described(11, fingertips)
    x, network = touches(3, 11, fingertips), WindowNetwork(description)
    walked = x[:, :, network.walk.numpy()].transpose(0, 2, 1).reshape(3, -1)
    charge = (description.windows.synapses(11, 78 * fingertips) @ walked.T).T
    levels = np.tile(description.windows.levels, charge.shape[1] // 2)
    assert np.array_equal(charge >= levels, network.hidden(torch.from_numpy(x).float()).numpy() > 0)


PARTS = {
    "all of them": ([100] * 3, [(0, 300)]),
    "as many as fit": ([500, 524, 1], [(0, 1024), (1024, 1025)]),
    "one that is larger": ([10, 4096, 4096], [(0, 10), (10, 4106), (4106, 8202)]),
}


@pytest.mark.parametrize(("sizes", "wanted"), PARTS.values(), ids=PARTS)
def test_outputs_hear_whole_taxels(sizes: list[int], wanted: list[tuple[int, int]]) -> None:
    assert [(part.start, part.stop) for part in output_parts(sizes)] == wanted


REFUSED = {
    "a taxel that no output can hear": (
        lambda: output_parts([10, 4097]),
        "windows: one taxel has more hidden neurons than an output can receive from (4097 against 4096). "
        "Use a larger window_stride, or fewer window_levels.",
    ),
    "a recording shorter than a window": (
        lambda: described(3),
        "recordings: one window is longer than they are (4 steps against 3). Use shorter windows (window_steps).",
    ),
    "more neurons than a chip has": (
        lambda: described(4000, windows=WindowParameters(steps=1, stride=2, levels=(1,))),
        "window neurons: it must be a whole number from 1 to 131072 (got 156000). Correct it.",
    ),
    "no stride": (
        lambda: WindowParameters(stride=0),
        "windows 'stride': it must be a whole number of at least 1 (got 0). Correct it.",
    ),
    "levels that no window reaches": (
        lambda: WindowParameters(steps=4, stride=2, levels=(1, 5)),
        "windows 'levels': they must be numbers of events, each larger than the one before (got [1, 5] against 1..4). "
        "Give, for example, 1 2.",
    ),
}


@pytest.mark.parametrize(("make", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_is_refused(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value) == message


def test_beginning_to_learn_changes_no_score() -> None:
    network, x = random_network(described()), torch.from_numpy(touches(4, 12)).float()
    before = network.counts(x)
    network.begin(touches(7, 12))
    assert float(network.usual.abs().sum()) > 0
    assert torch.allclose(network.counts(x), before, atol=1e-4)


def test_kept_weights_give_the_scores_of_the_learning_network() -> None:
    network, x = random_network(described()), torch.from_numpy(touches(4, 12)).float()
    network.begin(touches(7, 12))
    kept = network.weights()
    by_hand = network.hidden(x) @ torch.from_numpy(kept[WEIGHT]).T + torch.from_numpy(kept[BIAS])
    assert torch.allclose(network.counts(x), by_hand, atol=1e-4)


def test_it_learns_motions() -> None:
    made = synthetic_touches(60, steps=60, classes=4, seed=3)
    config = config_from_mapping(
        {"model": "window-snn", "epochs": 12, "validation_fraction": 0.25, "refit": False}
    )
    found = train(made, config)
    assert found.history[-1].loss < 0.5 * found.history[0].loss
    assert found.validation_accuracy is not None
    assert found.validation_accuracy > 0.7


def test_a_killed_run_goes_on_to_equal_bits(tmp_path: Path) -> None:
    made = synthetic_touches(16, steps=40, classes=2, seed=3)
    options = {"model": "window-snn", "epochs": 4, "validation_fraction": 0.25}
    whole = train(made, config_from_mapping(options)).network.weights()
    state = tmp_path / "run.state"

    def kill(done: int, _expected: int, _record: object) -> None:
        if done == 3:
            raise KeyboardInterrupt

    config = config_from_mapping(options)
    with pytest.raises(KeyboardInterrupt):
        train(made, config, state_path=state, save_every=1, progress=kill)
    assert state.exists()
    again = train(made, config, state_path=state, save_every=1).network.weights()
    assert all(np.array_equal(whole[name], again[name]) for name in whole)


def test_going_on_from_a_network_keeps_its_windows(tmp_path: Path) -> None:
    write_recordings(tmp_path / "touches.npz", synthetic_touches(9, steps=40, classes=3, seed=1))
    (tmp_path / "own.yaml").write_text(
        "model: window-snn\nwindow_steps: 8\nwindow_stride: 5\nwindow_levels: 2 4\n"
    )
    train_with = ["train", "--data", str(tmp_path / "touches.npz"), "--epochs", "2", "--quiet"]
    first, second = tmp_path / "first.pt", tmp_path / "second.pt"
    assert main([*train_with, "--config", str(tmp_path / "own.yaml"), "-o", str(first)]) == 0
    assert main([*train_with, "--from", str(first), "-o", str(second)]) == 0
    found, before = read_checkpoint(second), read_checkpoint(first)
    assert (
        found.description.window
        == before.description.window
        == WindowParameters(steps=8, stride=5, levels=(2, 4))
    )
    assert found.training["optimizer"] == "sgd"
    assert not np.array_equal(found.weights[WEIGHT], before.weights[WEIGHT])


LAYOUTS = {
    "one fingertip, one output": (30, 1, WindowParameters(steps=6, stride=3, levels=(1, 2))),
    "two fingertips, several outputs": (120, 2, WindowParameters(steps=6, stride=3, levels=(1, 2))),
}


@pytest.mark.parametrize(("steps", "fingertips", "windows"), LAYOUTS.values(), ids=LAYOUTS)
def test_the_chip_adds_what_the_network_adds(
    steps: int, fingertips: int, windows: WindowParameters, tmp_path: Path
) -> None:
    description = described(steps, fingertips, windows)
    network, x = random_network(description), touches(6, steps, fingertips, 0.1)
    Checkpoint(description, network.weights()).save(tmp_path / "w.pt")
    loaded = lc.load(tmp_path / "w.pt")
    outputs = loaded.readout.populations
    assert len(outputs) == len(description.output_parts)
    given_x = torch.from_numpy(x).double()
    wanted = network.double().counts(given_x).detach().numpy()
    reference = evaluate(loaded, x)
    assert np.allclose(reference.scores, wanted, atol=1e-5)
    assert np.array_equal(
        reference.spikes["location_hidden"][:, 1], network.hidden(given_x).numpy()
    )
    compiled = lc.compile(
        loaded, events=Recordings(x, labels=None, step_seconds=0.02, source="touches")
    )
    played = hw.simulate(compiled.program, x)
    assert np.array_equal(played.spikes["location_hidden"], reference.spikes["location_hidden"])
    on_grid = evaluate(compiled.levels.quantized.on_grid(), x)
    assert np.array_equal(played.scores, on_grid.scores)
    assert played.counts.charge_wraps == 0
    scale = compiled.levels.quantized.population(outputs[0]).scale[0]
    scale *= compiled.program.readout.weights[0] / loaded.readout.weights[0]
    assert np.abs(np.asarray(played.scores) / scale - wanted).max() < 0.02 * np.abs(wanted).max()
