"""Networks that are trained to start at the first touch: torch, the float reference and the chip, and their files."""

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
WALK = ("own", tuple(range(39, 0, -1)))
MODELS = ["tactile-snn", "hybrid", "hybrid-lif", "window-snn", "hybrid-window"]


def late_touches() -> np.ndarray:
    rng = np.random.default_rng(0)
    played = (rng.random((5, 30, 78)) < 0.15).astype(np.uint8)
    for recording, start in zip(played, (0, 4, 11, 29, 30), strict=True):
        recording[:start] = 0
    return played


def network_of(model: str) -> tuple[NetworkDescription, torch.nn.Module]:
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
        own = {
            name: rng.normal(size=shapes[name]).astype(np.float32)
            for name in description.window_names
        }
        network.load_weights(network.weights() | own)
    return description, network


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_torch_the_reference_and_the_chip_start_alike(model: str, tmp_path: Path) -> None:
    description, network = network_of(model)
    played = late_touches()
    Checkpoint(description, network.weights()).save(tmp_path / "a.pt")
    found = read_checkpoint(tmp_path / "a.pt")
    assert found.description == description
    loaded = lc.load(tmp_path / "a.pt")
    assert {view.align_events for view in loaded.views} == {2}
    with torch.no_grad():
        wanted = network.double().counts(torch.from_numpy(played).double()).numpy()
    scores = evaluate(loaded, played).scores
    assert np.allclose(scores, wanted, atol=1e-4)
    assert (wanted[:4] != wanted[4]).any()  # the last recording is empty
    compiled = lc.compile(loaded)
    on_grid = evaluate(compiled.levels.quantized.on_grid(), played)
    assert np.array_equal(hw.simulate(compiled.program, played).scores, on_grid.scores)
    plain = build_network(replace(description, align_events=None))
    plain.load_weights(network.weights())
    with torch.no_grad():
        other = plain.double().counts(torch.from_numpy(played).double()).numpy()
    assert model == "tactile-snn" or not np.allclose(other, wanted)


@pytest.mark.slow
def test_the_command_trains_it_and_goes_on_from_it(
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
    assert (
        main(
            [
                *train_with,
                "--from",
                str(first),
                "--config",
                str(tmp_path / "other.yaml"),
                "-o",
                str(second),
            ]
        )
        == 2
    )
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
def test_starts_that_cannot_be(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value) == message
