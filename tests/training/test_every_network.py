"""Every network by name: the command trains and writes it, its file is read, and it is compiled or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main
from locsnn_compile.cli.shell import EXIT_GATE
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.models.architectures import ARCHITECTURES
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.networks import build_network
from locsnn_compile.training.config import TrainingConfig, config_from_mapping, read_config

CONFIGS = Path(__file__).parents[2] / "examples" / "configs"
SMALL = (
    "defaults: fixed\nhidden: 4\nfeatures: 3\nstep_features: 2\nepochs: 2\nvalidation_fraction: 0.0\n"
    "batch_size: 6\n"
)

ON_TOUCH = [name for name, a in ARCHITECTURES.items() if a.neurons != "xylo"]
"""All networks but that of a Xylo, which has too few inputs for a fingertip; see ``test_train_for_xylo.py``."""


def write_touches(folder: Path, fingertips: int = 1) -> Path:
    """Write 12 synthetic recordings of three classes as ``touches.npz``."""
    touches = synthetic_touches(12, steps=30, classes=3, fingertips=fingertips)
    path = folder / "touches.npz"
    np.savez(
        path, spikes=touches.spikes.transpose(0, 2, 1), labels=touches.labels, step_seconds=0.02
    )
    return path


@pytest.mark.slow
@pytest.mark.parametrize("fingertips", [1, 2])
@pytest.mark.parametrize("name", ON_TOUCH)
def test_the_command_trains_every_network(
    name: str,
    fingertips: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    write_touches(tmp_path, fingertips)
    (tmp_path / "small.yaml").write_text(SMALL)
    files = ["--data", "touches.npz", "--config", "small.yaml", "-o", "net.pt"]
    # Two epochs teach some networks nothing, which is exit code 3; the checkpoint is written.
    assert main(["train", "--model", name, *files]) in (0, EXIT_GATE)
    first, *remarks, last = capsys.readouterr().out.splitlines()
    assert (first, last) == ("epoch 2 chosen", "wrote net.pt")
    assert all(line.startswith("! ") for line in remarks if "baseline" not in line)
    checkpoint = read_checkpoint("net.pt")
    description = checkpoint.description
    assert (description.architecture, checkpoint.training["epochs"]) == (name, 2)
    network = build_network(description)
    network.load_weights(checkpoint.weights)
    x = torch.zeros(2, 30, description.input.channels)
    assert tuple(network.counts(x).shape) == (2, 3)
    # Some weights have been learned.
    start = build_network(description, seed=0, initial_scale=TrainingConfig().initial_scale)
    assert any(
        not np.array_equal(start.weights()[key], checkpoint.weights[key])
        for key in checkpoint.weights
    )


def test_a_graph_network_is_trained_with_its_options_and_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_touches(tmp_path)
    (tmp_path / "small.yaml").write_text(SMALL)
    model = ["--model", "hybrid-graph", "--graph", "tree", "--config", "small.yaml"]
    train = ["train", "--data", "touches.npz", *model, "--quiet", "-o", "net.pt"]
    assert main(train) in (0, EXIT_GATE)
    graph = read_checkpoint("net.pt").description.graph
    assert graph is not None
    edges_of_tree = 70
    assert (graph.name, len(graph.taxel_edges)) == ("tree", edges_of_tree)
    assert (graph.hops, graph.features) == (3, 3)
    assert compile_main(["net.pt", "--quiet", "-o", "out"]) == 0
    assert (tmp_path / "out" / "program.yaml").exists()


def test_an_artificial_network_is_not_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_touches(tmp_path)
    (tmp_path / "small.yaml").write_text(SMALL)
    model = ["--model", "gru-mlp", "--config", "small.yaml"]
    main(["train", "--data", "touches.npz", *model, "--quiet", "-o", "net.pt"])
    assert compile_main(["net.pt"]) == 1
    assert capsys.readouterr().err == (
        "model 'net': a 'gru-mlp' has no spiking neurons, so no chip program can be made of it. "
        "Train a spiking network; for this one, only operations are counted.\n"
    )
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "net.csv",
        "net.pt",
        "net.svg",
        "small.yaml",
        "touches.npz",
    ]


@pytest.mark.parametrize("name", ["hybrid-lif", "cnn-3d"])
def test_only_spike_response_neurons_and_windows_are_trained_on_the_chips_integers(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_touches(tmp_path)
    assert main(["train", "--data", "touches.npz", "--model", name, "--target", "loihi-sim"]) == 2
    assert capsys.readouterr().err == (
        f"architecture {name!r}: it has no spike response neurons. "
        "Use one of: tactile-snn, location-tactile-snn, hybrid, window-snn, hybrid-window.\n"
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ON_TOUCH)
def test_every_network_has_a_shipped_configuration_and_a_published_one_a_second(name: str) -> None:
    configs = {path.stem: config_from_mapping(read_config(path)) for path in CONFIGS.glob("*.yaml")}
    of_network = {stem for stem, config in configs.items() if config.model == name}
    published = {stem for stem in of_network if stem.endswith("-published")}
    assert of_network - published
    is_published = not name.endswith("-lif") and "window" not in name
    assert bool(published) == is_published
