"""``--strategy``, and the budget that ``auto`` keeps, from the command line."""

import json

import numpy as np
import pytest

from locsnn_compile.cli.compile import main
from locsnn_compile.models.checkpoint import save_checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A time branch of random weights that spikes on synthetic touches."""
    description = NetworkDescription("tactile-snn", InputLayout(1, 40, 0.02), classes=3, hidden=6, name="small")
    r = np.random.default_rng(0)
    weights = {name: r.normal(0.5, 2.0, shape).astype(np.float32) for name, shape in description.weight_shapes.items()}
    path = tmp_path_factory.mktemp("model") / "small.pt"
    save_checkpoint(path, description, weights)
    return path


def compiled(model, folder, capsys, *options):
    code = main([str(model), "-o", str(folder), "--json", *options])
    printed = capsys.readouterr()
    return code, json.loads(printed.out), printed.err


@pytest.mark.parametrize(
    ("strategy", "compartments"), [("dendrite", 27), ("delay-line", 18), ("reset", 9)], ids=["3", "2", "1"]
)
def test_a_strategy_decides_the_compartments(model, tmp_path, capsys, strategy, compartments):
    code, report, _ = compiled(model, tmp_path / "b", capsys, "--strategy", strategy)
    assert code == 0
    assert report["strategy"] == strategy
    assert report["resources"]["compartments"] == compartments
    assert report["strategy_choice"] is None
    assert {entry["strategy"] for entry in report["quantization"].values()} == {strategy}
    assert all(entry["kernel_fit"]["input_rms"] < 1e-3 for entry in report["quantization"].values())


def test_auto_says_what_it_compared(model, tmp_path, capsys):
    _, report, _ = compiled(model, tmp_path / "b", capsys)
    choice = report["strategy_choice"]
    assert choice["taken"] == report["strategy"]
    assert choice["calibration_source"] == "synthetic touches"
    assert "Strategies compared on 16 recordings of synthetic touches" in (tmp_path / "b/report.md").read_text()


def test_a_generous_budget_takes_the_cheapest(model, tmp_path, capsys):
    code, report, _ = compiled(model, tmp_path / "b", capsys, "--max-spike-error", "1")
    assert (code, report["strategy"]) == (0, "reset")


def test_a_budget_that_nothing_keeps_is_a_gate_that_fails(model, tmp_path, capsys):
    code, report, said = compiled(model, tmp_path / "b", capsys, "--max-spike-error", "0")
    error = 1 - report["match"]["spike_agreement"]
    assert code == 3
    assert said == f"gate failed: --max-spike-error: {error:.4f} of the spikes differ, above 0.\n"
    assert "taken: " + report["strategy"] + ", the most accurate" in (tmp_path / "b/report.md").read_text()


def test_calibration_recordings_can_be_given(model, tmp_path, capsys):
    r = np.random.default_rng(1)
    path = tmp_path / "calibration.npy"
    np.save(path, (r.random((5, 78, 40)) < 0.2).astype(np.uint8))
    _, report, _ = compiled(model, tmp_path / "b", capsys, "--calibration", str(path))
    assert report["strategy_choice"]["calibration_source"] == "calibration.npy"
    assert report["strategy_choice"]["calibration_samples"] == 5
