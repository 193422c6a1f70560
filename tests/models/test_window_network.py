"""``window-snn``, the network that counts events in windows of time.

Its hidden neurons are compared with counts by hand; its scores on the chip with those in torch. It must learn, continue
after an interruption with equal bits, and start from an earlier network.
"""

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

ORDER = tuple(range(39, 0, -1))  # the taxels backwards
CHANNELS = 78  # of a fingertip: 39 taxels with two polarities
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
    return (rng.random((samples, steps, CHANNELS * fingertips)) < share).astype(np.uint8)


def random_network(description: NetworkDescription) -> WindowNetwork:
    """A network with random weights; untrained ones are all 0."""
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
def test_a_hidden_neuron_spikes_if_its_window_has_enough_events(
    length: int, stride: int, levels: set[int], steps: int
) -> None:
    # A window has at most one event of a channel in each step, so higher levels are not allowed.
    possible_levels = tuple(sorted(level for level in levels if level <= length)) or (1,)
    windows = WindowParameters(length, stride, possible_levels)
    x = touches(2, steps)
    network = WindowNetwork(described(steps, windows=windows))
    hidden = network.hidden(torch.from_numpy(x).float()).numpy()
    # By recording, location, window and level.
    spikes = hidden.reshape(2, CHANNELS, -1, len(possible_levels))
    starts = range(0, steps - length + 1, stride)
    assert spikes.shape[2] == len(starts)
    for location in range(CHANNELS):
        channel = 2 * (ORDER[location // 2] - 1) + location % 2
        for w, start in enumerate(starts):
            events = x[:, start : start + length, channel].sum(axis=1)
            for k, level in enumerate(possible_levels):
                assert (spikes[:, location, w, k] == (events >= level)).all()


@pytest.mark.parametrize("fingertips", [1, 2])
def test_the_charges_by_synapses_reach_the_levels_where_the_layer_spikes(fingertips: int) -> None:
    samples, steps = 3, 11
    description = described(steps, fingertips)
    x = touches(samples, steps, fingertips)
    network = WindowNetwork(description)
    lines = x[:, :, network.walk.numpy()].transpose(0, 2, 1).reshape(samples, -1)
    charge = (description.windows.synapses(steps, CHANNELS * fingertips) @ lines.T).T
    levels = np.tile(description.windows.levels, charge.shape[1] // 2)
    assert np.array_equal(charge >= levels, network.hidden(torch.from_numpy(x).float()).numpy() > 0)


# Hidden neurons of each taxel -> the range of hidden neurons of each output population. An output receives from up to
# 1,024 hidden neurons, or from those of a single taxel, up to 4,096.
PARTS = {
    "all taxels": ([100] * 3, [(0, 300)]),
    "as many taxels as fit": ([500, 524, 1], [(0, 1024), (1024, 1025)]),
    "a taxel that is larger": ([10, 4096, 4096], [(0, 10), (10, 4106), (4106, 8202)]),
}


@pytest.mark.parametrize(("sizes", "ranges"), PARTS.values(), ids=PARTS)
def test_an_output_receives_from_whole_taxels(
    sizes: list[int], ranges: list[tuple[int, int]]
) -> None:
    assert [(part.start, part.stop) for part in output_parts(sizes)] == ranges


REFUSED = {
    "a taxel with more neurons than an output can receive from": (
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
def test_impossible_windows_are_refused(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value) == message


def test_taking_the_mean_spikes_of_the_training_recordings_changes_no_score() -> None:
    network = random_network(described())
    x = torch.from_numpy(touches(samples=4, steps=12)).float()
    before = network.counts(x)
    network.begin(touches(samples=7, steps=12))
    assert float(network.usual.abs().sum()) > 0
    assert torch.allclose(network.counts(x), before, atol=1e-4)


def test_saved_weights_give_the_scores_of_the_learning_network() -> None:
    network = random_network(described())
    x = torch.from_numpy(touches(samples=4, steps=12)).float()
    network.begin(touches(samples=7, steps=12))
    saved = network.weights()
    by_hand = network.hidden(x) @ torch.from_numpy(saved[WEIGHT]).T + torch.from_numpy(saved[BIAS])
    assert torch.allclose(network.counts(x), by_hand, atol=1e-4)


def test_it_learns_to_tell_motions_apart() -> None:
    """Four classes, so chance is 0.25."""
    recordings = synthetic_touches(60, steps=60, classes=4, seed=3)
    config = config_from_mapping(
        {"model": "window-snn", "epochs": 12, "validation_fraction": 0.25, "refit": False}
    )
    result = train(recordings, config)
    assert result.history[-1].loss < 0.5 * result.history[0].loss
    assert result.validation_accuracy is not None
    assert result.validation_accuracy > 0.7


def test_a_killed_run_continues_to_equal_bits(tmp_path: Path) -> None:
    recordings = synthetic_touches(16, steps=40, classes=2, seed=3)
    options = {"model": "window-snn", "epochs": 4, "validation_fraction": 0.25}
    uninterrupted = train(recordings, config_from_mapping(options)).network.weights()
    state = tmp_path / "run.state"

    def kill(done: int, _expected: int, _record: object) -> None:
        if done == 3:
            raise KeyboardInterrupt

    config = config_from_mapping(options)
    with pytest.raises(KeyboardInterrupt):
        train(recordings, config, state_path=state, save_every=1, progress=kill)
    assert state.exists()
    continued = train(recordings, config, state_path=state, save_every=1).network.weights()
    assert all(np.array_equal(uninterrupted[name], continued[name]) for name in uninterrupted)


def test_a_run_that_starts_from_a_network_keeps_its_windows(tmp_path: Path) -> None:
    write_recordings(tmp_path / "touches.npz", synthetic_touches(9, steps=40, classes=3, seed=1))
    (tmp_path / "own.yaml").write_text(
        "model: window-snn\nwindow_steps: 8\nwindow_stride: 5\nwindow_levels: 2 4\n"
    )
    train_with = ["train", "--data", str(tmp_path / "touches.npz"), "--epochs", "2", "--quiet"]
    first, second = tmp_path / "first.pt", tmp_path / "second.pt"
    assert main([*train_with, "--config", str(tmp_path / "own.yaml"), "-o", str(first)]) == 0
    assert main([*train_with, "--from", str(first), "-o", str(second)]) == 0
    start = read_checkpoint(first)
    result = read_checkpoint(second)
    windows = WindowParameters(steps=8, stride=5, levels=(2, 4))
    assert result.description.window == start.description.window == windows
    assert result.training["optimizer"] == "sgd"
    assert not np.array_equal(result.weights[WEIGHT], start.weights[WEIGHT])


LAYOUTS = {
    "one fingertip, one output": (30, 1, WindowParameters(steps=6, stride=3, levels=(1, 2))),
    "two fingertips, several outputs": (120, 2, WindowParameters(steps=6, stride=3, levels=(1, 2))),
}


@pytest.mark.parametrize(("steps", "fingertips", "windows"), LAYOUTS.values(), ids=LAYOUTS)
def test_the_chip_and_the_reference_have_the_scores_of_torch(
    steps: int, fingertips: int, windows: WindowParameters, tmp_path: Path
) -> None:
    description = described(steps, fingertips, windows)
    network = random_network(description)
    x = touches(samples=6, steps=steps, fingertips=fingertips, share=0.1)
    Checkpoint(description, network.weights()).save(tmp_path / "w.pt")
    loaded = lc.load(tmp_path / "w.pt")
    outputs = loaded.readout.populations
    assert len(outputs) == len(description.output_parts)
    x_in_torch = torch.from_numpy(x).double()
    torch_scores = network.double().counts(x_in_torch).detach().numpy()
    reference = evaluate(loaded, x)
    assert np.allclose(reference.scores, torch_scores, atol=1e-5)
    # Events are sent in step 0 of the phase and arrive in step 1.
    assert np.array_equal(
        reference.spikes["location_hidden"][:, 1], network.hidden(x_in_torch).numpy()
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
    # Quantised weights make a small difference.
    difference = np.abs(np.asarray(played.scores) / scale - torch_scores).max()
    assert difference < 0.02 * np.abs(torch_scores).max()
