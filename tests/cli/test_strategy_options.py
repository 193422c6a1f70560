"""``--strategy``, and the budget that ``auto`` keeps, from the command line.

A strategy is a way to lay out a neuron in compartments, whose numbers are known; a budget bounds what the chip may lose.
Choices are compared with what the report says of all candidates.
"""

import json

import numpy as np
import pytest

from locsnn_compile.cli.compile import main
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.models.graph_and_windows import WindowParameters
from locsnn_compile.models.networks import build_network
from locsnn_compile.report.format import share


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A time branch of random weights that spikes on synthetic touches."""
    description = NetworkDescription(
        "tactile-snn",
        InputLayout(neutouch(1), steps=40, step_seconds=0.02),
        classes=3,
        hidden=6,
        name="small",
    )
    r = np.random.default_rng(0)
    weights = {
        name: r.normal(0.5, 2.0, shape).astype(np.float32)
        for name, shape in description.weight_shapes.items()
    }
    path = tmp_path_factory.mktemp("model") / "small.pt"
    Checkpoint(description, weights).save(path)
    return path


def compiled(model, folder, capsys, *options):
    """Compile a model; return the exit code, the report and what was printed as errors."""
    code = main([str(model), "-o", str(folder), "--json", *options])
    printed = capsys.readouterr()
    return code, json.loads(printed.out), printed.err


NEURONS = 9
"""Of the model: 6 hidden ones and 3 classes."""


@pytest.mark.parametrize(
    ("strategy", "compartments_per_neuron"),
    [("dendrite", 3), ("delay-line", 2), ("reset", 1), ("paired-dendrite", 5)],
)
def test_a_strategy_decides_the_compartments(
    model, tmp_path, capsys, strategy, compartments_per_neuron
):
    code, report, _ = compiled(model, tmp_path / "b", capsys, "--strategy", strategy)
    assert code == 0
    assert report["strategy"] == strategy
    assert report["resources"]["compartments"] == compartments_per_neuron * NEURONS
    assert report["strategy_choice"] is None
    assert {entry["strategy"] for entry in report["quantization"].values()} == {strategy}
    assert all(entry["kernel_fit"]["input_rms"] < 1e-3 for entry in report["quantization"].values())


def test_auto_says_what_it_compared(model, tmp_path, capsys):
    _, report, _ = compiled(model, tmp_path / "b", capsys)
    choice = report["strategy_choice"]
    assert choice["taken"] == report["strategy"]
    assert choice["calibration_source"] == "synthetic touches"
    assert (
        "Settings compared on 16 recordings of synthetic touches"
        in (tmp_path / "b/report.md").read_text()
    )


def test_a_budget_of_windows_is_kept_on_the_calibration_recordings(tmp_path, capsys):
    windows = WindowParameters(steps=8, stride=8, levels=(1,))
    order = {"location_order": "own", "location_taxels": tuple(range(1, 40))}
    layout = InputLayout(neutouch(1), steps=40, step_seconds=0.02)
    description = NetworkDescription(
        "window-snn", layout, classes=3, window=windows, name="windows", **order
    )
    Checkpoint(description, build_network(description, seed=1).weights()).save(
        tmp_path / "windows.pt"
    )
    few = tmp_path / "few.npy"
    np.save(few, (np.random.default_rng(0).random((3, 78, 40)) < 0.1).astype(np.uint8))
    options = ("--calibration", str(few), "--max-score-error", "0", "--weight-bits", "2")
    code, report, stderr = compiled(tmp_path / "windows.pt", tmp_path / "b", capsys, *options)
    choice = report["strategy_choice"]
    assert (code, choice["kept"], choice["calibration_source"]) == (3, False, "few.npy")
    assert {row["strategy"] for row in choice["candidates"]} == {"native"}
    unmet = "no setting keeps --max-score-error 0 on 3 recordings of few.npy: the best of 3 is native, 2-bit"
    assert stderr.splitlines()[1].startswith(unmet)


def test_a_budget_that_is_not_kept_in_calibration_is_exit_code_3(model, tmp_path, capsys):
    """Even if the recordings of the check happen to keep it."""
    rates = {"sparse": 0.01, "dense": 0.3}
    for name, rate in rates.items():
        np.save(
            tmp_path / f"{name}.npy",
            (np.random.default_rng(1).random((4, 78, 40)) < rate).astype(np.uint8),
        )
    files = [str(tmp_path / f"{name}.npy") for name in rates]
    options = (
        "--calibration",
        files[0],
        "--strategy",
        "reset",
        "--weight-bits",
        "1",
        "--split-weights",
        "0",
    )
    spike_errors = []
    for file in files:
        _, report, _ = compiled(model, tmp_path / "b", capsys, *options, "--events", file)
        spike_errors.append(1 - report["match"]["spike_agreement"])
    assert spike_errors[0] > spike_errors[1]
    # Between both: the recordings of the check keep it, and those of calibration do not.
    bound = str(sum(spike_errors) / 2)
    code, report, stderr = compiled(
        model, tmp_path / "b", capsys, *options, "--events", files[1], "--max-spike-error", bound
    )
    assert report["gates"][0]["passed"]
    assert not report["strategy_choice"]["kept"]
    assert code == 3
    assert stderr.startswith("no setting keeps --max-spike-error ")


def test_a_generous_budget_takes_the_cheapest(model, tmp_path, capsys):
    code, report, _ = compiled(model, tmp_path / "b", capsys, "--max-spike-error", "1")
    assert (code, report["strategy"]) == (0, "reset")


def test_a_budget_that_nothing_keeps_is_a_gate_that_fails(model, tmp_path, capsys):
    code, report, stderr = compiled(
        model, tmp_path / "b", capsys, "--max-spike-error", "0", "--weight-bits", "1"
    )
    choice, error = report["strategy_choice"], 1 - report["match"]["spike_agreement"]
    best = max(
        choice["candidates"], key=lambda row: (row["prediction_agreement"], -row["spike_error"])
    )
    assert code == 3
    assert not choice["kept"]
    assert stderr == (
        f"gate failed: --max-spike-error: {error:.4f} of the spikes differ, above 0.\n"
        "no setting keeps --max-spike-error 0 on 16 recordings of synthetic touches: the best of "
        f"{len(choice['candidates'])} is {words(best)}, with {share(1 - best['prediction_agreement'])} of the predictions "
        f"changed, {share(best['spike_error'])} of the spikes different and class scores off by {share(best['score_error'])} of "
        "their spread. Train for the chip with locsnn train --target, or allow more.\n"
    )
    assert f"taken: {words(best)}, the most accurate" in (tmp_path / "b/report.md").read_text()


def words(row):
    """Return a setting in the words of messages."""
    split = {0: "", 0.25: ", 25% split", 1: ", 100% split"}[row["split_weights"]]
    return f"{row['strategy']}, {row['weight_bits']}-bit{split}"


def test_more_weights_are_split_until_the_budget_is_kept(model, tmp_path, capsys):
    """Weights of few bits lose too much, and a second synapse for some of them makes up for it."""
    code, report, stderr = compiled(
        model, tmp_path / "b", capsys, "--max-spike-error", "0.12", "--weight-bits", "3"
    )
    choice = report["strategy_choice"]
    assert (code, stderr) == (0, "")
    within_budget = [row for row in choice["candidates"] if row["within_budget"]]
    cheapest = min(within_budget, key=lambda row: row["energy_pj"])
    assert choice["kept"]
    assert (choice["taken"], choice["taken_weight_bits"]) == (
        cheapest["strategy"],
        cheapest["weight_bits"],
    )
    assert choice["taken_split_weights"] == cheapest["split_weights"]
    assert report["weight_bits"] == cheapest["weight_bits"]
    assert max(row["weight_bits"] for row in choice["candidates"]) == 3


@pytest.mark.slow
@pytest.mark.parametrize(("share", "value"), [("none", 0.0), ("all", 1.0), ("0.5", 0.5)])
def test_a_share_of_split_weights_can_be_asked_for(model, tmp_path, capsys, share, value):
    options = ("--split-weights", share, "--weight-bits", "4", "--max-spike-error", "1")
    _, report, _ = compiled(model, tmp_path / "b", capsys, *options)
    assert {row["split_weights"] for row in report["strategy_choice"]["candidates"]} == {value}


def test_split_weights_make_more_synapses(model, tmp_path, capsys):
    options = ("--strategy", "dendrite", "--weight-bits", "4", "--split-weights")
    none, some, all_of_them = (
        compiled(model, tmp_path / share, capsys, *options, share)[1]
        for share in ("none", "0.5", "all")
    )
    synapses = [report["resources"]["synapses"] for report in (none, some, all_of_them)]
    assert synapses == sorted(set(synapses))
    assert all_of_them["match"]["spike_agreement"] > none["match"]["spike_agreement"]


def test_no_share_of_the_weights(model, tmp_path, capsys):
    assert main([str(model), "-o", str(tmp_path / "b"), "--split-weights", "2"]) == 2
    stderr = capsys.readouterr().err
    assert stderr == "--split-weights 2: it is out of range. Give a number from 0 to 1.\n"


def test_calibration_takes_the_train_part_of_an_archive(model, tmp_path, capsys):
    r = np.random.default_rng(2)
    for split, count in (("train", 3), ("test", 2)):
        (tmp_path / "Ev" / split).mkdir(parents=True)
        for i in range(count):
            touch = (r.random((39, 2, 40)) < 0.1).astype(np.uint8)
            np.save(tmp_path / "Ev" / split / f"sample_{i}_label_0.npy", touch)
    _, report, _ = compiled(model, tmp_path / "b", capsys, "--calibration", str(tmp_path / "Ev"))
    assert report["strategy_choice"]["calibration_samples"] == 3


def test_calibration_recordings_can_be_given(model, tmp_path, capsys):
    r = np.random.default_rng(1)
    path = tmp_path / "calibration.npy"
    np.save(path, (r.random((5, 78, 40)) < 0.2).astype(np.uint8))
    _, report, _ = compiled(model, tmp_path / "b", capsys, "--calibration", str(path))
    assert report["strategy_choice"]["calibration_source"] == "calibration.npy"
    assert report["strategy_choice"]["calibration_samples"] == 5
