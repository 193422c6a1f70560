"""Networks whose recordings start at the first touch (``align_events``).

The scores of torch, of the float reference and of the chip must agree, the setting must survive in the file, and
settings that make no sense are refused.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.cli.main import main
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.data.write import write_recordings
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.models.networks import build_network
from locsnn_compile.reference.evaluate import evaluate

LAYOUT = InputLayout(neutouch(1), steps=30, step_seconds=0.02)
CHANNELS = LAYOUT.channels  # 78: 39 taxels with two polarities
WALK = ("own", tuple(range(39, 0, -1)))
MODELS = ["tactile-snn", "hybrid", "hybrid-lif", "window-snn", "hybrid-window"]


def late_touches() -> np.ndarray:
    """Five recordings (samples, steps, channels) that start in different steps; the last one is silent."""
    rng = np.random.default_rng(0)
    recordings = (rng.random((5, LAYOUT.steps, CHANNELS)) < 0.15).astype(np.uint8)
    for recording, start in zip(recordings, (0, 4, 11, 29, LAYOUT.steps), strict=True):
        recording[:start] = 0
    return recordings


def network_of(model: str) -> tuple[NetworkDescription, torch.nn.Module]:
    """An untrained network that starts at the first step with two events; windows have random weights as well."""
    order, taxels = WALK if model != "tactile-snn" else (None, None)
    description = NetworkDescription(
        model,
        LAYOUT,
        classes=3,
        hidden=7,
        neuron=None,
        location_order=order,
        location_taxels=taxels,
        align_events=2,
    )
    network = build_network(description, seed=2, initial_scale=30.0)
    if description.structure.window_branch:
        rng = np.random.default_rng(1)
        shapes = description.weight_shapes
        # Weights of windows start at 0, with which all scores would be equal.
        window_weights = {
            name: rng.normal(size=shapes[name]).astype(np.float32)
            for name in description.window_names
        }
        network.load_weights(network.weights() | window_weights)
    return description, network


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_torch_the_reference_and_the_chip_start_alike(model: str, tmp_path: Path) -> None:
    description, network = network_of(model)
    recordings = late_touches()
    Checkpoint(description, network.weights()).save(tmp_path / "a.pt")
    assert read_checkpoint(tmp_path / "a.pt").description == description
    loaded = lc.load(tmp_path / "a.pt")
    assert {view.align_events for view in loaded.views} == {2}
    with torch.no_grad():
        torch_scores = network.double().counts(torch.from_numpy(recordings).double()).numpy()
    # Files hold float32 weights, so scores in float64 differ a little.
    assert np.allclose(evaluate(loaded, recordings).scores, torch_scores, atol=1e-4)
    assert (torch_scores[:4] != torch_scores[4]).any()  # the last recording is silent
    compiled = lc.compile(loaded)
    on_grid = evaluate(compiled.levels.quantized.on_grid(), recordings)
    assert np.array_equal(hw.simulate(compiled.program, recordings).scores, on_grid.scores)
    # Without the setting, scores differ, except in a time branch, where events keep their steps.
    unaligned = build_network(replace(description, align_events=None))
    unaligned.load_weights(network.weights())
    with torch.no_grad():
        unaligned_scores = unaligned.double().counts(torch.from_numpy(recordings).double()).numpy()
    assert model == "tactile-snn" or not np.allclose(unaligned_scores, torch_scores)


@pytest.mark.slow
def test_the_command_trains_an_aligned_network_and_starts_from_it_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_recordings(tmp_path / "touches.npz", synthetic_touches(9, steps=40, classes=3, seed=1))
    (tmp_path / "own.yaml").write_text("model: window-snn\nalign_events: 2\n")
    train_with = ["train", "--data", str(tmp_path / "touches.npz"), "--epochs", "2", "--quiet"]
    first, second = tmp_path / "first.pt", tmp_path / "second.pt"
    assert main([*train_with, "--config", str(tmp_path / "own.yaml"), "-o", str(first)]) == 0
    assert main([*train_with, "--from", str(first), "-o", str(second)]) == 0
    assert read_checkpoint(second).description.align_events == 2
    (tmp_path / "other.yaml").write_text("align_events: 3\n")
    contradicting = ["--from", str(first), "--config", str(tmp_path / "other.yaml")]
    assert main([*train_with, *contradicting, "-o", str(second)]) == 2
    assert capsys.readouterr().err == (
        "training option 'align_events': the network to start from has another value (got 3 against 2). "
        "Leave the option out.\n"
    )


REFUSED = {
    "no network of branches": (
        lambda: NetworkDescription("gru-mlp", LAYOUT, classes=3, align_events=1),
        "architecture 'gru-mlp': its recordings start at their first step. Leave align_events out.",
    ),
    "more than there can be": (
        lambda: NetworkDescription("tactile-snn", LAYOUT, classes=3, align_events=79),
        "align_events: it must be a whole number from 1 to 78 (got 79). Correct it.",
    ),
    "no events": (
        lambda: NetworkDescription("tactile-snn", LAYOUT, classes=3, align_events=0),
        "align_events: it must be a whole number from 1 to 78 (got 0). Correct it.",
    ),
}


@pytest.mark.parametrize(("make", "message"), REFUSED.values(), ids=REFUSED)
def test_impossible_settings_of_the_start_are_refused(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value) == message
